"""On two ranks: each wrong value of test_flow_bad_types.py on rank 1 alone, a sound one on rank 0. Rank 0 prints how many were told alike."""

from __future__ import annotations

import re

from mpi4py import MPI
from test_flow_bad_types import CASES, objects
from told_by_ranks import told

comm = MPI.COMM_WORLD
things, same = objects(comm), 0
for case, (act, sound, wrong, message) in CASES.items():
    for value in wrong:
        first, second = told(lambda: act(things, value if comm.rank == 1 else sound(things)))
        assert first == second and re.search(message, first), (case, first, second)
        same += 1
    act(things, sound(things))
if comm.rank == 0:
    print(same, "the same")
