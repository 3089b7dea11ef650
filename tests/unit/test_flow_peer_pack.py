"""A peer's flow through a pressed pack, with the peer's own conductances: its pressures come back."""

from __future__ import annotations

import numpy as np
import pytest
from peer_pack import OUTFLOW, by_vertices, looked_up, network_of, peer_pack

from flowsolver.flow import Boundary, PoreFlow

DRIVEN = Boundary(pressure={"ymin": 1.0, "ymax": 0.0})


@pytest.mark.parametrize("grains", [1000, 8000])
def test_the_peers_pressures_return(grains):
    peer = peer_pack(grains)
    network = network_of(peer)
    flow = PoreFlow(network, viscosity=10.0)
    flow.conductance = looked_up(by_vertices(peer["throat_vertices"], peer["throat_conductance"]), network.grains_of_throat)
    result = flow.steady(DRIVEN, tolerance=1e-12)
    expected = looked_up(by_vertices(peer["cell_vertices"], peer["cell_pressure"]), network.grains_of_pore)
    np.testing.assert_allclose(result.pressure, expected, rtol=0, atol=1e-9)
    assert result.outflow["ymax"] == pytest.approx(OUTFLOW[grains], rel=1e-8)
    # the drag on all grains is the pressure drop times the area, of which the peer's own forces give 0.99244 and 0.99677
    force, _ = network.forces(result.pressure)
    assert force[:, 1].sum() == pytest.approx(1.0, abs=1e-10)


def test_hydraulic_radius_is_the_peers_law_away_from_overlaps_and_walls():
    """Where no pair of a throat's grains overlaps, and no wall takes part, the two agree to rounding."""
    peer = peer_pack(1000)
    network = network_of(peer)
    flow = PoreFlow(network, viscosity=10.0, conductance="hydraulic-radius")
    conductance = looked_up(by_vertices(peer["throat_vertices"], peer["throat_conductance"]), network.grains_of_throat)
    x, r = peer["spheres"][:, :3], peer["spheres"][:, 3]
    pores = network.grains_of_pore
    compared = 0
    for ours, theirs, sides in zip(flow.conductance, conductance, network.pores_of_throat):
        around = np.unique(pores[sides])
        if around[0] < 0:
            continue
        gap = np.linalg.norm(x[around, None] - x[around], axis=2) - r[around, None] - r[around] + 10 * np.eye(len(around))
        if gap.min() > 0:
            assert ours == pytest.approx(theirs, rel=1e-6)
            compared += 1
    assert compared >= 3
