"""One line that tells how far a run is."""

from __future__ import annotations

import os
import sys
import time


class Progress:
    """On a terminal a line that is rewritten, elsewhere a new line every tenth of the way; silent where ``shown`` is false."""

    def __init__(self, label: str, shown: bool):
        self._label, self._shown = label, shown
        # mpirun gives its ranks a terminal of its own, wherever their output goes.
        self._terminal = sys.stdout.isatty() and "OMPI_COMM_WORLD_RANK" not in os.environ
        self._start = self._last = time.monotonic()
        self._start_fraction: float | None = None
        self._next_line = 0.1

    def show(self, fraction: float, text: str) -> None:
        """``fraction``: how much of the way is done, 0 to 1."""
        if not self._shown:
            return
        now = time.monotonic()
        if self._start_fraction is None:
            self._start_fraction = fraction
        due = now - self._last > 0.5 if self._terminal else fraction >= self._next_line
        if not due and fraction < 1.0:
            return
        self._last = now
        while self._next_line <= fraction:
            self._next_line += 0.1
        done = fraction - self._start_fraction
        left = (now - self._start) * (1.0 - fraction) / done if done > 0 else float("nan")
        line = f"{self._label}  {100 * fraction:5.1f} %  {text}  {_clock(left)} left"
        print(f"\r{line:<110}" if self._terminal else line, end="" if self._terminal else "\n", flush=True)

    def finish(self, text: str) -> None:
        """The last line."""
        if self._shown:
            line = f"{self._label}  {text}"
            print(f"\r{line:<110}" if self._terminal else line, flush=True)


def _clock(seconds: float) -> str:
    return "--:--" if seconds != seconds else f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"
