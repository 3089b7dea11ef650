"""On two ranks: each fault of test_geometry_bad_input.py on rank 1 alone. Rank 0 prints case|message of rank 0|of rank 1."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from test_geometry_bad_input import CASES, IDS, R, X
from told_by_ranks import told

from flowsolver import PoreNetwork

comm = MPI.COMM_WORLD
net = PoreNetwork(comm, [0] * 3, [1] * 3)
for case, (given, _) in CASES.items():
    # rank 0 has grains of its own; in the case of no grains nobody has any
    own = dict(id=IDS + 100 * comm.rank, position=X * (0.4 + 0.55 * comm.rank), radius=R * 0.4)
    if comm.rank == 1 or case == "no grains":
        own |= given
    everyone = told(lambda: net.update(**own))
    if comm.rank == 0:
        print(case, *everyone, sep="|")
sound = dict(id=IDS + 100 * comm.rank, position=X * (0.4 + 0.55 * comm.rank), radius=R * 0.4)
assert net.update(**sound) == "rebuilt"
assert np.isfinite(net.forces(np.zeros(net.pores))[0]).all()
