"""Values of grains that changed their order and their rank."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from coupling.grain_order import rearranged


def check(comm) -> None:
    """Grains dealt out in one way, asked for in another, in any order; some ranks may have none."""
    random = np.random.default_rng(3)
    for moved in (0, 5, 60):
        rank = random.integers(0, comm.size, 60)
        after = rank.copy()
        after[:moved] = (after[:moved] + 1) % comm.size
        order = random.permutation(60)
        own, wanted = (np.flatnonzero(where == comm.rank) for where in (rank, after))
        wanted = order[np.isin(order, wanted)]
        value = np.stack([own, own**2, -own], axis=1).astype(float)
        result = rearranged(comm, own.astype(np.int32), value, wanted.astype(np.int32))
        np.testing.assert_array_equal(result, np.stack([wanted, wanted**2, -wanted], axis=1))


def test_one_rank():
    check(MPI.COMM_SELF)


def test_the_same_order_is_not_copied():
    value = np.zeros((3, 3))
    assert rearranged(MPI.COMM_SELF, np.arange(3), value, np.arange(3)) is value


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_several_ranks(mpirun, ranks):
    done = mpirun(ranks, [Path(__file__)])
    assert done.returncode == 0, done.stderr


if __name__ == "__main__":
    sys.exit(check(MPI.COMM_WORLD))
