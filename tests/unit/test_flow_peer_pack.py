"""A peer's flow through a pressed pack of 1000 grains, with the peer's own conductances: its pressures come back.

The data are YADE 2023.02a's (viscosity 10 Pa s, p = 1 Pa on ymin, 0 on ymax): `spheres` (1000, 4), `cell_vertices` (5579, 4) with
-1 to -6 for walls, `cell_pressure` (5579,), `throat_vertices` (11154, 3) and `throat_conductance` (11154,), m^3/(Pa s).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

DATA = Path(__file__).resolve().parent.parent / "data" / "peer_pack_1000.npz"
DRIVEN = Boundary(pressure={"ymin": 1.0, "ymax": 0.0})


@pytest.fixture(scope="module")
def peer():
    return dict(np.load(DATA))


@pytest.fixture(scope="module")
def network(peer):
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(np.arange(1000), peer["spheres"][:, :3], peer["spheres"][:, 3])
    return net


def by_vertices(vertices, values):
    return {tuple(sorted(v)): value for v, value in zip(vertices.tolist(), values)}


def test_the_peers_pressures_return(peer, network):
    flow = PoreFlow(network, viscosity=10.0)
    conductance = by_vertices(peer["throat_vertices"], peer["throat_conductance"])
    flow.conductance = [conductance[tuple(sorted(v))] for v in network.grains_of_throat.tolist()]
    result = flow.steady(DRIVEN, tolerance=1e-12)
    expected = by_vertices(peer["cell_vertices"], peer["cell_pressure"])
    expected = np.array([expected[tuple(sorted(v))] for v in network.grains_of_pore.tolist()])
    np.testing.assert_allclose(result.pressure, expected, rtol=0, atol=1e-9)
    assert result.outflow["ymax"] == pytest.approx(7.87110485e-07, rel=1e-8)
    # the drag on all grains is the pressure drop times the area, of which the peer's own forces give 0.99244
    force, _ = network.forces(result.pressure)
    assert force[:, 1].sum() == pytest.approx(1.0, abs=1e-10)


def test_hydraulic_radius_is_the_peers_law_away_from_overlaps_and_walls(peer, network):
    """Where no pair of a throat's grains overlaps, and no wall takes part, the two agree to rounding."""
    flow = PoreFlow(network, viscosity=10.0, conductance="hydraulic-radius")
    conductance = by_vertices(peer["throat_vertices"], peer["throat_conductance"])
    x, r = peer["spheres"][:, :3], peer["spheres"][:, 3]
    pores = network.grains_of_pore
    compared = 0
    for c, vertices, sides in zip(flow.conductance, network.grains_of_throat.tolist(), network.pores_of_throat):
        around = np.unique(pores[sides])
        if around[0] < 0:
            continue
        gap = np.linalg.norm(x[around, None] - x[around], axis=2) - r[around, None] - r[around] + 10 * np.eye(len(around))
        if gap.min() > 0:
            assert c == pytest.approx(conductance[tuple(sorted(vertices))], rel=1e-6)
            compared += 1
    assert compared >= 3
