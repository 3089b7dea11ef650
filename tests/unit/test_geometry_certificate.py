"""A mesh is kept exactly as long as it is the regular triangulation of the grains where they now are."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import UNIT_BOX, random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork


def cells(net: PoreNetwork) -> set[tuple[int, ...]]:
    return {tuple(sorted(v)) for v in net.grains_of_pore[net.owned]}


@pytest.mark.parametrize("periodic", [(False,) * 3, (False, False, True), (True,) * 3])
def test_kept_means_same_as_fresh(periodic):
    x, r = random_pack(200, (0.05, 0.08), seed=7)
    ids = np.arange(len(r))
    rng = np.random.default_rng(0)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    net.update(ids, x, r)
    outcomes = []
    for step in (1e-6, 1e-4, 1e-3, 1e-2) * 5:
        x = np.clip(x + rng.normal(scale=step * 0.1, size=x.shape), 0.01, 0.99)
        before = cells(net)
        outcomes.append(net.update(ids, x, r))
        fresh = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
        fresh.update(ids, x, r)
        assert cells(net) == cells(fresh)
        assert (outcomes[-1] == "kept") == (before == cells(fresh))
    assert "kept" in outcomes and "repaired" in outcomes
    report = net.report()
    assert report["kept"] == outcomes.count("kept") and report["rebuilt"] == 1 + outcomes.count("rebuilt")
    assert report["repaired"] == outcomes.count("repaired")


def test_moving_walls_are_certified_too():
    x, r = random_pack(200, (0.05, 0.08), seed=7)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    planes = UNIT_BOX.copy()
    outcomes = []
    for _ in range(30):
        planes += 0.01 * np.array([[-1, 1, 0, 0, 0, 0]])
        outcomes.append(net.update(ids, x, r, planes))
        fresh = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
        fresh.update(ids, x, r, planes)
        assert cells(net) == cells(fresh)
    assert "kept" in outcomes and "repaired" in outcomes


def test_a_trusted_mesh_is_looked_at_once_a_grain_or_a_wall_has_moved_so_far():
    """Small steps that flip facets: unseen they change nothing but the geometry, and at last the mesh is that of the grains again."""
    x, r = random_pack(200, (0.05, 0.08), seed=7)
    ids, rng = np.arange(len(r)), np.random.default_rng(0)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, trusted_displacement=2.5e-3)
    seen = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    for one in (net, seen):
        one.update(ids, x, r)
    start, way, outcomes = cells(net), rng.uniform(-1.0, 1.0, x.shape), []
    way *= 1e-3 / np.linalg.norm(way, axis=1).max()
    for step in range(1, 4):
        x = np.clip(x + way, 0.01, 0.99)
        outcomes.append((net.update(ids, x, r), seen.update(ids, x, r)))
        assert net.cell_volume.sum() == pytest.approx(1.0, rel=1e-12)
        assert (cells(net) == start) == (step < 3)
    assert [one for one, _ in outcomes] == ["kept", "kept", "repaired"] and "repaired" in [other for _, other in outcomes[:2]]
    assert cells(net) == cells(seen)
    planes = UNIT_BOX + 1e-3 * np.array([[-1.0, 0, 0, 0, 0, 0]])
    assert net.update(ids, x, r, planes) == "kept"
    planes[0, 0] = -0.2
    assert net.update(ids, x, r, planes) != "kept"
    with pytest.raises(ValueError, match="trusted_displacement is -1.0 m"):
        PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, trusted_displacement=-1.0)


def test_repaired_means_same_as_fresh_over_many_steps():
    """Flip after flip, without a new triangulation in between; then moves too large to repair."""
    x, r = random_pack(300, (0.04, 0.07), seed=9)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(ids, x, r)
    velocity = np.random.default_rng(0).normal(scale=3e-4, size=x.shape)
    outcomes = []
    for _ in range(40):
        x = np.clip(x + velocity, 0.02, 0.98)
        outcomes.append(net.update(ids, x, r))
        fresh = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
        fresh.update(ids, x, r)
        assert cells(net) == cells(fresh)
        assert net.cell_volume.sum() == pytest.approx(1, abs=1e-12)
        force, wall_force = net.forces(net.pore_centre[:, 0] ** 2)
        fresh_force, fresh_wall_force = fresh.forces(fresh.pore_centre[:, 0] ** 2)
        np.testing.assert_allclose(force, fresh_force, atol=1e-14)
        np.testing.assert_allclose(wall_force, fresh_wall_force, atol=1e-13)
    assert outcomes.count("repaired") > 30
    assert net.update(ids, np.random.default_rng(1).permutation(x), r) == "rebuilt"


def test_a_grain_that_leaves_through_a_period_keeps_the_mesh():
    x, r = random_pack(100, (0.06, 0.1), seed=1)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, [True] * 3)
    net.update(ids, x, r)
    pressure = net.cell_volume
    force, _ = net.forces(pressure)
    wrapped = np.mod(x + 0.5, 1.0) - 0.5  # half the grains as another of their images
    assert net.update(ids, wrapped, r) == "kept"
    np.testing.assert_allclose(net.forces(pressure)[0], force, atol=1e-14)


def test_order_of_grains_may_change():
    x, r = random_pack(100, (0.06, 0.1), seed=1)
    ids = np.arange(len(r)) * 7 + 3
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(ids, x, r)
    pressure = net.pore_centre[:, 0]
    force, _ = net.forces(pressure)
    order = np.random.default_rng(0).permutation(len(r))
    assert net.update(ids[order], x[order], r[order]) == "kept"
    assert np.array_equal(net.forces(pressure)[0], force[order])
    # and a fresh mesh does not depend on it at all
    assert net.update(ids[order], x[order], r[order], rebuild=True) == "rebuilt"
    assert np.array_equal(net.forces(net.pore_centre[:, 0])[0], force[order])


def test_grains_that_come_or_go_are_meshed_anew():
    x, r = random_pack(100, (0.06, 0.1), seed=1)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(ids, x, r)
    assert net.update(ids[1:], x[1:], r[1:]) == "rebuilt"
    assert net.update(ids, x, r) == "rebuilt"
    assert net.report()["grains"] == 100


@pytest.mark.parametrize("change", ["axes", "place", "unit"])
def test_forces_follow_rigid_motion_and_units(change):
    x, r = random_pack(150, (0.05, 0.09), seed=4)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(ids, x, r)
    force, _ = net.forces(net.cell_volume)
    lower, upper, y, radius, scale = np.zeros(3), np.ones(3), x, r, 1.0
    if change == "axes":
        y = np.roll(x, 1, axis=1)
    elif change == "place":
        lower, upper, y = lower + [10.3, -7.1, 2.9], upper + [10.3, -7.1, 2.9], x + [10.3, -7.1, 2.9]
    else:
        scale = 1e-3
        upper, y, radius = upper * scale, x * scale, r * scale
    other = PoreNetwork(MPI.COMM_SELF, lower, upper)
    other.update(ids, y, radius)
    moved, _ = other.forces(other.cell_volume / scale**3)
    if change == "axes":
        moved = np.roll(moved, -1, axis=1)
    np.testing.assert_allclose(moved / scale**2, force, atol=1e-12 * np.abs(force).max())


def test_a_thousand_new_meshes_take_no_more_memory():
    from resource import RUSAGE_SELF, getrusage

    x, r = random_pack(60, (0.08, 0.12), seed=1)
    ids = np.arange(len(r))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, [False, False, True])
    net.remember_previous()
    rng = np.random.default_rng(0)
    for count in range(1000):
        net.update(ids, np.clip(x + rng.normal(scale=1e-3, size=x.shape), 0.02, 0.98), r, rebuild=count % 2 == 0)
        net.forces(net.pore_centre[:, 0])
        if count == 200:
            before = getrusage(RUSAGE_SELF).ru_maxrss
    assert getrusage(RUSAGE_SELF).ru_maxrss - before < 2048  # kB
