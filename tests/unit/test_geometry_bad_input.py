"""Bad input: one error that says what was given and what to do, on every rank."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork

X = np.array([[0.2, 0.2, 0.2], [0.7, 0.3, 0.4], [0.4, 0.8, 0.6]])
R = np.full(3, 0.1)
IDS = np.array([10, 20, 30])


def changed(array, index, value):
    out = np.array(array, float)
    out[index] = value
    return out


# what is given instead of the sound ids, positions, radii, planes, groups; and what the message must say
CASES = {
    "nan position": (dict(position=changed(X, (1, 2), np.nan)), "grain 20 has position"),
    "infinite position": (dict(position=changed(X, (1, 2), np.inf)), "grain 20 has position"),
    "zero radius": (dict(radius=changed(R, 2, 0)), "grain 30 has radius 0"),
    "negative radius": (dict(radius=changed(R, 2, -0.1)), "grain 30 has radius -0.1"),
    "nan radius": (dict(radius=changed(R, 2, np.nan)), "grain 30 has radius nan"),
    "outside the box": (dict(position=changed(X, (0, 0), 1.5)), "grain 10 .* outside the box.* x high"),
    "on the wall": (dict(position=changed(X, (0, 0), 0.0)), "grain 10 .* outside the box.* x low"),
    "same centre": (dict(position=X[[0, 0, 2]]), "grains 10 and 20 have the same centre|grains 20 and 10 have"),
    "same id": (dict(id=[10, 10, 30]), "id 10 occurs more than once"),
    "negative id": (dict(id=[10, -1, 30]), "id -1 is negative"),
    "fractional id": (dict(id=[10.0, 11.0, 30.0]), "id has shape .* float64: expected .* int64"),
    "position shape": (dict(position=X[:, :2]), r"position has shape \(3, 2\).*expected \(3, 3\) float64"),
    "position count": (dict(position=X[:2]), r"position has shape \(2, 3\)"),
    "position text": (dict(position=np.array([["a"] * 3] * 3)), "position has shape"),
    "radius shape": (dict(radius=R[:2]), r"radius has shape \(2,\)"),
    "radius complex": (dict(radius=R + 0j), "complex128"),
    "wall shape": (dict(wall_position=np.zeros((1, 5))), r"wall_position has shape \(1, 5\)"),
    "wall crossed": (dict(wall_position=np.array([[1.0, 0, 0, 1, 0, 1]])), "x high plane at 0 m is not above"),
    "wall nan": (dict(wall_position=np.array([[0, 1, 0, np.nan, 0, 1.0]])), r"wall_position\[0, 3\] \(y high\) is nan"),
    "no walls": (dict(wall_position=np.zeros((0, 6))), "wall_position has no rows"),
    "group outside": (dict(group=np.array([0, 0, 1], np.int32)), "grain 30 is of group 1: wall_position has rows 0 to 0"),
    "group shape": (dict(group=np.zeros(2, np.int32)), r"group has shape \(2,\)"),
    "no grains": (dict(id=np.zeros(0, int), position=np.zeros((0, 3)), radius=np.zeros(0)), "there are no grains"),
}


@pytest.mark.parametrize("case", CASES)
def test_update_refuses(case):
    given, message = CASES[case]
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    sound = dict(id=IDS, position=X, radius=R)
    with pytest.raises(InputError, match=message):
        net.update(**(sound | given))
    assert net.update(**sound) == "rebuilt"  # and goes on


@pytest.mark.parametrize("count", [2, 3, 40])
@pytest.mark.parametrize("same", ["id", "centre"])
def test_grains_of_which_no_mesh_can_be_made_leave_none(same, count):
    """Nor the mesh before, which is of other grains, perhaps more or fewer; and its flow is refused."""
    from flowsolver.flow import Boundary, PoreFlow

    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(IDS, X, R)
    flow, pores = PoreFlow(net, 1.0), net.pores
    id, position = np.arange(count), np.random.default_rng(0).uniform(0.2, 0.8, (count, 3))
    (id if same == "id" else position)[1] = (id if same == "id" else position)[0]
    with pytest.raises(InputError, match="occurs more than once" if same == "id" else "have the same centre"):
        net.update(id, position, np.full(count, 0.01))
    assert net.pores == 0 and net.grains_of_throat.shape == (0, 3)
    for body_force in ((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)):
        force, wall_force = net.forces(np.zeros(0), body_force=body_force)
        assert force.shape == (0, 3) and wall_force.shape == (1, 6)
    with pytest.raises(InputError, match=r"call refresh\(\) after each update"):
        flow.steady(Boundary(pressure={"xmin": 1.0}))
    with pytest.raises(InputError, match="the network has no pores: update it first"):
        flow.refresh()
    assert net.update(IDS, X, R) == "rebuilt" and net.pores == pores
    flow.refresh()
    assert flow.steady(Boundary(pressure={"xmin": 1.0, "xmax": 0.0})).mass_residual < 1e-10


BOXES = {
    "inside out": ([0, 0, 0], [1, -1, 1], "from 0 to -1 m in y is not a box"),
    "flat": ([0, 0, 0], [1, 1, 0], "from 0 to 0 m in z"),
    "nan": ([0, 0, np.nan], [1, 1, 1], "in z is not a box"),
    "shape": ([0, 0], [1, 1, 1], r"lower has shape \(2,\)"),
}
PERIODIC = ["xyz", (True, False), (0, 1, 2), np.array([[True, False, True]])]


@pytest.mark.parametrize("case", BOXES)
def test_box_is_refused(case):
    lower, upper, message = BOXES[case]
    with pytest.raises(InputError, match=message):
        PoreNetwork(MPI.COMM_SELF, lower, upper)


@pytest.mark.parametrize("periodic", PERIODIC, ids=str)
def test_periods_are_refused(periodic):
    """Text would be true for each of its letters."""
    with pytest.raises(InputError, match="periodic is .*: expected True or False for each of x, y and z"):
        PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)


def test_no_such_wall():
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    with pytest.raises(InputError, match="face 'top' is not known"):
        net.pores_at_wall("top")


def test_forces_refuse():
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(IDS, X, R)
    pressure = np.zeros(net.pores)
    with pytest.raises(InputError, match=r'law is "?.viscous'):
        net.forces(pressure, "viscous")
    with pytest.raises(InputError, match="pressure has shape"):
        net.forces(pressure[:-1])
    pressure[3] = np.nan
    with pytest.raises(InputError, match="the pressure of pore 3 is nan"):
        net.forces(pressure)


@pytest.mark.parallel
def test_one_ranks_fault_is_every_ranks_error(mpirun):
    """Two ranks: the fault is on rank 1 only; both raise the same error and both end."""
    done = mpirun(2, [Path(__file__).with_name("geometry_bad_input_ranks.py")])
    assert done.returncode == 0, done.stderr
    lines = [line.split("|") for line in done.stdout.splitlines()]
    assert [line[0] for line in lines] == list(CASES)
    for case, *said in lines:
        assert said[0] == said[1] != "no error", (case, said)
