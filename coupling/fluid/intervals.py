"""Where the intervals between two updates of a flow end: all of one length."""

from __future__ import annotations

from typing import Protocol


class Intervals(Protocol):
    """Of `begins` and `end_after` the loop of a run asks in each of its turns."""

    def begins(self, step: int) -> bool:
        """Whether an interval begins at this step."""

    def end_after(self, step: int) -> int:
        """The end of the interval in which the step after this one lies; later than the run's end, where that comes first."""


class EvenIntervals:
    """All of `length` steps."""

    def __init__(self, length: int):
        self._length = length

    def begins(self, step: int) -> bool:
        return step % self._length == 0

    def end_after(self, step: int) -> int:
        return (step // self._length + 1) * self._length
