"""The ways in which reading a run can fail; each message names the file, what is wrong and what to do."""

from __future__ import annotations


class RunFileError(Exception):
    """A run's file cannot be used.  Shown as one message; the command ends with `exit_status`."""

    exit_status = 2

    def __init__(self, path: object, problem: str, remedy: str) -> None:
        super().__init__(f"{path}: {problem}; {remedy}")


class MissingFile(RunFileError):
    """The file or directory is not there."""


class TruncatedFile(RunFileError):
    """The file ends before its content does."""


class ForeignFile(RunFileError):
    """The file is there and whole, but it is not what a run writes."""


class BadOption(Exception):
    """An option of the command has a value it cannot work with."""

    exit_status = 2
