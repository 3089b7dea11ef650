"""Rows of arrays, brought into the order of a key over all ranks."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

#: Samples that each rank's share of the keys is cut by, for each rank: shares come out even to about one in so many.
SAMPLES = 8


def sorted_over_ranks(comm: MPI.Comm, key: NDArray, *columns: NDArray) -> list[NDArray]:
    """The key and the columns, (n, ...) each on every rank, in the order of the key: the rows of lower ranks come first. No two keys are
    alike. Collective.

    A parallel sort by regular sampling (Shi and Schaeffer 1992, J. Parallel Distrib. Comput. 14, 361): the ranks' parts are about even.
    """
    order = np.argsort(key)
    rows = [column[order] for column in (key, *columns)]
    if comm.size == 1:
        return rows
    step = max(1, comm.allreduce(len(key)) // (SAMPLES * comm.size**2))
    samples = np.sort(np.concatenate(comm.allgather(rows[0][step // 2 :: step])))
    # Each rank but the last holds the keys up to its own.
    last = samples[len(samples) * np.arange(1, comm.size) // comm.size]
    ends = np.searchsorted(rows[0], last, side="right")
    received = [np.concatenate(comm.alltoall(np.split(column, ends))) for column in rows]
    order = np.argsort(received[0])
    return [column[order] for column in received]
