"""On three ranks: rows are sorted into even shares, and files are written from one rank's part after another. Argument: the files' directory.
Run by test_poreflow_files.py."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from flowsolver.command import files
from flowsolver.command.sorted_over_ranks import sorted_over_ranks

comm = MPI.COMM_WORLD
key = np.random.default_rng(0).permutation(3000) ** 2
begin, end = [(0, 2900), (2900, 2900), (2900, 3000)][comm.rank]
number, column = sorted_over_ranks(comm, key[begin:end], np.stack([key, 2.0 * key], axis=1)[begin:end])
assert (np.diff(number) > 0).all() and (column == np.stack([number, 2.0 * number], axis=1)).all()
edges = comm.allgather((number[0], number[-1], len(number)))
assert edges[0][1] < edges[1][0] and edges[1][1] < edges[2][0]
assert sum(n for *_, n in edges) == 3000 and all(900 < n < 1100 for *_, n in edges), edges


counts = (0, 5, 70)
directory, own = Path(sys.argv[1]), counts[comm.rank]


def save(path: Path, column: files.Column) -> None:
    assert column.shape == (sum(counts),)
    with open(path, "wb") as file:
        for rank, part in enumerate(column):
            assert len(part) == counts[rank]
            file.write(part)


files.write(comm, directory / "parts", save, np.full(own, comm.rank, np.uint8))
files.write_pressures(comm, directory / "p.vtu", np.arange(own)[:, None] * np.array([1.0, 0.0, 0.0]), np.full(own, float(comm.rank)))
