"""Pore space that shut throats take apart, where no pressure is given and nothing is stored."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from flow_parts_ranks import CENTRES, COUNT, shut_out
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow


def parts(left: np.ndarray, right: np.ndarray, count: int) -> np.ndarray:
    """(count,) of each pore the number of its part, by handing the least number on along throats (k,), (k,)."""
    part, before = np.arange(count), None
    while before is None or (part != before).any():
        before = part.copy()
        np.minimum.at(part, left, before[right])
        np.minimum.at(part, right, before[left])
    return np.unique(part, return_inverse=True)[1]


@pytest.fixture(scope="module")
def apart() -> tuple[PoreNetwork, PoreFlow, np.ndarray]:
    """A pack with two of its pores' clusters shut off, and the part of each pore, (m,)."""
    x, r = random_pack(COUNT, (0.05, 0.09), seed=4)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(np.arange(COUNT), x, r)
    vertices = net.grains_of_pore
    flow = PoreFlow(net, 1e-3, compressibility=1e-9)
    for grain in CENTRES:
        shut_out(net, flow, (vertices == grain).any(axis=1) & (vertices >= 0).all(axis=1))
    left, right = net.pores_of_throat[net.owned_throats].T
    open_ = flow.conductance > 0
    return net, flow, parts(left[open_], right[open_], net.pores)


@pytest.mark.parametrize("ranks", [1, 2])
def test_separate_parts_are_refused_with_their_cause(mpirun, apart, ranks):
    net, _, part = apart
    sizes = np.bincount(part)
    done = mpirun(ranks, [Path(__file__).with_name("flow_parts_ranks.py")])
    assert done.returncode == 0, done.stderr
    *said, alone = done.stdout.splitlines()
    assert len(said) == ranks and len(set(said)) == 1
    found = re.fullmatch(
        r"no pressure is given anywhere, nothing is stored, and open throats join the pores to (\d+) separate parts, .*; the smallest, of (\d+) pores, "
        r"has one at \((.*)\) m: give a pressure at a face or pore, or solve in time steps with a compressible fluid", said[0]
    )  # fmt: skip
    assert found, said[0]
    assert (int(found[1]), int(found[2])) == (len(sizes), sizes.min()) and len(sizes) > 2 and sizes.min() > 1
    named = np.linalg.norm(net.pore_centre - [float(c) for c in found[3].split(",")], axis=1).argmin()
    assert sizes[part[named]] == sizes.min()
    # One pore by itself keeps its pressure, and the others have one.
    isolated, kept, spread = map(float, alone.split())
    assert isolated == 1 and kept == 0 and spread < 1e-9


def test_with_storage_each_part_has_its_own_mean(apart):
    net, flow, part = apart
    start = net.pore_centre[:, 0]
    result = flow.implicit(Boundary(), start, 1e-6, tolerance=1e-12)
    weight = np.bincount(part, flow.storage)
    assert np.abs(result.pressure - start).max() > 0.1
    np.testing.assert_allclose(np.bincount(part, flow.storage * result.pressure) / weight, np.bincount(part, flow.storage * start) / weight, rtol=1e-9)
