"""Pressures carried to a new mesh: the fluid's mass stays, and so do the pores that did not change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.transfer import carry_pressure

BOXES = [(False,) * 3, (True, False, True)]


@pytest.mark.parametrize("periodic", BOXES)
@pytest.mark.parametrize("move", [3e-3, 1e-2, 0.05])
def test_fluid_is_conserved(periodic, move):
    x, r = random_pack(200, (0.05, 0.08), seed=7)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    net.remember_previous()
    ids = np.arange(200)
    net.update(ids, x, r)
    field = lambda: 1e6 * (1 + np.cos(2 * np.pi * net.pore_centre[:, 0]) + net.pore_centre[:, 1])  # noqa: E731
    pressure, before, pores = field(), net.grains_of_pore, net.pores
    moved = np.clip(x + np.random.default_rng(0).normal(scale=move * 0.1, size=x.shape), 0.01, 0.99)
    assert net.update(ids, moved, r) in ("repaired", "rebuilt")
    after = carry_pressure(net, pressure, pores)

    old_grains, old_volume, old_index = net.native.previous()
    held = (old_volume * pressure[old_index]).sum()
    owned = net.owned
    assert (net.pore_volume * after)[owned].sum() == pytest.approx(held, rel=1e-12)
    assert old_volume.sum() == pytest.approx(net.pore_volume[owned].sum(), rel=1e-12)

    same = {tuple(sorted(v)): p for v, p in zip(before.tolist(), pressure)}
    if not any(periodic):
        kept = [(p, same[k]) for k, p in zip(map(lambda v: tuple(sorted(v)), net.grains_of_pore.tolist()), after) if k in same]
        assert len(kept) > 0.3 * net.pores and all(a == b for a, b in kept)
    assert np.sqrt(np.mean((after - field()) ** 2)) < 0.1e6


def test_a_new_pore_gets_the_mean_of_those_that_vanished_around_it():
    """By volume, over all that had one of its grains; then one shift for all new pores. Against sums made pore by pore."""
    x, r = random_pack(80, (0.06, 0.1), seed=2)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.remember_previous()
    ids = np.arange(80)
    net.update(ids, x, r)
    pressure = np.sin(9 * net.pore_centre).sum(axis=1) + 5
    before, pores = [tuple(sorted(v)) for v in net.grains_of_pore.tolist()], net.pores
    net.update(ids, np.clip(x + np.random.default_rng(1).normal(scale=2e-3, size=x.shape), 0.01, 0.99), r)
    after = carry_pressure(net, pressure, pores)
    pores_now = [tuple(sorted(v)) for v in net.grains_of_pore.tolist()]
    _, volume, index = net.native.previous()
    gone = [(set(before[k]), v, pressure[k]) for k, v in zip(index, volume) if before[k] not in pores_now]
    new = [k for k, v in enumerate(pores_now) if v not in before]
    assert len(gone) > 10 and len(new) > 10
    expected = np.empty(len(new))
    for n, k in enumerate(new):
        # One that has several of its grains counts once for each.
        shared = [(len(grains & {g for g in pores_now[k] if g >= 0}) * abs(v), p) for grains, v, p in gone]
        expected[n] = sum(w * p for w, p in shared) / sum(w for w, _ in shared)
    expected += (sum(v * p for _, v, p in gone) - net.pore_volume[new] @ expected) / net.pore_volume[new].sum()
    np.testing.assert_allclose(after[new], expected, rtol=1e-11)


def test_nothing_changes_where_the_mesh_does_not():
    x, r = random_pack(100, (0.05, 0.08), seed=7)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.remember_previous()
    net.update(np.arange(100), x, r)
    pressure = net.pore_centre[:, 0]
    assert net.update(np.arange(100), x, r, rebuild=True) == "rebuilt"
    assert np.array_equal(carry_pressure(net, pressure, net.pores), pressure)


@pytest.mark.parallel
def test_two_ranks_carry_the_same(mpirun):
    """Two ranks, with grains that change rank in between."""
    done = mpirun(2, [Path(__file__).with_name("flow_transfer_ranks.py")])
    assert done.returncode == 0, done.stderr
