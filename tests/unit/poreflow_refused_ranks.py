"""On two ranks: each fault of test_poreflow_command.py. Rank 0 prints the case and both exit statuses. Arguments: the faulty packs' directory, the pack."""

from __future__ import annotations

import sys
from pathlib import Path

from mpi4py import MPI
from test_poreflow_command import REFUSED

from flowsolver.command.command_line import main

comm = MPI.COMM_WORLD
directory, pack = Path(sys.argv[1]), Path(sys.argv[2])
for case, (arguments, _) in REFUSED.items():
    files = {word: str(directory / word.lower()) for word in arguments if word.isupper() and (directory / word.lower()).exists()} | {"PACK": str(pack)}
    statuses = comm.gather(main([files.get(word, word) for word in arguments]))
    if comm.rank == 0:
        print(case, statuses, flush=True)
