"""Intervals between two solves of a two-way flow as long as the error allows that the last one made. Imported only by a run with
flow.interval_tolerance.

The error of an interval is the difference between the pressures that the grains felt at its end and those that the solve then gave. It
grows as the length to the power of 2 (split "predicted") or 1 ("undrained"), which tells how long an interval with the wanted error is.
"""

from __future__ import annotations

import math

from coupling.case.run_case import RunCase

#: Power of an interval's length with which its error grows, by flow.split.
ORDER = {"undrained": 1, "predicted": 2}
#: What the next interval is to keep of the tolerance, its error being an estimate; and how much longer an interval may be than the one before.
SAFETY, GROWTH = 0.8, 2.0
#: The first interval over the longest: nothing is known of its error.
FIRST = 1.0 / 8.0


class FollowingIntervals:
    """Intervals end where a line of the history is due, and with it every checkpoint, and at the end of loading: what is left up to there is
    shared out evenly."""

    def __init__(self, case: RunCase):
        self._tolerance, self._order = case.flow.interval_tolerance, ORDER[case.flow.split]
        self._longest, self._last_step, self._every = case.flow.interval_steps, case.loading_steps, case.output.history_interval_steps
        #: Steps that the coming interval should have, no whole number; where the present one began and ends; and the extremes of those that ended.
        self._wanted = max(1.0, FIRST * self._longest)
        self._began, self._end = -1, 0
        self._shortest_made, self._longest_made = 0, 0

    def begins(self, step: int) -> bool:
        return not self._began < step < self._end

    def end_after(self, step: int) -> int:
        return self._end

    def begin(self, step: int) -> None:
        """Fix where the interval ends that begins at this step."""
        left = min(self._last_step, (step // self._every + 1) * self._every) - step
        self._began, self._end = step, step + left // math.ceil(left / self._wanted)

    def ends(self, step: int) -> bool:
        return step >= self._end

    def learn(self, error: float) -> None:
        """Take up the error of the interval that has ended, as a part of all that pressures changed by."""
        length = self._end - self._began
        self._shortest_made, self._longest_made = min(self._shortest_made or length, length), max(self._longest_made, length)
        # An interval that output cut short does not hold back those that come: growth is that of what was wanted.
        allowed = SAFETY * length * (self._tolerance / error) ** (1.0 / self._order) if error > 0.0 else math.inf
        self._wanted = max(1.0, min(allowed, GROWTH * self._wanted, float(self._longest)))

    @property
    def lengths(self) -> dict[str, int]:
        """Steps of the shortest and of the longest interval so far."""
        return {"shortest_interval_steps": self._shortest_made, "longest_interval_steps": self._longest_made}

    def state(self) -> dict[str, float]:
        """What a checkpoint, which falls on the end of an interval, has to hold."""
        return {"wanted": self._wanted, "shortest": self._shortest_made, "longest": self._longest_made}

    def resume(self, state: dict[str, float]) -> None:
        self._wanted, self._shortest_made, self._longest_made = state["wanted"], state["shortest"], state["longest"]
