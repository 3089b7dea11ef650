"""Arguments of wrong types: one error that names the argument, what was given and what was expected, the same on all ranks, of every public method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.transfer import carry_pressure
from flowsolver.two_way import TwoWayCoupling

SIDES = {"xmin": 1.0, "xmax": 0.0}
DRIVEN = Boundary(pressure=SIDES)


def objects(comm: MPI.Comm) -> SimpleNamespace:
    """A network of ten grains on each rank, a flow and a coupling; what was given, and pressures."""
    random = np.random.default_rng(comm.rank)
    position = random.uniform(0.1, 0.9, (10, 3))
    position[:, 0] = (comm.rank + position[:, 0]) / comm.size
    grains = dict(id=np.arange(10) + 10 * comm.rank, position=position, radius=np.full(10, 0.01))
    network = PoreNetwork(comm, [0.0] * 3, [1.0] * 3)
    network.remember_previous()
    network.update(**grains)
    flow = PoreFlow(network, 1.0, 1e-9)
    pressure = np.zeros(network.pores)
    return SimpleNamespace(comm=comm, grains=grains, network=network, flow=flow, pressure=pressure, coupling=TwoWayCoupling(network, flow, DRIVEN, pressure))


def box(o: SimpleNamespace, **given: Any) -> PoreNetwork:
    return PoreNetwork(**(dict(comm=o.comm, lower=[0.0] * 3, upper=[1.0] * 3) | given))


def coupled(o: SimpleNamespace, **given: Any) -> TwoWayCoupling:
    return TwoWayCoupling(**(dict(network=o.network, flow=o.flow, boundary=DRIVEN, pressure=o.pressure) | given))


def at_edges(o: SimpleNamespace, boundary: Any) -> None:
    o.flow.steady(boundary)


def with_other_edges(o: SimpleNamespace, boundary: Any) -> None:
    o.coupling.boundary = boundary
    try:
        o.coupling.begin(o.pressure)
    finally:
        o.coupling.boundary = DRIVEN


NO_NUMBER = ["1", None, True, [1.0], 1j, np.zeros(2), np.ma.masked, 10**400]
NO_NAME = [None, 1, ["total"], np.zeros(2)]
NO_FLAG = ["yes", 1, None]
NO_VECTOR = ["down", None, 1.0, [[0.0, 0.0], [1.0]]]
NO_BOUNDARY = [None, {"xmin": 1.0}, "xmin"]
ABOVE, OR_MORE, TOLERANCE = "a finite number above 0", "a finite number of 0 or more", "a number between 0 and 1"
#: What is called with a value; a sound one, from the objects; wrong ones; and what is said.
CASES: dict[str, tuple[Callable[[SimpleNamespace, Any], Any], Callable[[SimpleNamespace], Any], list[Any], str]] = {
    "lower": (lambda o, v: box(o, lower=v), lambda o: [0, 0, 0], NO_VECTOR, "lower (has shape|is no array)"),
    "upper": (lambda o, v: box(o, upper=v), lambda o: [1, 1, 1], NO_VECTOR, "upper (has shape|is no array)"),
    "periodic": (lambda o, v: box(o, periodic=v), lambda o: (True, False, False), [True, None, 3, "xyz", {}], "periodic is .*: expected True or False for each"),
    "trusted": (lambda o, v: box(o, trusted_displacement=v), lambda o: 0.0, NO_NUMBER, f"trusted_displacement is .*: expected {OR_MORE}"),
    **{name: (lambda o, v, name=name: o.network.update(**(o.grains | {name: v})), lambda o, name=name: o.grains[name], ["all", None, {}, 1.0], f"{name} has shape")
       for name in ("id", "position", "radius")},
    "wall_position": (lambda o, v: o.network.update(**o.grains, wall_position=v), lambda o: None, ["walls", 1.0, {}], "wall_position has shape"),
    "group": (lambda o, v: o.network.update(**o.grains, group=v), lambda o: None, ["first", 1.0, {}], "group has shape"),
    "rebuild": (lambda o, v: o.network.update(**o.grains, rebuild=v), lambda o: False, NO_FLAG, "rebuild is .*: expected True or False"),
    "remember": (lambda o, v: o.network.remember_previous(v), lambda o: True, NO_FLAG, "remember is .*: expected True or False"),
    "open share": (lambda o, v: o.network.limited(least_open_share=v), lambda o: 0.1, NO_NUMBER, f"least_open_share is .*: expected {OR_MORE}"),
    "void share": (lambda o, v: o.network.limited(least_void_share=v), lambda o: 0.1, NO_NUMBER, f"least_void_share is .*: expected {OR_MORE}"),
    "forces": (lambda o, v: o.network.forces(v), lambda o: o.pressure, NO_VECTOR, "pressure (has shape|is no array)"),
    "force law": (lambda o, v: o.network.forces(o.pressure, v), lambda o: "total", NO_NAME, 'law is .*: expected "total" or "pressure"'),
    "force on fluid": (lambda o, v: o.network.forces(o.pressure, body_force=v), lambda o: [0, 0, 0], NO_VECTOR, "body_force (has shape|is no array)"),
    "velocity": (lambda o, v: o.network.volume_rate(v), lambda o: np.zeros((10, 3)), NO_VECTOR, "velocity (has shape|is no array)"),
    "wall velocity": (lambda o, v: o.network.volume_rate(np.zeros((10, 3)), v), lambda o: None, ["fast", 1.0], "wall_velocity has shape"),
    "roof": (lambda o, v: o.network.roof_area(v), lambda o: "xmin", [0, None, ["xmin"], np.zeros(2)], "face .* is not known: expected one of xmin, "),
    "viscosity": (lambda o, v: PoreFlow(o.network, v), lambda o: 1.0, [*NO_NUMBER, 0, np.inf], f"viscosity is .*: expected {ABOVE}"),
    **{name: (lambda o, v, name=name: PoreFlow(o.network, 1.0, **{name: v}), lambda o: 0.1, [*NO_NUMBER, -1, np.nan], f"{name} is .*: expected {OR_MORE}")
       for name in ("compressibility", "least_open_share", "least_void_share")},
    "conductance law": (lambda o, v: PoreFlow(o.network, 1.0, conductance=v), lambda o: "duct", NO_NAME, 'conductance is .*: expected "duct" or "hydraulic-radius"'),
    "options": (lambda o, v: PoreFlow(o.network, 1.0, petsc_options=v), lambda o: "", [None, 3, ["-flow_ksp_view"]], "petsc_options is .*: expected text"),
    "gravity": (lambda o, v: o.flow.refresh(v), lambda o: [0, 0, 0], NO_VECTOR, "body_force (has shape|is no array)"),
    "conductance": (lambda o, v: setattr(o.flow, "conductance", v), lambda o: o.flow.conductance, NO_VECTOR, "conductance (has shape|is no array)"),
    "given": (lambda o, v: o.flow.given(v), lambda o: DRIVEN, NO_BOUNDARY, "boundary is .*: expected a Boundary"),
    "boundary": (at_edges, lambda o: DRIVEN, NO_BOUNDARY, "boundary is .*: expected a Boundary"),
    "start": (lambda o, v: o.flow.steady(DRIVEN, v), lambda o: None, ["high", 1.0, {}], "pressure has shape"),
    "volume rate": (lambda o, v: o.flow.steady(DRIVEN, None, v), lambda o: None, ["high", 1.0, {}], "volume_rate has shape"),
    "tolerance": (lambda o, v: o.flow.steady(DRIVEN, tolerance=v), lambda o: 1e-6, [*NO_NUMBER, 0, 1, np.nan], f"tolerance is .*: expected {TOLERANCE}"),
    "step": (lambda o, v: o.flow.implicit(DRIVEN, o.pressure, v), lambda o: 1.0, [*NO_NUMBER, 0, np.nan], f"dt is .*: expected {ABOVE}"),
    "step's tolerance": (lambda o, v: o.flow.implicit(DRIVEN, o.pressure, 1.0, tolerance=v), lambda o: 1e-6, NO_NUMBER, f"tolerance is .*: expected {TOLERANCE}"),
    "order": (lambda o, v: o.flow.implicit(DRIVEN, o.pressure, 1.0, order=v), lambda o: 2, ["1", None, True, 1.5, 3, [1]], "order is .*: expected 1 or 2"),
    "explicit step": (lambda o, v: o.flow.explicit(DRIVEN, o.pressure, v), lambda o: 1e-12, NO_NUMBER, f"dt is .*: expected {ABOVE}"),
    "substeps": (lambda o, v: o.flow.explicit(DRIVEN, o.pressure, 1e-12, most_substeps=v), lambda o: 1000, ["10", None, True, 1.5, 0],
                 "most_substeps is .*: expected a whole number, 1 or more"),
    "flow's forces": (lambda o, v: o.flow.forces(o.pressure, v), lambda o: "total", NO_NAME, 'law is .*: expected "total" or "pressure"'),
    "darcy": (lambda o, v: o.flow.darcy_velocity(v), lambda o: o.pressure, NO_VECTOR, "pressure (has shape|is no array)"),
    "pressures": (lambda o, v: at_edges(o, Boundary(pressure=v)), lambda o: SIDES, [None, ["xmin"], "xmin", 1.0], "pressure of the boundary is .*: expected faces"),
    "pressure": (lambda o, v: at_edges(o, Boundary(pressure={"xmin": v})), lambda o: 1.0, NO_NUMBER, "the pressure of face 'xmin' is .*: expected a number in Pa, or a function"),
    "face": (lambda o, v: at_edges(o, Boundary(pressure={v: 1.0})), lambda o: "xmin", [3, None, ("xmin",)], "face .* is not known: expected one of xmin, "),
    "inflows": (lambda o, v: at_edges(o, Boundary({"xmin": 1.0}, v)), lambda o: {"xmax": 1.0}, [None, ["xmin"], 1.0], "inflow of the boundary is .*: expected faces"),
    "inflow": (lambda o, v: at_edges(o, Boundary({"xmin": 1.0}, {"xmax": v})), lambda o: 1.0, NO_NUMBER, "the inflow of face 'xmax' is .*: expected a number in m/s, or a function"),
    "points": (lambda o, v: at_edges(o, Boundary(points=v)), lambda o: [(0.5, 0.5, 0.5, 1.0)], [None, 3, {}], "points of the boundary is .*: expected a list of"),
    "point": (lambda o, v: at_edges(o, Boundary(points=[v])), lambda o: (0.5, 0.5, 0.5, 1.0), [None, 3, "abcd", (0, 0, 0, "1"), (0, 0, 0, [1]), [[1], [2, 3], 4, 5]],
              "the point .* is not of four finite numbers"),
    "sources": (lambda o, v: at_edges(o, Boundary(SIDES, sources=v)), lambda o: [(0.5, 0.5, 0.5, 1.0)], [None, 3, {}], "sources of the boundary is .*: expected a list of"),
    "inside": (lambda o, v: at_edges(o, Boundary(SIDES, inside=v)), lambda o: None, [1.0, "x", []], "inside of the boundary is .*: expected a function of places, or None"),
    "coupled flow": (lambda o, v: coupled(o, flow=v), lambda o: o.flow, [None, "flow", 3], "flow is .*: expected a PoreFlow"),
    "edges": (lambda o, v: coupled(o, boundary=v), lambda o: DRIVEN, NO_BOUNDARY, "boundary is .*: expected a Boundary"),
    "coupled pressure": (lambda o, v: coupled(o, pressure=v), lambda o: o.pressure, NO_VECTOR, "pressure (has shape|is no array)"),
    "split": (lambda o, v: coupled(o, split=v), lambda o: "drained", NO_NAME, "split is .*: expected one of undrained, predicted, drained"),
    "coupled tolerance": (lambda o, v: coupled(o, tolerance=v), lambda o: 1e-6, NO_NUMBER, f"tolerance is .*: expected {TOLERANCE}"),
    "coupled law": (lambda o, v: coupled(o, law=v), lambda o: "total", NO_NAME, 'law is .*: expected "total" or "pressure"'),
    "drainage": (lambda o, v: coupled(o, drainage=v), lambda o: None, ["none", 1.0, {}], "drainage has shape"),
    "begin": (lambda o, v: o.coupling.begin(v), lambda o: o.pressure, NO_VECTOR, "pressure (has shape|is no array)"),
    "other edges": (with_other_edges, lambda o: DRIVEN, NO_BOUNDARY, "boundary is .*: expected a Boundary"),
    "moves": (lambda o, v: o.coupling.move(v, 1e-9), lambda o: np.zeros((10, 3)), NO_VECTOR, "velocity (has shape|is no array)"),
    "time": (lambda o, v: o.coupling.move(np.zeros((10, 3)), v), lambda o: 1e-9, NO_NUMBER, f"dt is .*: expected {ABOVE}"),
    "carried": (lambda o, v: carry_pressure(o.network, v, o.network.pores), lambda o: o.pressure, NO_VECTOR, "pressure (has shape|is no array)"),
    "pores before": (lambda o, v: carry_pressure(o.network, o.pressure, v), lambda o: o.network.pores, ["3", None, True, 1.5, -1],
                     "pores_before is .*: expected a whole number, 0 or more"),
}  # fmt: skip
#: Without which no rank can tell the others: refused where they are given.
ALONE: dict[str, tuple[Callable[[SimpleNamespace, Any], Any], list[Any], str]] = {
    "comm": (lambda o, v: box(o, comm=v), [None, 3, "world", MPI.COMM_NULL], "comm is .*: expected a communicator of mpi4py"),
    "flow's network": (lambda o, v: PoreFlow(v, 1.0), [None, "network", 3], "network is .*: expected a PoreNetwork"),
    "coupling's network": (lambda o, v: coupled(o, network=v), [None, "network", 3], "network is .*: expected a PoreNetwork"),
    "carried network": (lambda o, v: carry_pressure(v, o.pressure, o.network.pores), [None, "network"], "network is .*: expected a PoreNetwork"),
    "wall": (lambda o, v: o.network.pores_at_wall(v), [0, None, ["xmin"]], "face .* is not known: expected one of xmin, "),
}  # fmt: skip


@pytest.fixture(scope="module")
def things() -> SimpleNamespace:
    return objects(MPI.COMM_SELF)


@pytest.mark.parametrize("case", CASES)
def test_refused(things, case):
    act, sound, wrong, message = CASES[case]
    for value in wrong:
        with pytest.raises(InputError, match=message):
            act(things, value)
    act(things, sound(things))  # and goes on


@pytest.mark.parametrize("case", ALONE)
def test_refused_where_it_is_given(things, case):
    act, wrong, message = ALONE[case]
    for value in wrong:
        with pytest.raises(InputError, match=message):
            act(things, value)


def test_a_flow_through_another_network_is_refused(things):
    with pytest.raises(InputError, match="flow is one through another network"):
        coupled(things, flow=objects(MPI.COMM_SELF).flow)


def test_numbers_of_any_kind_are_numbers(things):
    for one in (1, 1.0, np.float32(1), np.int64(1), np.array(1.0)):
        PoreFlow(things.network, one).steady(Boundary({"xmin": one}, points=[(0.5, 0.5, 0.5, one)]))


@pytest.mark.parallel
def test_one_ranks_fault_is_every_ranks_error(mpirun):
    """Two ranks, each wrong value on rank 1 alone: both raise the same error, and both go on."""
    done = mpirun(2, [Path(__file__).with_name("flow_bad_types_ranks.py")])
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[-2] == f"{sum(len(wrong) for _, _, wrong, _ in CASES.values())} the same"


#: Native methods that read what `refresh` made of the mesh, of all pores' arrays.
NATIVE = {
    "solve": lambda flow, fixed, zero: flow.solve(fixed, zero, zero, zero, 0.0, 1e-6),
    "step_explicit": lambda flow, fixed, zero: flow.step_explicit(fixed, zero, zero, zero, 1e-12, 0.9, 1000),
    "balance": lambda flow, fixed, zero: flow.balance(fixed, zero, zero, zero, None),
    "driven": lambda flow, fixed, zero: flow.driven(zero, None),
    "outflow": lambda flow, fixed, zero: flow.outflow(zero),
}


@pytest.mark.parametrize("method", NATIVE)
def test_native_methods_refuse_a_mesh_that_was_not_refreshed(method):
    """They would read past the ends of arrays; here both meshes are of as many pores."""
    o = objects(MPI.COMM_SELF)
    native, fixed = o.flow._native, o.flow.given(DRIVEN)
    NATIVE[method](native, fixed, o.pressure)
    pores = o.network.pores
    o.network.update(**o.grains, rebuild=True)
    assert o.network.pores == pores
    with pytest.raises(InputError, match=r"call refresh\(\) after each update"):
        NATIVE[method](native, fixed, o.pressure)
    o.flow.refresh()
    NATIVE[method](native, fixed, o.pressure)


def test_what_python_works_out_refuses_it_too():
    """Of throats that are other ones now, without a native method that would notice."""
    o = objects(MPI.COMM_SELF)
    o.network.update(**o.grains, rebuild=True)
    with pytest.raises(InputError, match=r"call refresh\(\) after each update"):
        o.flow.darcy_velocity(o.pressure)
