"""On however many ranks: read each file, and write what was read, or the error, to an npz. Arguments: the npz, the files."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from flowsolver import InputError
from flowsolver.command import lines_of_file
from flowsolver.command.grain_file import read_grains

comm = MPI.COMM_WORLD
# Small, so that blocks end everywhere.
lines_of_file.BLOCK = 1000
result = {}
for path in map(Path, sys.argv[2:]):
    try:
        g = read_grains(comm, path)
    except InputError as error:
        result[f"{path.name} error"] = np.array(comm.allgather(str(error)))
        continue
    parts = comm.allgather((g.id, g.position, g.radius))
    id, position, radius = (np.concatenate(column) for column in zip(*parts))
    result[f"{path.name} id"] = np.sort(id)
    result[f"{path.name} grains"] = np.column_stack([position, radius])[np.argsort(id)]
    result[f"{path.name} shares"] = np.array([len(part[0]) for part in parts])
    result[f"{path.name} box"] = np.zeros(0) if g.box is None else g.box
if comm.rank == 0:
    np.savez(sys.argv[1], **result)
