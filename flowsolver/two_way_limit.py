"""The longest stable step of grains that feel a fluid which cannot flow: of the undrained split between two solves.

Pressures answer displacements u by dp = -dV / (beta V), and give forces dF = sum_k dp_k dV_k/dx: a spring, K_f = G^T (1 / beta V) G with G =
dV/dx. Velocity Verlet is stable up to dt = 2 / omega of the largest eigenvalue of M^-1 K_f, found here from the network's own rates and
forces. With the contacts' springs besides, 1 / dt^2 is at most the sum of both.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from flowsolver.flow import Boundary, PoreFlow
from flowsolver.lanczos import largest_eigenvalue
from flowsolver.checks import checked_array
from flowsolver.network import PoreNetwork

#: Lanczos' iterations: the stiffest pores stand out, and three digits are known after fifteen.
ITERATIONS = 20


def undrained_time_step(network: PoreNetwork, flow: PoreFlow, boundary: Boundary, mass: ArrayLike) -> float:
    """The longest step, s, that is stable in the fluid alone; infinite where it gives no forces. Collective.

    mass : (n,) float64, kg, of this rank's grains in the order of the network's last update
    """
    faults: list[str] = []
    masses = checked_array("mass", mass, np.float64, (network.native.grains,), faults)
    network.agree(faults)
    weight = np.sqrt(masses)[:, None]
    stiffness = np.divide(1.0, flow.storage, out=np.zeros(network.pores), where=~flow.given(boundary) & (flow.storage > 0.0))

    def pushed_back(q: np.ndarray) -> np.ndarray:
        return network.forces(network.volume_rate(q / weight) * stiffness)[0] / weight

    start = np.random.default_rng(network.comm.rank).normal(size=(len(masses), 3))
    eigenvalue = largest_eigenvalue(pushed_back, start, network.comm, ITERATIONS)
    return 2.0 / math.sqrt(eigenvalue) if eigenvalue > 0.0 else math.inf


def undrained_wall_stiffness(network: PoreNetwork, flow: PoreFlow, boundary: Boundary) -> np.ndarray:
    """(6,) N/m: force of the fluid behind each wall, all groups of grains together, per unit of its way while no pore drains. Collective."""
    stiffness = np.divide(1.0, flow.storage, out=np.zeros(network.pores), where=~flow.given(boundary) & (flow.storage > 0.0))
    result = np.zeros(6)
    for face in range(6):
        if network.periodic[face // 2]:
            continue
        inwards = np.zeros((network.native.groups, 6))
        inwards[:, face] = -1.0
        swept = network.volume_rate(np.zeros((network.native.grains, 3)), inwards)
        result[face] = network.forces(-swept * stiffness)[1][:, face].sum()
    return result
