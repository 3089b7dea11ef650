"""What must close exactly: volumes fill the box, uniform pressure moves nothing, forces on grains and walls cancel."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from geometry_reference import NORMALS, UNIT_BOX, Cell, beads, cap, lens, random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork

ALL_PERIODS = list(product((False, True), repeat=3))


def network(x, r, periodic=(False,) * 3, planes=None, group=None, box=((0, 0, 0), (1, 1, 1))) -> PoreNetwork:
    net = PoreNetwork(MPI.COMM_SELF, *box, periodic)
    net.update(np.arange(len(r)), x, r, planes, group)
    return net


def total_force(force: np.ndarray, wall_force: np.ndarray) -> np.ndarray:
    return force.sum(axis=0) + wall_force.sum(axis=0) @ NORMALS


@pytest.fixture(scope="module")
def overlapping() -> tuple[np.ndarray, np.ndarray]:
    """300 grains pressed a little into each other and into the walls, without triple overlaps."""
    x, r = random_pack(300, (0.05, 0.08), seed=3)
    return x, 1.04 * r


@pytest.mark.parametrize("periodic", ALL_PERIODS)
def test_cells_fill_the_box(overlapping, periodic):
    net = network(*overlapping, periodic)
    assert abs(net.cell_volume[net.owned].sum() - 1) < 1e-12
    assert net.cell_volume.min() > 0


def test_pore_volumes_sum_to_the_porosity(overlapping):
    x, r = overlapping
    common = 0.0
    for i in range(len(r)):
        for j in range(i):
            common += lens(r[i], r[j], np.linalg.norm(x[i] - x[j]))
        common += sum(cap(r[i], gap) for gap in (*x[i], *(1 - x[i])))
    assert common > 1e-5  # the pack does overlap
    void = 1 - (4 / 3 * np.pi * r**3).sum() + common
    assert network(x, r).pore_volume.sum() == pytest.approx(void, abs=1e-12)


@pytest.mark.parametrize("inside", [False, True])
def test_each_volume_against_the_reference(overlapping, inside):
    x, r = beads() if inside else overlapping
    net = network(x, r)
    group = np.zeros(len(r), int)
    for vertices, cell, pore in zip(net.grains_of_pore, net.cell_volume, net.pore_volume):
        reference = Cell(vertices, UNIT_BOX, group)
        assert cell == pytest.approx(reference.volume(x), rel=1e-11, abs=1e-16)
        assert pore == pytest.approx(reference.pore_volume(x, r), abs=1e-15)


@pytest.mark.parametrize("law", ["total", "pressure"])
@pytest.mark.parametrize("periodic", ALL_PERIODS)
def test_uniform_pressure_moves_no_grain(overlapping, periodic, law):
    x, r = overlapping
    net = network(x, r, periodic)
    pressure = 2.5e7
    force, wall_force = net.forces(np.full(net.pores, pressure), law)
    assert np.abs(force).max() < 1e-12 * pressure * (2 * r.min()) ** 2
    # and pushes every wall with the pressure times its area
    expected = np.repeat(np.logical_not(periodic), 2) * pressure
    assert wall_force[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("periodic", ALL_PERIODS)
def test_momentum_closes_for_any_pressures(overlapping, periodic):
    net = network(*overlapping, periodic)
    centre = net.pore_centre
    # any field that has the same value in both copies of a cell that a period makes
    pressure = 1e6 * np.sin(7 * centre @ [1.0, 2.0, 3.0] + 50 * net.cell_volume ** (1 / 3))
    force, wall_force = net.forces(pressure)
    scale = np.abs(force).sum()
    assert scale > 0
    assert np.abs(total_force(force, wall_force)).max() < 1e-12 * scale


def test_momentum_closes_with_plates_of_their_own(overlapping):
    """Left block, gouge and right block have their own plates: planes with steps between them."""
    x, r = overlapping
    group = np.digitize(x[:, 0], [0.4, 0.6]).astype(np.int32)
    planes = np.repeat(UNIT_BOX, 3, axis=0) + np.array([[0, 0, 0, 0, -0.004, 0.002], [0] * 6, [0, 0, 0, 0, 0.003, -0.003]])
    net = network(x, r, planes=planes, group=group)
    pressure = np.random.default_rng(0).random(net.pores)
    force, wall_force = net.forces(pressure)
    assert wall_force.shape == (3, 6)
    assert np.abs(total_force(force, wall_force)).max() < 1e-12 * np.abs(force).sum()


def test_a_linear_pressure_pushes_with_its_gradient():
    """Total force on the grains of a large pack = minus gradient times volume, to the walls' discretisation."""
    x, r = random_pack(400, (0.04, 0.07), seed=5)
    net = network(x, r)
    force, wall_force = net.forces(net.pore_centre[:, 0])
    assert wall_force[0, 1] - wall_force[0, 0] == pytest.approx(-force[:, 0].sum(), rel=1e-12)
    assert force[:, 0].sum() == pytest.approx(-1.0, rel=0.15)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("periodic", ALL_PERIODS)
def test_few_grains(count, periodic):
    rng = np.random.default_rng(count)
    x = rng.uniform(0.2, 0.8, (count, 3))
    r = np.full(count, 0.03)
    net = network(x, r, periodic)
    assert net.cell_volume[net.owned].sum() == pytest.approx(1, abs=1e-12)
    assert net.pore_volume[net.owned].sum() == pytest.approx(1 - count * 4 / 3 * np.pi * 0.03**3, abs=1e-12)
    force, wall_force = net.forces(np.ones(net.pores))
    assert np.abs(force).max() < 1e-12


def test_grains_on_a_plane_and_a_line():
    for x in (np.array([[0.2, 0.5, 0.5], [0.5, 0.5, 0.5], [0.8, 0.5, 0.5]]), np.array([[a, b, 0.5] for a in (0.25, 0.75) for b in (0.25, 0.75)])):
        net = network(x, np.full(len(x), 0.1))
        assert net.cell_volume.sum() == pytest.approx(1, abs=1e-12)


def test_a_grain_inside_another_is_counted():
    x = np.array([[0.5, 0.5, 0.5], [0.52, 0.5, 0.5], [0.2, 0.2, 0.2]])
    net = network(x, np.array([0.3, 0.01, 0.1]))
    report = net.report()
    assert report["hidden_grains"] == 1
    force, _ = net.forces(np.random.default_rng(0).random(net.pores))
    assert np.all(force[1] == 0) and np.isfinite(force).all()
