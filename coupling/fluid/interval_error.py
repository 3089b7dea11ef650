"""How far the pressures that grains felt at the end of an interval were from those that the solve then gave."""

from __future__ import annotations

import numpy as np


class IntervalError:
    """Root mean squares over the volume of all pores, as parts of what pressures change by: the largest root mean square, at the end of any
    interval so far, of the difference from their mean at the start, or, where it is larger, `expected`, Pa. Methods are collective.

    The difference itself is what the forces of an interval lacked at its end; mass and work balance whatever it is.
    """

    def __init__(self, comm, expected: float):
        self._comm = comm
        self._mean_at_start: float | None = None
        self._change = expected
        self._worst = self._final = 0.0

    @property
    def begun(self) -> bool:
        """Whether the pressures at the start of loading are known; the same on all ranks."""
        return self._mean_at_start is not None

    def begin(self, pressure: np.ndarray, volume: np.ndarray) -> None:
        """Take up the pressures (k,), Pa, of this rank's own pores of volumes (k,), m^3, at the start of loading."""
        sums = self._comm.allreduce(np.array([volume @ pressure, volume.sum()]))
        self._mean_at_start = float(sums[0] / sums[1]) if sums[1] > 0.0 else 0.0
        self._change = max(self._change, self._rms(pressure - self._mean_at_start, volume))

    def take(self, solved: np.ndarray, difference: np.ndarray, volume: np.ndarray) -> None:
        """Take up what a solve gave, and its difference from what was felt, (k,) Pa."""
        self._change = max(self._change, self._rms(solved - self._mean_at_start, volume))
        self._final = self._rms(difference, volume)
        self._worst = max(self._worst, self._final)

    @property
    def last(self) -> float:
        """Of the last interval, as a part of the change so far."""
        return self._final / self._change if self._change > 0.0 else 0.0

    @property
    def figures(self) -> dict[str, float]:
        """Worst and last as parts of the change over the whole run, and that change, Pa."""
        parts = (value / self._change if self._change > 0.0 else 0.0 for value in (self._worst, self._final))
        return dict(zip(("worst", "final"), parts)) | {"pressure_change_Pa": self._change}

    def state(self) -> dict[str, float]:
        return {"mean_at_start": self._mean_at_start, "change": self._change, "worst": self._worst, "final": self._final}

    def resume(self, state: dict[str, float]) -> None:
        self._mean_at_start, self._change = state["mean_at_start"], state["change"]
        self._worst, self._final = state["worst"], state["final"]

    def _rms(self, values: np.ndarray, volume: np.ndarray) -> float:
        # Flat cells that overlapping grains fill have a void below 0.
        weight = np.abs(volume)
        sums = self._comm.allreduce(np.array([weight @ values**2, weight.sum()]))
        return float(np.sqrt(sums[0] / sums[1])) if sums[1] > 0.0 else 0.0
