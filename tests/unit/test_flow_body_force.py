"""Forces of a fluid with weight: buoyancy, weight borne, drag along periods."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

GRAVITY = np.array([300.0, 0.0, -9810.0])


def make_flow(periodic=(False,) * 3, count=150, radius=(0.05, 0.09)) -> tuple[PoreFlow, np.ndarray]:
    """A flow with weight, and the grains' radii."""
    x, r = random_pack(count, radius, 4)
    network = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    network.update(np.arange(count), x, r)
    flow = PoreFlow(network, 1e-3)
    flow.refresh(GRAVITY)
    return flow, r


def solid(r: np.ndarray) -> np.ndarray:
    return 4 / 3 * np.pi * r**3


@pytest.mark.parametrize("law", ["total", "pressure"])
def test_archimedes(law):
    """In a fluid at rest each grain feels the weight of the fluid in its place, and walls the fluid's columns."""
    flow, r = make_flow()
    force, wall_force = flow.forces(1e4 + flow.network.pore_centre @ GRAVITY, law)
    np.testing.assert_allclose(force, -solid(r)[:, None] * GRAVITY, atol=1e-12 * 1e4)
    np.testing.assert_allclose(wall_force[0], 1e4 + np.array([-9810 / 2, 300 - 9810 / 2, 150 - 9810 / 2, 150 - 9810 / 2, 150, 150 - 9810]), rtol=1e-12)


def test_pressures_at_rest_are_found_and_nothing_drags():
    flow, r = make_flow()
    result = flow.steady(Boundary(), tolerance=1e-12)
    force, _ = flow.forces(result.pressure)
    np.testing.assert_allclose(force, -solid(r)[:, None] * GRAVITY, atol=1e-7 * 9810 * solid(r).min())
    assert result.mass_residual < 1e-10


@pytest.mark.parametrize("periodic", [(False, False, False), (True, True, False), (True, True, True), (False, False, True)])
def test_grains_and_walls_bear_the_fluids_weight(periodic):
    """Along a period the body force drives the flow: the drag on all grains is what the fluid is pushed with."""
    flow, r = make_flow(periodic)
    result = flow.steady(Boundary() if all(periodic) else Boundary(pressure={"xmin" if not periodic[0] else "zmin": 500.0}))
    force, wall_force = flow.forces(result.pressure)
    borne = force.sum(axis=0) + wall_force[0, 1::2] - wall_force[0, ::2]
    np.testing.assert_allclose(borne, (1 - solid(r).sum()) * GRAVITY, atol=1e-10 * 9810)


def test_in_a_lattice_all_grains_bear_the_same():
    """Body-centred cubic, whose cells have no ties: of the push on the fluid each grain takes its share."""
    cells = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x = np.concatenate([cells + 0.25, cells + 0.75]) / 3
    r = np.full(len(x), 0.99 * np.sqrt(3) / 4 / 3)
    network = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, [True] * 3)
    network.update(np.arange(len(x)), x, r)
    flow = PoreFlow(network, 1e-3)
    flow.refresh([100.0, 200.0, -300.0])
    force, _ = flow.forces(flow.steady(Boundary(), tolerance=1e-12).pressure)
    share = (1 - solid(r).sum()) / len(x) * flow.body_force
    np.testing.assert_allclose(force, np.broadcast_to(share, force.shape), atol=1e-8 * np.abs(share).max())


def test_refusals():
    flow, r = make_flow(count=30)
    with pytest.raises(InputError, match="body_force is .*nan.*: expected finite"):
        flow.refresh([0.0, 0.0, np.nan])
    network = flow.network
    x = np.array(random_pack(30, (0.05, 0.09), 4)[0])
    network.update(np.arange(30), x, r, np.array([[0, 1, 0, 1, 0, 1.0]] * 2), np.arange(30, dtype=np.int32) % 2)
    with pytest.raises(InputError, match="want walls of one group: wall_position has 2 rows"):
        network.forces(np.zeros(network.pores), body_force=[0.0, 0.0, 1.0])
