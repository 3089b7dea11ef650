"""The two kinds of error that a user of poreslip meets, and their exit statuses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class PoreslipError(Exception):
    """Anything that ends a run with one message on rank 0 and a non-zero exit status on every rank.

    Under MPI it is raised on all ranks together: whoever finds the trouble on one rank alone agrees on
    it with the others first.
    """

    exit_status = 1


class InputError(PoreslipError):
    """Bad input. The message names the key, its value, what is allowed, and what to do."""

    exit_status = 2


class ComputationError(PoreslipError):
    """A computation that failed. The message names the step and the worst grain or pore."""

    exit_status = 3


@contextmanager
def of_file(path: Path) -> Iterator[None]:
    """Errors of the system that name no file, as that of a full disk, are raised as ones of this file."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
