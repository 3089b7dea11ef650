"""Forces are the gradient of the pore volumes: F_g = sum_k p_k dV_k/dx_g, with an overlap's lens held frozen."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import UNIT_BOX, Cell, gradient, random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork


def check(x, r, grains, planes=UNIT_BOX, group=None, tolerance=1e-9):
    """Forces on some grains, and on the walls, against finite differences of sum p_k V_k with lens volumes frozen."""
    group = np.zeros(len(r), np.int32) if group is None else group
    net = PoreNetwork(MPI.COMM_SELF, [0, 0, 0], [1, 1, 1])
    net.update(np.arange(len(r)), x, r, planes, group)
    pressure = np.random.default_rng(1).random(net.pores)
    force, wall_force = net.forces(pressure)
    cells = [Cell(v, planes, group) for v in net.grains_of_pore]
    frozen = [c.lenses(x, r) for c in cells]
    scale = (2 * r.max()) ** 2
    for grain in grains:
        touching = [k for k, c in enumerate(cells) if grain in c.grains]
        energy = lambda y: sum(pressure[k] * cells[k].pore_volume(y, r, frozen[k]) for k in touching)  # noqa: E731, B023
        np.testing.assert_allclose(force[grain], gradient(energy, x, grain), atol=tolerance * scale, rtol=0)
    for g in range(len(planes)):
        for wall in range(6):
            def energy(h: float) -> float:
                moved = planes.copy()
                moved[g, wall] += h if wall % 2 else -h
                return sum(p * Cell(v, moved, group).volume(x) for p, v in zip(pressure, net.grains_of_pore))  # noqa: B023

            h = 1e-4
            slope = (8 * (energy(h / 2) - energy(-h / 2)) - (energy(h) - energy(-h))) / (6 * h)
            assert wall_force[g, wall] == pytest.approx(slope, abs=tolerance)
    return net


@pytest.fixture(scope="module")
def pack():
    return random_pack(60, (0.08, 0.12), seed=2)


def test_four_spheres():
    x = np.array([[0.35, 0.4, 0.4], [0.65, 0.42, 0.38], [0.5, 0.66, 0.45], [0.52, 0.5, 0.7]])
    net = check(x, np.array([0.1, 0.12, 0.09, 0.11]), range(4))
    # cells of every kind, among them all that have walls
    kinds = np.bincount((net.grains_of_pore < 0).sum(axis=1), minlength=4)
    assert np.all(kinds > 0) and kinds[3] == 8


def test_four_spheres_that_overlap_each_other_and_a_wall():
    x = np.array([[0.35, 0.4, 0.4], [0.55, 0.42, 0.38], [0.45, 0.59, 0.42], [0.47, 0.5, 0.94]])
    check(x, np.array([0.12, 0.13, 0.11, 0.1]), range(4))


def test_random_pack(pack):
    check(*pack, grains=range(0, 60, 5))


def test_random_pack_that_overlaps(pack):
    x, r = pack
    check(x, 1.05 * r, grains=range(0, 60, 5))


def test_walls_with_steps_between_groups(pack):
    x, r = pack
    group = np.digitize(x[:, 0], [0.4, 0.6]).astype(np.int32)
    planes = np.repeat(UNIT_BOX, 3, axis=0) + np.array([[0, 0, 0, 0, -0.01, 0.02], [0] * 6, [0, 0, 0.005, 0, 0.01, -0.015]])
    check(x, r, range(0, 60, 3), planes, group)


def test_native_volumes_have_this_gradient_where_nothing_overlaps(pack):
    """The same with the solver's own volumes: forces are what its storage term answers to."""
    x, r = pack
    net = PoreNetwork(MPI.COMM_SELF, [0, 0, 0], [1, 1, 1])
    ids = np.arange(len(r))
    net.update(ids, x, r)
    pressure = np.random.default_rng(1).random(net.pores)
    force, _ = net.forces(pressure)

    def energy(y):
        assert net.update(ids, y, r) == "kept"
        return pressure @ net.pore_volume

    for grain in (0, 17, 42):
        np.testing.assert_allclose(force[grain], gradient(energy, x, grain), atol=1e-9 * (2 * r.max()) ** 2, rtol=0)


def test_sector_law_literally(pack):
    """(2): each facet pushes its grains with the pressure difference on their circular sectors, R^2 theta / 2."""
    x, r = pack
    net = PoreNetwork(MPI.COMM_SELF, [0, 0, 0], [1, 1, 1])
    net.update(np.arange(len(r)), x, r)
    pressure = np.random.default_rng(1).random(net.pores)
    force, _ = net.forces(pressure, "pressure")
    walls = -np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    centre = net.pore_centre
    expected = np.zeros_like(x)
    for (left, right), vertices in zip(net.pores_of_throat, net.grains_of_throat):
        for grain in vertices[vertices >= 0]:
            a, b = (walls[-1 - v] if v < 0 else x[v] - x[grain] for v in vertices if v != grain)
            normal = np.cross(a, b)
            angle = np.arctan2(np.linalg.norm(normal), a @ b)
            normal /= np.linalg.norm(normal)
            normal *= np.sign(normal @ (centre[right] - centre[left]))
            expected[grain] += (pressure[left] - pressure[right]) * r[grain] ** 2 * angle / 2 * normal
    np.testing.assert_allclose(force, expected, atol=1e-13)
