"""What each rank of a script is told, for the test that runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from flowsolver import InputError


def told(call: Callable[[], Any], kind: type[Exception] = InputError) -> list[str]:
    """The message of the error of this kind with which a collective call ends on each rank, "no error" where it ends without one."""
    try:
        call()
        said = "no error"
    except kind as error:
        said = str(error)
    return MPI.COMM_WORLD.allgather(said)
