"""Two-way coupling: what the fluid does between its solves, and that work and mass close."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import UNIT_BOX, random_pack
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.two_way import TwoWayCoupling

DRAINED_BELOW = Boundary(pressure={"zmin": 0.0})


@pytest.fixture
def pack():
    x, r = random_pack(120, (0.06, 0.09), seed=5)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(np.arange(120), x, r)
    return net, PoreFlow(net, 1e-3, compressibility=4.5e-10), x, r


def test_undrained_box_answers_at_once(pack):
    """A sealed box whose lid sinks: at once every pore answers to its own squeeze; after the solve all have the mean."""
    net, flow, x, _ = pack
    coupling = TwoWayCoupling(net, flow, Boundary(), np.zeros(net.pores))
    lid = np.zeros((1, 6))
    lid[0, 5] = -1e-4
    for _ in range(10):
        coupling.move(np.zeros_like(x), 0.1, lid)
    squeezed = net.volume_rate(np.zeros_like(x), lid)
    np.testing.assert_allclose(coupling.pressure, -squeezed / flow.storage, rtol=1e-12)
    held = (flow.storage * coupling.pressure).sum()
    coupling.exchange()
    assert (flow.storage * coupling.pressure).sum() == pytest.approx(held, rel=1e-9)
    assert np.ptp(coupling.pressure) < 1e-4 * coupling.pressure.mean()


@pytest.mark.parametrize("split", ["undrained", "predicted", "drained"])
def test_work_and_mass_close_every_interval(pack, split):
    net, flow, x, _ = pack
    rng = np.random.default_rng(0)
    coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, np.full(net.pores, 1e4), split)
    for _ in range(3):
        gained = lost = 0.0
        for _ in range(4):
            velocity, walls = rng.normal(size=x.shape) * 1e-6, rng.normal(size=(1, 6)) * 1e-6
            force, wall_force = coupling.forces()
            gained += ((force * velocity).sum() + (wall_force * walls).sum()) * 1e-8
            lost += coupling.pressure @ net.volume_rate(velocity, walls) * 1e-8
            coupling.move(velocity, 1e-8, walls)
        assert gained == pytest.approx(lost, rel=1e-10)
        assert coupling.exchange().mass_residual < 1e-10


def test_grains_that_come_under_another_plane():
    """On the mesh of the interval before: what answers the planes' ways is connected anew."""
    x, r = random_pack(120, (0.06, 0.09), seed=5)
    ids, planes, rng = np.arange(120), np.repeat(UNIT_BOX, 2, axis=0), np.random.default_rng(3)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    sides = [np.digitize(x[:, 0], [split]).astype(np.int32) for split in (0.3, 0.7)]
    net.update(ids, x, r, planes, sides[0])
    coupling = TwoWayCoupling(net, PoreFlow(net, 1e-3, compressibility=4.5e-10), DRAINED_BELOW, np.full(net.pores, 1e4))
    coupling.move(np.zeros_like(x), 1e-8)
    coupling.exchange()
    assert coupling.update(ids, x, r, planes, sides[1]) == "kept"
    for _ in range(3):
        velocity, walls = rng.normal(size=x.shape) * 1e-3, rng.normal(size=(2, 6)) * 1e-3
        force, wall_force = coupling.forces()
        gained = (force * velocity).sum() + (wall_force * walls).sum()
        assert gained == pytest.approx(coupling.pressure @ net.volume_rate(velocity, walls), rel=1e-9)
        coupling.move(velocity, 1e-8, walls)


def test_work_of_pressures_that_drain(pack):
    """The fluid gives what its pressures, half-way through each of unlike steps, do on the volumes that pores gain, drainage included."""
    net, flow, x, _ = pack
    rng = np.random.default_rng(5)
    coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, np.full(net.pores, 1e4), "predicted")
    coupling.begin(rng.uniform(0, 1e4, net.pores), rng.normal(size=net.pores) * 1e11)
    expected = size = 0.0
    for dt in (1e-8, 4e-8, 2e-8):
        velocity, walls = rng.normal(size=x.shape) * 1e-6, rng.normal(size=(1, 6)) * 1e-6
        before = coupling.pressure
        coupling.move(velocity, dt, walls)
        given = 0.5 * (before + coupling.pressure) * net.volume_rate(velocity, walls) * dt
        expected, size = expected + given.sum(), size + np.abs(given).sum()
    done, given_by_fluid, of_all = coupling.work
    assert abs(given_by_fluid - expected) < 1e-13 * size
    assert abs(done - given_by_fluid) < 1e-13 * of_all


def test_steps_have_the_networks_coefficients(pack):
    """Volumes and forces of a step, with walls that move, are those of `volume_rate` and `forces` where the interval began; either law."""
    net, flow, x, _ = pack
    rng = np.random.default_rng(3)
    for law in ("total", "pressure"):
        coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, rng.uniform(0, 1e4, net.pores), law=law)
        velocity, walls, before = rng.normal(size=x.shape) * 1e-6, rng.normal(size=(1, 6)) * 1e-6, coupling.pressure
        coupling.move(velocity, 1e-8, walls)
        given = flow.given(DRAINED_BELOW)
        expected = before - np.where(given, 0.0, net.volume_rate(velocity, walls) * 1e-8 / flow.storage)
        np.testing.assert_allclose(coupling.pressure, expected, rtol=1e-12)
        for one, other in zip(coupling.forces(), net.forces(expected, law)):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())
        done, given_by_fluid, size = coupling.work
        assert (abs(done - given_by_fluid) < 1e-13 * size) == (law == "total")


@pytest.mark.parametrize("new_mesh", [False, True])
def test_what_steps_add_up_to(pack, new_mesh):
    """From no pressure at all, so that nothing hides an error: the forces of an interval's displacements, of grains and of walls in two
    parts, are those of the pressures that they make, and the work that they take is in these pressures."""
    net, flow, x, r = pack
    rng, ids, group = np.random.default_rng(11), np.arange(120), (np.arange(120) % 2).astype(np.int32)
    plane = np.tile(UNIT_BOX, (2, 1))
    plane[1] += np.tile([-0.01, 0.01], 3)
    assert net.update(ids, x, r, plane, group) in ("repaired", "rebuilt")
    flow.refresh()
    coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, np.zeros(net.pores))
    if new_mesh:
        coupling.move(rng.normal(size=x.shape), 1e-8)
        coupling.exchange()
        assert coupling.update(ids, np.clip(x + rng.normal(size=x.shape) * 3e-3, 0.01, 0.99), r, plane, group) in ("repaired", "rebuilt")
        coupling.begin(np.zeros(net.pores))
    way, wall_way = np.zeros_like(x), np.zeros((2, 6))
    for _ in range(5):
        velocity, walls = rng.normal(size=x.shape), rng.normal(size=(2, 6))
        coupling.move(velocity, 1e-8, walls)
        way, wall_way = way + velocity * 1e-8, wall_way + walls * 1e-8
    pressure = np.where(flow.given(DRAINED_BELOW), 0.0, -net.volume_rate(way, wall_way) / flow.storage)
    np.testing.assert_allclose(coupling.pressure, pressure, rtol=0, atol=1e-12 * np.abs(pressure).max())
    for one, other in zip(coupling.forces(), net.forces(pressure)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())
    done, given_by_fluid, _ = coupling.work
    assert done == pytest.approx(-0.5 * (flow.storage * pressure**2).sum(), rel=1e-11)
    assert given_by_fluid == pytest.approx(done, rel=1e-11)


def test_the_split_names_the_solve(pack):
    """It decides what the grains feel within an interval; over it the fluid does the same, to second order with "predicted"."""
    net, flow, x, _ = pack
    velocity, at_start = np.random.default_rng(1).normal(size=x.shape) * 1e-6, np.full(net.pores, 1e4)
    for split, order in (("undrained", 1), ("predicted", 2), ("drained", 1)):
        coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, at_start, split)
        coupling.move(velocity, 1e-7)
        solved = flow.implicit(DRAINED_BELOW, at_start, 1e-7, net.volume_rate(velocity), order=order).pressure
        np.testing.assert_allclose(coupling.exchange().pressure, solved, rtol=1e-8)


def test_predicted_pressures_go_on_draining(pack):
    """Grains at rest, a pack that drains: the predicted pressures are off by the square of the interval, the undrained ones by the interval."""
    net, flow, x, _ = pack
    slow = PoreFlow(net, 1.0, compressibility=4.5e-10)
    interval = 2e-8

    def lag(split: str, parts: int) -> float:
        """Largest difference between a predicted pressure and the solve that follows, past the first sudden drainage, over the pressure."""
        coupling, dt = TwoWayCoupling(net, slow, DRAINED_BELOW, np.full(net.pores, 1e4), split, 1e-13), interval / parts
        for _ in range(5 * parts):
            coupling.begin(coupling.pressure, coupling.drainage)
            coupling.move(np.zeros_like(x), dt)
            felt = coupling.pressure
            solved = coupling.exchange().pressure
        return np.abs(felt - solved).max() / 1e4

    assert lag("undrained", 2) / lag("undrained", 4) == pytest.approx(2.0, rel=0.1)
    assert lag("predicted", 2) / lag("predicted", 4) == pytest.approx(4.0, rel=0.2)
    assert lag("predicted", 4) < 0.1 * lag("undrained", 4)


def test_a_new_mesh_between_intervals(pack):
    net, flow, x, r = pack
    coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, np.full(net.pores, 1e4))
    rng = np.random.default_rng(2)
    outcomes = set()
    for _ in range(6):
        step = rng.normal(size=x.shape) * 3e-4
        coupling.move(step / 1e-6, 1e-6)
        coupling.exchange()
        x = np.clip(x + step, 0.01, 0.99)
        outcomes.add(coupling.update(np.arange(120), x, r, UNIT_BOX))
        assert len(coupling.pressure) == net.pores and np.isfinite(coupling.pressure).all()
    assert outcomes & {"repaired", "rebuilt"}


def test_bad_input(pack):
    net, flow, x, r = pack
    p = np.zeros(net.pores)
    with pytest.raises(InputError, match="split is 'half'"):
        TwoWayCoupling(net, flow, DRAINED_BELOW, p, "half")
    with pytest.raises(InputError, match="compressibility above 0"):
        TwoWayCoupling(net, PoreFlow(net, 1e-3), DRAINED_BELOW, p)
    with pytest.raises(InputError, match="law is 'half'"):
        TwoWayCoupling(net, flow, DRAINED_BELOW, p, law="half")
    coupling = TwoWayCoupling(net, flow, DRAINED_BELOW, p)
    with pytest.raises(InputError, match=r"at least one move\(\)"):
        coupling.exchange()
    with pytest.raises(InputError, match="dt is nan"):
        coupling.move(np.zeros_like(x), float("nan"))
    coupling.move(np.zeros_like(x), 1.0)
    with pytest.raises(InputError, match=r"call exchange\(\) first"):
        coupling.update(np.arange(120), x, r)


def test_a_body_force_is_refused(pack):
    """Its buoyancy is in no force of the interval's steps."""
    net, flow, _, _ = pack
    flow.refresh((0.0, 0.0, -9810.0))
    with pytest.raises(InputError, match="body force of .*-9810"):
        TwoWayCoupling(net, flow, DRAINED_BELOW, np.zeros(net.pores))
