"""What one solve leaves of the balance of all pores, beside what `USUAL_IMBALANCE` says."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI
from peer_pack import network_of, peer_pack

from flowsolver import PoreNetwork
from flowsolver.boundary import Conditions
from flowsolver.flow import USUAL_IMBALANCE, Boundary, PoreFlow

BOUNDARIES = {
    "walls": Boundary(pressure={"ymin": 1.0, "ymax": 0.0}),
    "point": Boundary(pressure={"ymax": 0.0}, points=[(0.5, 0.4, 0.5, 1.0)]),
    "varied": Boundary(pressure={"ymin": lambda place: 1 + np.sin(6 * place[:, 0]), "ymax": 0.3}),
    "inflow": Boundary(pressure={"ymax": 0.0}, inflow={"ymin": 1e-3}),
}


def of_random(count: int, radius: tuple[float, float], periodic: tuple[bool, bool, bool]) -> PoreNetwork:
    x, r = random_pack(count, radius, seed=count)
    network = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    network.update(np.arange(count), x, 1.01 * r)
    return network


PACKS = {
    "peer": lambda: network_of(peer_pack(1000)),
    "alike": lambda: of_random(400, (0.04, 0.065), (False, False, False)),
    "unlike": lambda: of_random(300, (0.01, 0.1), (False, False, False)),
    "periods": lambda: of_random(300, (0.02, 0.1), (True, False, True)),
}


@pytest.mark.parametrize("pack", PACKS)
def test_ordinary_solves_stay_below(pack):
    """Of `duct`, at any tolerance, whatever drives the flow."""
    flow = PoreFlow(PACKS[pack](), 1e-3)
    for boundary in BOUNDARIES.values():
        conditions = Conditions.of(flow.network, boundary)
        for tolerance in (1e-6, 1e-8, 1e-10, 1e-12):
            pressure, report = flow._solve(conditions, conditions.given, 0.0, tolerance)
            throughput = flow._balance(conditions, pressure, None).throughput
            assert 0 < report["imbalance"] <= 0.2 * USUAL_IMBALANCE * tolerance * throughput
