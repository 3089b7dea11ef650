"""What is given at the edges of a flow, and what that means pore by pore."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray

from flowsolver.checks import checked_array, is_number, shown
from flowsolver.network import FACES, PoreNetwork, face_fault

ON_A_BOUNDARY = 1e-9
"""Of a cell's size: a point as near to a facet lies on it, in the cells on both sides."""
PressureValue = float | Callable[[NDArray[np.float64]], ArrayLike]


@dataclass(frozen=True)
class Boundary:
    """What is given at the edges of the flow. A wall that is not named lets nothing through.

    pressure
        Face ("xmin" ... "zmax") to pressure in Pa, or to a function of pore centres (k, 3) in m that returns (k,) Pa: the pores
        that touch that wall have this pressure. Where the array that it returns is masked (numpy.ma) the wall lets nothing through.
    inflow
        Face to Darcy velocity into the box, m/s, through the cells of the wall; or to a function of pore centres, as for `pressure`.
    points
        (x, y, z, pressure), m and Pa: the pore whose cell holds the point, across periods too, has this pressure.
    sources
        (x, y, z, rate), m and m^3/s: flow into the pore whose cell holds the point.
    inside
        Function of pore centres (m, 3) in m that returns (m,) Pa: pores that have this pressure wherever they lie. Those where the array
        is masked are free. Faces and points come first.
    """

    pressure: Mapping[str, PressureValue] = field(default_factory=dict)
    inflow: Mapping[str, PressureValue] = field(default_factory=dict)
    points: Sequence[tuple[float, float, float, float]] = ()
    sources: Sequence[tuple[float, float, float, float]] = ()
    inside: Callable[[NDArray[np.float64]], ArrayLike] | None = None


def type_faults(boundary: Any) -> list[str]:
    """What has not the type that it has to have in a boundary, before anything is looked up in it."""
    if not isinstance(boundary, Boundary):
        return [f"boundary is {shown(boundary)}: expected a Boundary"]
    faults = []
    for name, unit in (("pressure", "Pa"), ("inflow", "m/s")):
        given = getattr(boundary, name)
        if not isinstance(given, Mapping):
            faults.append(f"{name} of the boundary is {shown(given)}: expected faces with what is given there, {{face: number}}")
            continue
        for face, value in given.items():
            if not callable(value) and not is_number(value):
                faults.append(f"the {name} of face {shown(face)} is {shown(value)}: expected a number in {unit}, or a function of places")
    for name in ("points", "sources"):
        given = getattr(boundary, name)
        if not isinstance(given, Sequence | np.ndarray):
            faults.append(f"{name} of the boundary is {shown(given)}: expected a list of (x, y, z, value)")
    if boundary.inside is not None and not callable(boundary.inside):
        faults.append(f"inside of the boundary is {shown(boundary.inside)}: expected a function of places, or None")
    return faults


@dataclass(frozen=True)
class Conditions:
    """A boundary on the pores of a network as it stands, and what else one solve starts from; arrays (m,) of all pores that this rank sees.

    fixed : bool, pores whose pressure is given
    owner : int, which of the boundary's conditions gave it, in its order; -1 for none
    before : float64, Pa, pressures at the start
    given : float64, Pa, the same with what is given in its place
    source : float64, m^3/s, of faces with an inflow and of points
    volume_rate : float64, m^3/s, dV/dt
    """

    network: PoreNetwork
    boundary: Boundary
    fixed: NDArray[np.bool_]
    owner: NDArray[np.int_]
    before: NDArray[np.float64]
    given: NDArray[np.float64]
    source: NDArray[np.float64]
    volume_rate: NDArray[np.float64]

    @classmethod
    def of(cls, network: PoreNetwork, boundary: Boundary, pressure: ArrayLike | None = None, volume_rate: ArrayLike | None = None) -> Conditions:
        """From pressures and volume rates, (m,) Pa and m^3/s, 0 where they are left out. InputError names what does not fit. Collective."""
        faults = type_faults(boundary)
        if faults:
            # Nothing to look at any more: the ranks agree below.
            boundary = Boundary()
        m = network.pores
        before = np.zeros(m) if pressure is None else checked_array("pressure", pressure, np.float64, (m,), faults)
        rate = np.zeros(m) if volume_rate is None else checked_array("volume_rate", volume_rate, np.float64, (m,), faults)
        if not np.isfinite(before).all():
            faults.append("pressure has entries that are not finite")
        if not np.isfinite(rate).all():
            faults.append("volume_rate has entries that are not finite")
        for face in [*boundary.pressure, *boundary.inflow]:
            if fault := face_fault(face):
                faults.append(fault)
            elif network.periodic[FACES.index(face) // 2]:
                faults.append(f"face {face!r} is periodic: it takes neither pressure nor inflow")
        for face in boundary.inflow:
            if face in boundary.pressure:
                faults.append(f"face {face!r} has both a pressure and an inflow")
        for point in [*boundary.points, *boundary.sources]:
            if not _is_point(point):
                faults.append(f"the point {shown(point)} is not of four finite numbers: expected x, y, z in m and a pressure or a rate")
        network.agree(faults, **({} if faults else {"boundary": _outline(boundary)}))

        owner = np.full(m, -1, np.int16)
        start, source, places = before.copy(), np.zeros(m), _Places(network)
        for index, (face, value) in enumerate(boundary.pressure.items()):
            touching = network.pores_at_wall(face)
            touching = touching[owner[touching] < 0]
            given = _values(f"the pressure of face {face!r}", value, places.of(touching, value), faults)
            touching, given = touching[~np.ma.getmaskarray(given)], given.compressed()
            if not np.isfinite(given).all():
                faults.append(f"the pressure of face {face!r} is not a finite number in Pa everywhere")
            start[touching] = given
            owner[touching] = index
        pointed = np.zeros(m, bool)
        for *point, value in boundary.points:
            holds = _holds(network, point, places, faults)
            if (pointed[holds] & (start[holds] != value)).any():
                faults.append(f"the point {tuple(point)} lies in a pore that another point gives another pressure: leave one of them out")
            pointed[holds] = True
            start[holds] = value
            owner[holds] = len(boundary.pressure)
        if boundary.inside is not None:
            given = _values("the pressure inside", boundary.inside, places.centre, faults)
            holds = ~np.ma.getmaskarray(given) & (owner < 0)
            start[holds] = given.data[holds]
            owner[holds] = len(boundary.pressure) + 1
        if not np.isfinite(start).all():
            faults.append("a given pressure is not a finite number")
        network.agree(faults)
        for face, value in boundary.inflow.items():
            source += (flow := _through(network, face, value, places, faults))
            if not np.isfinite(flow).all():
                faults.append(f"the inflow of face {face!r} is not a finite number in m/s everywhere")
        for *point, flow in boundary.sources:
            source[_holds(network, point, places, faults)] += flow
        network.agree(faults)
        return cls(network, boundary, owner >= 0, owner, before, start, source, rate)

    def outflow(self, supply: NDArray[np.float64]) -> dict[str, float]:
        """Flow out of the box, m^3/s, by face and over all ranks, as `FlowResult` has it. supply (m,) m^3/s: what each pore needs from outside. Collective."""
        boundary, owner, network = self.boundary, self.owner, self.network
        names = [*boundary.pressure, "points", "inside", *boundary.inflow]
        owned, places = network.owned, _Places(network)
        holders = np.flatnonzero(owned & (owner >= 0))
        given = -np.bincount(owner[holders], supply[holders], len(names) - len(boundary.inflow))
        # On a rank without such pores bincount counts in whole numbers.
        sums = np.array([*given, *(-_through(network, face, value, places, [])[owned].sum() for face, value in boundary.inflow.items())], np.float64)
        network.comm.Allreduce(MPI.IN_PLACE, sums)
        outflow = dict(zip(names, sums.tolist()))
        outflow["points"] -= float(sum(source[3] for source in boundary.sources))
        if not len(boundary.points) and not len(boundary.sources):
            del outflow["points"]
        if boundary.inside is None:
            del outflow["inside"]
        return outflow


def _is_point(point: Any) -> bool:
    return isinstance(point, Sequence | np.ndarray) and len(point) == 4 and all(is_number(one) and np.isfinite(one) for one in point)


def _outline(boundary: Boundary) -> dict[str, Any]:
    """What has to be the same on all ranks: functions may give each rank's own pores what they like."""
    faces = {name: {face: "a function" if callable(value) else float(value) for face, value in getattr(boundary, name).items()} for name in ("pressure", "inflow")}
    return faces | {name: np.asarray(getattr(boundary, name), float).tolist() for name in ("points", "sources")} | {"inside": boundary.inside is not None}


class _Places:
    """Of a network's pores, for those boundaries that ask."""

    def __init__(self, network: PoreNetwork) -> None:
        self._network = network

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """(m, 3) m"""
        return self._network.pore_centre

    @cached_property
    def vertices(self) -> NDArray[np.int64]:
        """(m, 4)"""
        return self._network.grains_of_pore

    def of(self, pores: NDArray[np.intp], value: PressureValue) -> NDArray[np.float64]:
        """(k, 3) m: centres of some pores for a value there; a number asks for none."""
        return self.centre[pores] if callable(value) else np.broadcast_to(np.nan, (len(pores), 3))


def _values(name: str, value: PressureValue, place: NDArray[np.float64], faults: list[str]) -> np.ma.MaskedArray:
    """(k,) float64: a value at places (k, 3) in m. One that fails, or does not fit, is added to `faults`, so that all ranks hear of it."""
    try:
        found = np.ma.asarray(value(place) if callable(value) else np.full(len(place), value))
        if found.dtype.kind == "c":
            raise TypeError("it yields complex numbers")
        found = np.ma.asarray(found, float)
    except Exception as error:  # a caller's function raises whatever it likes
        faults.append(f"{name} cannot be had: {type(error).__name__}: {error}")
        return np.ma.zeros(len(place))
    if found.ndim == 0:
        found = np.ma.asarray(np.ma.resize(found, len(place)))
    if found.shape != (len(place),):
        faults.append(f"{name} has shape {found.shape} at {len(place)} places: expected ({len(place)},)")
        return np.ma.zeros(len(place))
    return found


def _holds(network: PoreNetwork, point: Sequence[float], places: _Places, faults: list[str]) -> NDArray[np.bool_]:
    """(m,) bool: the pore whose cell holds a point (3,) m, across periods too, with its copies; on a boundary between several the one of the
    grains with the lowest ids, whatever the ranks. A point that none holds is added to `faults`. Collective."""
    depth = np.where(network.owned, network.native.depth(list(map(float, point))), -np.inf)
    deepest = network.comm.allreduce(float(depth.max(initial=-np.inf)), op=MPI.MAX)
    holds = np.zeros(network.pores)
    if deepest < -ON_A_BOUNDARY:
        faults.append(f"no pore holds the point {tuple(point)}: expected one between the walls")
        return holds > 0.0
    near = np.flatnonzero(depth >= deepest - ON_A_BOUNDARY)
    step = (places.centre[near] - np.array(point)) / network.lengths
    step[:, network.periodic] -= np.round(step[:, network.periodic])
    candidates = [(np.sort(places.vertices[k]).tolist(), step[row].tolist(), network.comm.rank, int(k)) for row, k in enumerate(near)]
    *_, rank, index = min(candidate for part in network.comm.allgather(candidates) for candidate in part)
    if rank == network.comm.rank:
        holds[index] = 1.0
    # Its grains alone do not tell a pore from others where a period is short.
    return network.native.share(holds) > 0.0


def _through(network: PoreNetwork, face: str, value: PressureValue, places: _Places, faults: list[str]) -> NDArray[np.float64]:
    """(m,) m^3/s: into each pore through a face with a given inflow, m/s."""
    area = network.roof_area(face)
    # The function is one of places at that wall.
    touching = np.flatnonzero(area)
    flow = np.zeros(len(area))
    flow[touching] = area[touching] * _values(f"the inflow of face {face!r}", value, places.of(touching, value), faults).filled(0.0)
    return flow
