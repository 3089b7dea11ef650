"""Ctrl-C and SIGTERM as a wish to stop after the current interval."""

from __future__ import annotations

import signal


class StopRequest:
    """Set by SIGINT or SIGTERM while it is entered; a second signal ends the program at once."""

    def __init__(self) -> None:
        self._signal = 0
        self._before: dict[int, object] = {}

    def __enter__(self) -> StopRequest:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _receive(self, number: int, _frame) -> None:
        if self._signal:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        self._signal = number

    def leave_if_received(self) -> None:
        """End the program if a signal came, by way of the blocks that clean up; exit status 128 + signal."""
        if self._signal:
            raise SystemExit(128 + self._signal)

    def agreed(self, comm) -> int:
        """The signal that any rank received, 0 for none; collective."""
        from mpi4py import MPI

        return self._signal if comm.size == 1 else comm.allreduce(self._signal, op=MPI.MAX)
