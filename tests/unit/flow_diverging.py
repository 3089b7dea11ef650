"""On two ranks: a linear solver that may do one iteration only. Run by test_flow_solver.py."""

from __future__ import annotations

import numpy as np
from geometry_reference import random_pack
from mpi4py import MPI
from told_by_ranks import told

from flowsolver import ComputationError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

comm = MPI.COMM_WORLD
x, r = random_pack(100, (0.06, 0.1), seed=1)
own = np.arange(100)[comm.rank :: 2]
net = PoreNetwork(comm, [0] * 3, [1] * 3)
net.update(own, x[own], r[own])
flow = PoreFlow(net, 1e-3, petsc_options="-flow_ksp_max_it 1 -flow_pc_type jacobi")
everyone = told(lambda: flow.steady(Boundary(pressure={"xmin": 1.0, "xmax": 0.0})), ComputationError)
if comm.rank == 0:
    print(*everyone, sep="\n")
