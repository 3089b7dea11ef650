"""What some ranks do for all of them: errors found on one rank, raised on all; work of the first few, known to all."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from coupling.errors import PoreslipError
from coupling.signals import StopRequest

#: Between two looks of the ranks that wait, s: they leave their cores to those that work.
LOOK_S = 0.01


@contextmanager
def raised_together(comm) -> Iterator[None]:
    """Run a block without collective calls; if it raises a PoreslipError or an OSError on any rank, every rank raises the error of the lowest one."""
    error: Exception | None = None
    try:
        yield
    except (PoreslipError, OSError) as raised:
        error = raised
    if comm.size == 1:
        if error is not None:
            raise error
        return
    errors = comm.allgather(error)
    for other in errors:
        if other is not None:
            raise other


def on_first_ranks(comm, count: int, work: Callable[[Any], Any]) -> Any:
    """What `work(communicator of the first count ranks)` returns on rank 0, on all ranks; what it raises there, or a signal that ends it, ends all."""
    if count == comm.size:
        return work(comm)
    group = comm.Split(color=int(comm.rank >= count), key=comm.rank)
    outcome: Any = None
    if comm.rank < count:
        try:
            outcome = work(group)
        except (PoreslipError, OSError, SystemExit) as error:
            outcome = error
            raise
        finally:
            for rank in range(count, comm.size) if comm.rank == 0 else ():
                comm.send(outcome, dest=rank)
    else:
        with StopRequest() as stop:
            while not comm.iprobe(source=0):
                time.sleep(LOOK_S)
            outcome = comm.recv(source=0)
            if isinstance(outcome, BaseException):
                raise outcome
            stop.leave_if_received()
    # Not after an error, when the other ranks may be anywhere.
    group.Free()
    return outcome
