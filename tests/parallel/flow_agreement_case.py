"""Steady flow through a pressed pack at the default tolerance, by both laws, on however many ranks. Run by test_flow_ranks.py.

Arguments: pack (npz with spheres (n, 4): x y z r, in the unit box), output file.
"""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

comm = MPI.COMM_WORLD
x, r = np.hsplit(np.load(sys.argv[1])["spheres"], [3])
own = np.flatnonzero(np.minimum((x[:, 0] * comm.size).astype(int), comm.size - 1) == comm.rank)
network = PoreNetwork(comm, [0] * 3, [1] * 3)
network.update(own, x[own], r[own, 0])
result: dict[str, np.ndarray] = {}
for law in ("duct", "hydraulic-radius"):
    flow = PoreFlow(network, viscosity=10.0, conductance=law)
    solved = flow.steady(Boundary(pressure={"ymin": 1.0, "ymax": 0.0}))
    force = np.zeros_like(x)
    force[own], wall_force = flow.forces(solved.pressure)
    comm.Allreduce(MPI.IN_PLACE, force)
    owned = network.owned
    rows = np.concatenate(comm.allgather(np.column_stack([np.sort(network.grains_of_pore[owned], axis=1), solved.pressure[owned]])))
    result[f"{law} pressure"] = rows[np.lexsort(rows[:, :4].T[::-1])]
    result[f"{law} force"], result[f"{law} wall force"] = force, wall_force
    # The permeability but for a factor.
    result[f"{law} throughput"] = np.array([solved.outflow["ymax"]])
    result[f"{law} iterations"] = np.array([solved.report["iterations"]])

if comm.rank == 0:
    np.savez(sys.argv[2], **result)
