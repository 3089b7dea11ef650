"""The pore network of a moving grain pack: which pores there are, and what their pressures do to grains and walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray

from flowsolver.checks import SHOWN, checked_array, checked_choice, checked_flag, checked_number, shown
from flowsolver.native import load

_native = load("poreslip_network")

InputError: type[ValueError] = _native.InputError
"""Something given is wrong. Raised on all ranks together."""
ComputationError: type[RuntimeError] = _native.ComputationError
"""The input was sound but the computation failed. Raised on all ranks together."""

FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
LEAST_OPEN_SHARE = 0.02
"""A throat's open area counts as at least this share of its facet."""
LEAST_VOID_SHARE = 0.05
"""A pore's void counts, for storage only, as at least this share of its cell."""

ForceLaw = Literal["total", "pressure"]
FORCE_LAWS = get_args(ForceLaw)


def _same_on_all(comm: MPI.Comm, values: dict[str, Any]) -> None:
    """InputError on all ranks, naming the first of these values by name that is another one on another rank. Collective."""
    if comm.size == 1:
        return
    told = comm.allgather({name: repr(value) for name, value in values.items()})
    for rank, others in enumerate(told):
        for name, other in others.items():
            if other != told[0][name]:
                raise InputError(f"{name} differs between ranks: {told[0][name][:SHOWN]} on rank 0, {other[:SHOWN]} on rank {rank}; give the same on every rank")


class PoreNetwork:
    """Pores between grains in a box, from each rank's own grains.

    Every face of a direction that is not periodic is a wall. Methods are collective unless they say local: every rank of the
    communicator must call them. Errors are raised on all ranks together.

    Parameters
    ----------
    comm
        mpi4py communicator; each rank hands over its own grains.
    lower, upper : (3,) float64, m
        Corners of the box; along periodic directions they give the period.
    periodic : (3,) bool
    trusted_displacement : m
        A mesh counts as kept, unseen, until a grain or a wall has moved this far since it was last known to hold; the pores'
        geometry follows the grains all the same. Default 0: looked at in every update.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        lower: ArrayLike,
        upper: ArrayLike,
        periodic: Sequence[bool] = (False, False, False),
        trusted_displacement: float = 0.0,
    ) -> None:
        # Without a communicator no rank can tell the others.
        if not isinstance(comm, MPI.Intracomm) or comm == MPI.COMM_NULL:
            raise InputError(f"comm is {shown(comm)}: expected a communicator of mpi4py, such as MPI.COMM_WORLD")
        faults: list[str] = []
        box = [checked_array(name, v, np.float64, (3,), faults) for name, v in (("lower", lower), ("upper", upper))]
        if not isinstance(periodic, Sequence | np.ndarray) or np.shape(periodic) != (3,) or not all(isinstance(p, bool | np.bool_) for p in periodic):
            faults.append(f"periodic is {shown(periodic)}: expected True or False for each of x, y and z")
        trusted = checked_number("trusted_displacement", trusted_displacement, lambda d: 0.0 <= d < np.inf, "a finite number of 0 or more", faults, "m")
        for fault in comm.allgather(faults[0] if faults else ""):
            if fault:
                raise InputError(fault)
        _same_on_all(comm, {"lower": box[0].tolist(), "upper": box[1].tolist(), "periodic": [bool(p) for p in periodic], "trusted_displacement": trusted})
        self._native = _native.PoreNetwork(
            comm.py2f(), [float(v) for v in box[0]], [float(v) for v in box[1]], [bool(p) for p in periodic], trusted
        )
        self.comm = comm
        self.periodic = tuple(bool(p) for p in periodic)
        self.lower, self.lengths = box[0], box[1] - box[0]
        self._faces = np.stack(box, axis=1).reshape(1, 6)
        self._radius, self._planes = np.zeros(0), self._faces

    @property
    def native(self) -> Any:
        """The native object, for the native flow solver."""
        return self._native

    def agree(self, faults: Sequence[str], **alike: Any) -> None:
        """Raise InputError on all ranks if any rank has a fault, with the first fault of the lowest such rank; or if one of `alike` is not the same
        on all ranks, which would wait for each other, or solve a system of parts that do not fit."""
        self._native.agree(faults[0] if faults else "")
        if alike:
            _same_on_all(self.comm, alike)

    def update(
        self,
        id: ArrayLike,
        position: ArrayLike,
        radius: ArrayLike,
        wall_position: ArrayLike | None = None,
        group: ArrayLike | None = None,
        rebuild: bool = False,
    ) -> str:
        """Take up the grains' present state; mesh anew only if the mesh at hand no longer holds.

        Parameters
        ----------
        id : (n,) int64
            This rank's own grains, in any order; they may have come from another rank since the last update.
        position : (n, 3) float64, m
        radius : (n,) float64, m
        wall_position : (G, 6) float64, m, optional
            Planes of the walls x low, x high, y low, y high, z low, z high for each group of grains, the same on all ranks;
            entries of periodic directions are not used. Default: the box's faces.
        group : (n,) int32, optional
            Each grain's row of wall_position. Default: 0.
        rebuild
            Mesh anew in any case.

        Returns
        -------
        "kept" (the mesh still holds), "repaired" (by flips) or "rebuilt", the same on all ranks.
        After "repaired" and "rebuilt" the pores are other ones. After an InputError about single grains or walls the network is as it was;
        after one about pairs of grains, or a ComputationError, it has no grains and no pores.
        """
        faults: list[str] = []
        ids = checked_array("id", id, np.int64, (None,), faults)
        n = len(ids)
        positions = checked_array("position", position, np.float64, (n, 3), faults)
        radii = checked_array("radius", radius, np.float64, (n,), faults)
        groups = np.zeros(n, np.int32) if group is None else checked_array("group", group, np.int32, (n,), faults)
        planes = self._faces if wall_position is None else checked_array("wall_position", wall_position, np.float64, (None, 6), faults)
        if len(planes) == 0 and not faults:
            faults.append("wall_position has no rows: expected one for each group of grains")
        rebuild = checked_flag("rebuild", rebuild, faults)
        self.agree(faults)
        try:
            outcome = self._native.update(ids, positions, radii, groups, planes, rebuild)
        except (InputError, ComputationError):
            # Grains of which no mesh could be made are not kept, nor are those before.
            self._radius = self._radius[: self._native.grains]
            raise
        # A copy, for the caller's may be an engine's own memory.
        self._radius, self._planes = radii.copy(), planes.copy()
        return outcome

    def remember_previous(self, remember: bool = True) -> None:
        """Whether a mesh that is given up leaves its pores behind, for `transfer.carry_pressure`."""
        faults: list[str] = []
        remember = checked_flag("remember", remember, faults)
        self.agree(faults)
        self._native.remember_previous(remember)

    @property
    def pores(self) -> int:
        """Number m of cells that touch this rank's grains (local)."""
        return self._native.pores

    @property
    def owned(self) -> NDArray[np.bool_]:
        """(m,) bool, local: the cells this rank owns; over all ranks every cell once."""
        return self._native.owned()

    @property
    def pore_centre(self) -> NDArray[np.float64]:
        """(m, 3) float64, m, local: centroid of each cell, inside the box along periodic directions."""
        return self._native.pore_centre()

    @property
    def cell_volume(self) -> NDArray[np.float64]:
        """(m,) float64, m^3, local: volume of each cell."""
        return self._native.cell_volume()

    @property
    def pore_volume(self) -> NDArray[np.float64]:
        """(m,) float64, m^3, local: void volume of each cell, (4)-(5), before any limiter."""
        return self._native.pore_volume()

    @property
    def grains_of_pore(self) -> NDArray[np.int64]:
        """(m, 4) int64, local: ids of each cell's grains; -1 to -6 are the walls x low, x high, y low, ... z high."""
        return self._native.grains_of_pore()

    def pores_at_wall(self, face: str) -> NDArray[np.int32]:
        """(k,) int32, local: the pores that touch the wall "xmin" ... "zmax", in order."""
        if fault := face_fault(face):
            raise InputError(fault)
        return self._native.pores_at_wall(FACES.index(face))

    @property
    def pores_of_throat(self) -> NDArray[np.int32]:
        """(f, 2) int32, local: the pores on the left and right of each throat."""
        return self._native.pores_of_throat()

    @property
    def grains_of_throat(self) -> NDArray[np.int64]:
        """(f, 3) int64, local: ids of each throat's grains; walls as in `grains_of_pore`."""
        return self._native.grains_of_throat()

    @property
    def owned_throats(self) -> NDArray[np.bool_]:
        """(f,) bool, local: the throats this rank owns; over all ranks every throat once."""
        return self._native.owned_throats()

    def throat_sections(self) -> dict[str, NDArray[np.float64]]:
        """Sections of the throats, (f,) float64 each, local: facet_area and open_area (m^2, the latter before any limiter),
        perimeter (m, arcs and open gaps), length (m, between the centroids of the cells)."""
        return self._native.throat_sections()

    def limited(self, least_open_share: float = LEAST_OPEN_SHARE, least_void_share: float = LEAST_VOID_SHARE) -> tuple[int, int]:
        """Numbers of pores and throats, over all ranks, that a limiter at these shares of cell and facet touches."""
        faults: list[str] = []
        shares = [checked_number(name, value, lambda share: 0.0 <= share < np.inf, "a finite number of 0 or more", faults)
                  for name, value in (("least_open_share", least_open_share), ("least_void_share", least_void_share))]  # fmt: skip
        self.agree(faults)
        return self._native.limited(*shares)

    def forces(
        self, pressure: ArrayLike, law: ForceLaw = "total", body_force: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Forces of given pore pressures on grains and walls.

        Parameters
        ----------
        pressure : (m,) float64, Pa
            Pressure in each pore of this rank, those it does not own too.
        law
            "total": the gradient of the pore volumes, F_g = sum_k p_k dV_k/dx_g; "pressure": (2) alone, without the throats'
            viscous drag.
        body_force : (3,) Pa/m
            b, on the fluid, that these pressures were computed with. The pressure b . x of a fluid at rest acts on whole grains, of which
            each feels the buoyancy -b V_g, and evenly on the walls; what is left of the pressures drags at the throats. Grains and walls
            together bear b times the box less the grains, along periods too. With one group of walls only.

        Returns
        -------
        force : (n, 3) float64, N, on this rank's grains in the order of the last update
        wall_force : (G, 6) float64, N, outward, on each wall by group, over all ranks
        """
        faults: list[str] = []
        law = checked_choice("law", law, FORCE_LAWS, faults)
        pressures = checked_array("pressure", pressure, np.float64, (self.pores,), faults)
        body = checked_array("body_force", body_force, np.float64, (3,), faults)
        if not np.isfinite(body).all():
            faults.append(f"body_force is {body}: expected finite numbers in Pa/m")
        elif body.any() and self._native.groups != 1:
            faults.append(f"forces of a body force want walls of one group: wall_position has {self._native.groups} rows")
        self.agree(faults)
        if not body.any():
            return self._native.forces(pressures, law)
        centre = self._native.unwrapped_centre()
        force, wall_force = self._native.forces(pressures - centre @ body, law)
        along_periods = np.where(self.periodic, body, 0.0)
        if along_periods.any():
            # Along a period b . x has many values. A wall feels the pressure of each pore, which within the pore has the gradient b.
            wall_force = self._native.forces(pressures - centre @ (body - along_periods), law)[1]
            wall_force += self._native.wall_forces_of_gradient([float(b) for b in along_periods])
        force -= 4 / 3 * np.pi * self._radius[:, None] ** 3 * body
        return force, wall_force + self._pressed_at_rest(body - along_periods)

    def _pressed_at_rest(self, body_force: NDArray[np.float64]) -> NDArray[np.float64]:
        """(1, 6) N, outward: of the pressure b . x on the walls."""
        lower, upper = (np.where(self.periodic, face, plane) for face, plane in zip(self._faces.reshape(3, 2).T, self._planes.reshape(3, 2).T))
        force = np.zeros((1, 6))
        for axis in np.flatnonzero(~np.array(self.periodic)):
            middle = (lower + upper) / 2
            for side, plane in enumerate((lower, upper)):
                middle[axis] = plane[axis]
                force[0, 2 * axis + side] = np.delete(upper - lower, axis).prod() * (middle @ body_force)
        return force

    def volume_rate(self, velocity: ArrayLike, wall_velocity: ArrayLike | None = None) -> NDArray[np.float64]:
        """Rate of change of each pore's volume, (m,) float64, m^3/s.

        From the same coefficients as `forces(law="total")`: the work that grains and walls gain is what the fluid loses.

        Parameters
        ----------
        velocity : (n, 3) float64, m/s, in the order of the last update
        wall_velocity : (G, 6) float64, m/s, outward, optional
            Speed of each wall by group. Default: walls at rest.
        """
        faults: list[str] = []
        velocities = checked_array("velocity", velocity, np.float64, (self._native.grains, 3), faults)
        shape = (self._native.groups, 6)
        walls = np.zeros(shape) if wall_velocity is None else checked_array("wall_velocity", wall_velocity, np.float64, shape, faults)
        self.agree(faults)
        return self._native.volume_rate(velocities, walls)

    def roof_area(self, face: str) -> NDArray[np.float64]:
        """(m,) float64, m^2: area of each pore's cell on the wall "xmin" ... "zmax". Collective."""
        self.agree([fault] if (fault := face_fault(face)) else [])
        speed = np.zeros((self._native.groups, 6))
        speed[:, FACES.index(face)] = 1.0
        return self._native.volume_rate(np.zeros((self._native.grains, 3)), speed)

    def report(self) -> dict[str, Any]:
        """Counts over all ranks (grains, pores, throats, hidden_grains, kept, repaired, rebuilt, exact_tests of the last certificate),
        the halo's width in m, and this rank's seconds by phase (tessellate, certify, geometry, forces)."""
        return self._native.report()


def face_fault(face: Any) -> str:
    """What is wrong with the name of a face; empty where it is one."""
    return "" if isinstance(face, str) and face in FACES else f"face {shown(face)} is not known: expected one of {', '.join(FACES)}"


def new_response(network: PoreNetwork) -> Any:
    """The native `PoreResponse` of a network: what its pressures answer to each step of the grains; see `flowsolver.two_way`."""
    return _native.PoreResponse(network.native)
