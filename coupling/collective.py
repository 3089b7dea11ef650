"""Errors found on one rank, raised on all of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from coupling.errors import PoreslipError


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
