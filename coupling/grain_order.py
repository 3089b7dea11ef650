"""Values of grains from the order and the ranks in which one list has them to those of another."""

from __future__ import annotations

import numpy as np


def rearranged(comm, id: np.ndarray, value: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values of the grains `wanted`; collective.

    id: (n,) this rank's grains, value: (n, c) theirs, float64. wanted: (m,) ids that this rank is to have; over all ranks the same
    grains as `id`. Returns (m, c). Few grains change their rank between two calls: those go to all ranks.
    """
    from mpi4py import MPI

    if comm.allreduce(len(id) == len(wanted) and bool((id == wanted).all()), op=MPI.LAND):
        return value
    found, place = _lookup(id, wanted)
    result = np.empty((len(wanted), value.shape[1]))
    result[found] = value[place[found]]
    if comm.size > 1:
        leaving = ~np.isin(id, wanted)
        strays = comm.allgather((id[leaving], value[leaving]))
        stray_id, stray_value = (np.concatenate(parts) for parts in zip(*strays))
        missing = np.flatnonzero(~found)
        _, place = _lookup(stray_id, wanted[missing])
        result[missing] = stray_value[place]
    return result


def _lookup(id: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of `wanted` are in `id`, and where; a place means nothing where it is not found."""
    if len(id) == 0:
        return np.zeros(len(wanted), bool), np.zeros(len(wanted), int)
    order = np.argsort(id)
    slot = np.minimum(np.searchsorted(id[order], wanted), len(id) - 1)
    return id[order][slot] == wanted, order[slot]
