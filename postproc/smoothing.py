"""Local straight-line fits: the one kind of smoothing used for stresses and rates."""

from __future__ import annotations

import numpy as np

WINDOW_SHARE = 0.02
"""Full width of the smoothing window, as a share of the duration of the run."""

SMALLEST_WINDOW = 5
"""Samples that a window holds at least."""


def window_width(time: np.ndarray) -> float:
    """Full window width (s) for samples at `time` (n,): WINDOW_SHARE of the duration, SMALLEST_WINDOW samples."""
    steps = np.diff(time)
    return float(max(WINDOW_SHARE * (time[-1] - time[0]), (SMALLEST_WINDOW - 1) * np.median(steps) * (1.0 + 1e-9)))


def local_line(time: np.ndarray, value: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope (n,), (n,) at each of the n times of the least-squares line through the samples within width/2.

    Near the ends the window is one-sided; a window always holds SMALLEST_WINDOW samples (or all, if there are fewer).
    """
    n = len(time)
    held = min(SMALLEST_WINDOW, n)
    first = np.searchsorted(time, time - 0.5 * width, side="left")
    last = np.searchsorted(time, time + 0.5 * width, side="right")
    lacking = last - first < held
    centred = np.clip(np.arange(n) - held // 2, 0, n - held)
    first = np.where(lacking, centred, first)
    last = np.where(lacking, centred + held, last)
    level, scale = value.mean(), max(time[-1] - time[0], np.finfo(float).tiny)
    x, y = (time - time[0]) / scale, value - level
    sums = [np.concatenate(([0.0], np.cumsum(term))) for term in (np.ones(n), x, y, x * x, x * y)]
    count, sx, sy, sxx, sxy = (total[last] - total[first] for total in sums)
    slope = (count * sxy - sx * sy) / (count * sxx - sx * sx)
    return level + (sy + slope * (count * x - sx)) / count, slope / scale


def smooth(time: np.ndarray, value: np.ndarray) -> np.ndarray:
    """`value` (n,) smoothed over the standard window."""
    return local_line(time, value, window_width(time))[0]


def slope(time: np.ndarray, value: np.ndarray) -> np.ndarray:
    """d value / dt (n,) over twice the standard window: a slope is noisier than a value."""
    return local_line(time, value, 2.0 * window_width(time))[1]


def noise(time: np.ndarray, value: np.ndarray) -> float:
    """Standard deviation of `value` (n,) about its smoothed curve, by the median so that a jump does not count."""
    return float(1.4826 * np.median(np.abs(value - smooth(time, value))))
