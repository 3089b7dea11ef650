"""On however many ranks: boxes without any given pressure whose open throats leave separate parts. Run by test_flow_parts.py.

Prints what every rank says of three parts, then the pressures' deviation from what must be where one pore alone is cut off.
"""

from __future__ import annotations

import numpy as np
from geometry_reference import random_pack
from mpi4py import MPI
from told_by_ranks import told

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

COUNT, CENTRES = 150, (75, 17)


def shut_out(net: PoreNetwork, flow: PoreFlow, inside: np.ndarray) -> None:
    """Shut the throats between pores inside (m,) bool and all others."""
    left, right = net.pores_of_throat[net.owned_throats].T
    conductance = flow.conductance
    conductance[inside[left] != inside[right]] = 0
    flow.conductance = conductance


def main() -> None:
    comm = MPI.COMM_WORLD
    x, r = random_pack(COUNT, (0.05, 0.09), seed=4)
    own = np.flatnonzero(np.minimum((x[:, 0] * comm.size).astype(int), comm.size - 1) == comm.rank)
    net = PoreNetwork(comm, [0] * 3, [1] * 3)
    net.update(own, x[own], r[own])
    vertices = net.grains_of_pore
    flow = PoreFlow(net, 1e-3)
    for grain in CENTRES:
        shut_out(net, flow, (vertices == grain).any(axis=1) & (vertices >= 0).all(axis=1))
    everyone = told(lambda: flow.steady(Boundary()))

    alone = PoreFlow(net, 1e-3)
    inside = np.sort(vertices, axis=1)
    # The pore whose grains come first of those without walls.
    first = min(map(tuple, np.concatenate(comm.allgather(inside[(inside >= 0).all(axis=1)])).tolist()))
    shut_out(net, alone, (inside == first).all(axis=1))
    start = np.where((inside == first).all(axis=1), 5.0, net.pore_centre[:, 2])
    result = alone.steady(Boundary(), start, tolerance=1e-12)
    own_pores = net.owned
    rest = own_pores & ~(inside == first).all(axis=1)
    kept = comm.allreduce(float(np.abs(result.pressure[own_pores & ~rest] - 5.0).sum()))
    spread = comm.allreduce(result.pressure[rest].max(), op=MPI.MAX) - comm.allreduce(result.pressure[rest].min(), op=MPI.MIN)
    if comm.rank == 0:
        print(*everyone, sep="\n")
        print(result.report["isolated_pores"], kept, spread)


if __name__ == "__main__":
    main()
