"""The longest stable step of grains in an undrained fluid, and the fluid's stiffness behind walls, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.two_way_limit import undrained_time_step, undrained_wall_stiffness

BETA = 4.6e-10


@pytest.fixture(scope="module")
def pack():
    random = np.random.default_rng(3)
    radius = random.uniform(0.9e-3, 1.1e-3, 27)
    centre = (np.stack(np.meshgrid(*[np.arange(3)] * 3), axis=-1).reshape(-1, 3) + 0.5) * 2.3e-3 + random.uniform(-1e-4, 1e-4, (27, 3))
    network = PoreNetwork(MPI.COMM_SELF, [0.0] * 3, [6.9e-3] * 3)
    network.update(np.arange(27), centre, radius)
    return network, radius


@pytest.mark.parametrize("boundary", [Boundary(), Boundary(pressure={"zmax": 0.0})], ids=["sealed", "drained"])
def test_the_step_against_the_dense_matrix(pack, boundary):
    network, radius = pack
    flow = PoreFlow(network, 1e-3, BETA)
    mass = 2650 * 4 / 3 * np.pi * radius**3
    rate = np.stack([network.volume_rate(unit.reshape(27, 3)) for unit in np.eye(81)], axis=1)
    answers = network.owned & ~flow.given(boundary)
    stiffness = rate[answers].T @ (rate[answers] / flow.storage[answers][:, None])
    weight = np.repeat(np.sqrt(mass), 3)
    longest = 2 / np.sqrt(np.linalg.eigvalsh(stiffness / np.outer(weight, weight))[-1])
    assert undrained_time_step(network, flow, boundary, mass) == pytest.approx(longest, rel=1e-3)


def test_without_storage_there_is_no_limit(pack):
    network, radius = pack
    assert undrained_time_step(network, PoreFlow(network, 1e-3, 0.0), Boundary(), radius) == np.inf


def test_the_stiffness_behind_a_wall(pack):
    """Sum of roof^2 / (beta V) over the pores at the wall; none where it is drained."""
    network, _ = pack
    flow = PoreFlow(network, 1e-3, BETA)
    found = undrained_wall_stiffness(network, flow, Boundary(pressure={"zmax": 0.0}))
    for face, name in enumerate(("xmin", "xmax", "ymin", "ymax", "zmin")):
        drained = flow.given(Boundary(pressure={"zmax": 0.0}))
        roof = np.where(drained, 0.0, network.roof_area(name))
        assert found[face] == pytest.approx((roof**2 / flow.storage).sum(), rel=1e-10)
    assert found[5] == 0.0
