"""Onset of slip: the definition, its uncertainty, and three other definitions to hold against it.

Definition.  u(t) is the mean tangential displacement of a block against the gouge grains next to it, t the time since
the start of the loading.
1. Elastic part: u grows with the shear stress on the fault before anything slides.  A straight line in that stress,
   (sigma_h - sigma_v)/2 sin(2 dip), is fitted to u over the first half of the time in which u first reaches 0.0025 d (d
   the mean grain diameter) and taken off over the whole history; where that stress does not change (an upright fault), the
   mean is.  What is left is the slip s.  (A line in time would go on growing when the stress no longer does, and hide slip.)
2. Onset: the time at which s passes 0.005 d, by linear interpolation between samples.  Where noise makes s pass more
   than once, the last passage before s has reached twice the threshold counts.
3. Uncertainty: half the range between the passages of 0.0025 d and 0.01 d, half a sampling interval and the noise of s
   (with the error of the extrapolated line) over its slope, added in quadrature.  Strain and stresses at the onset are
   read off the history at that time (stresses smoothed, smoothing.py); their uncertainty is half their range between
   the passages, their change over the last two terms, and their own noise, added in quadrature.
The faster interface is the one whose onset comes first.

The other definitions: u itself, elastic part and all, passes 0.005 d on either interface; the largest smoothed sigma_n;
the time at which d(vertical strain)/d(strain) has gone half of the way from its early value to that of rigid sliding on
the fault.  Compression is positive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from . import smoothing
from .run_files import Run, mean_diameter

THRESHOLD = 0.005
"""Slip at onset over the mean grain diameter; 10 micrometres for d = 2 mm."""

THRESHOLDS = (0.0025, THRESHOLD, 0.01)
"""The range over which the threshold's choice is tried."""

SIDES = ("left", "right")

QUANTITIES = ("strain", "time_s", "sigma_n_Pa", "sigma_n_minus_max_p_Pa", "sigma_n_minus_mean_p_Pa")
"""What an onset is given in."""


@dataclass(frozen=True)
class Quantity:
    value: float
    uncertainty: float


@dataclass(frozen=True)
class Onset:
    """One onset.  at: QUANTITIES -> value and uncertainty; at_threshold: threshold (in d) -> QUANTITIES -> value.

    measurement: QUANTITIES -> the uncertainty without the threshold's part, for comparing runs at equal threshold.
    cut_short: the run ended before 0.01 d was reached, the uncertainty is that of the thresholds reached.
    """

    at: Mapping[str, Quantity]
    at_threshold: Mapping[float, Mapping[str, float]]
    measurement: Mapping[str, float]
    cut_short: bool = False


@dataclass(frozen=True)
class Slip:
    """One interface.  slip: (n,) float64, m, elastic part taken off; noise: m; onset: None when it did not slip.

    elastic_m_per_Pa: elastic displacement for each Pa of shear stress on the fault.
    """

    side: str
    slip: np.ndarray
    elastic_m_per_Pa: float
    noise: float
    onset: Onset | None

    @property
    def largest(self) -> float:
        return float(self.slip.max())


@dataclass(frozen=True)
class RunOnsets:
    """All onsets of a run.  faster: "left", "right" or None (no slip); time: (n,) float64, s.

    as_measured, peak_stress, strain_rate: the other definitions, None where the run shows no such thing.
    """

    diameter: float
    time: np.ndarray
    slips: Mapping[str, Slip]
    faster: str | None
    as_measured: Onset | None
    peak_stress: Onset | None
    strain_rate: Onset | None

    @property
    def onset(self) -> Onset | None:
        return self.slips[self.faster].onset if self.faster else None


def state(history: pd.DataFrame) -> dict[str, np.ndarray]:
    """QUANTITIES -> (n,) float64; stresses are smoothed, strain and time are not."""
    time = history["time_s"].to_numpy(float)
    sigma_n = history["sigma_n_Pa"].to_numpy(float)
    p_left, p_right = history["p_left_Pa"].to_numpy(float), history["p_right_Pa"].to_numpy(float)
    return {
        "strain": history["strain"].to_numpy(float),
        "time_s": time,
        "sigma_n_Pa": smoothing.smooth(time, sigma_n),
        "sigma_n_minus_max_p_Pa": smoothing.smooth(time, sigma_n - np.maximum(p_left, p_right)),
        "sigma_n_minus_mean_p_Pa": smoothing.smooth(time, sigma_n - 0.5 * (p_left + p_right)),
    }


def passage(time: np.ndarray, slip: np.ndarray, threshold: float) -> float | None:
    """Time at which `slip` passes `threshold` for good (see the definition), None when it does not."""
    reached = np.flatnonzero(slip >= 2.0 * threshold)
    end = int(reached[0]) if reached.size else int(np.argmax(slip))
    if slip[end] < threshold:
        return None
    below = np.flatnonzero(slip[:end] < threshold)
    if not below.size:
        return float(time[0])
    before = int(below[-1])
    share = (threshold - slip[before]) / (slip[before + 1] - slip[before])
    return float(time[before] + share * (time[before + 1] - time[before]))


@dataclass(frozen=True)
class ElasticLine:
    """u = intercept + slope * stress over the first `count` samples; noise: their standard deviation about it, m."""

    intercept: float
    slope: float
    noise: float
    count: int
    centre: float
    spread: float

    def error(self, stress: float) -> float:
        """Standard error of the line at `stress`, m."""
        away = (stress - self.centre) / self.spread if self.spread > 0.0 else 0.0
        return self.noise * float(np.sqrt(1.0 / self.count + away ** 2))


def shear_stress(run: Run) -> np.ndarray:
    """(n,) Pa: smoothed shear stress that the walls put on the fault, (sigma_h - sigma_v)/2 sin(2 dip)."""
    history = run.history
    horizontal = 0.5 * (history["sigma_h_left_Pa"] + history["sigma_h_right_Pa"]).to_numpy(float)
    difference = horizontal - history["sigma_v_Pa"].to_numpy(float)
    dip = np.radians(float(run.case["fault"]["dip_degrees"]))
    # Upright, sin(2 dip) is 0 but for rounding.
    share = 0.5 * np.sin(2.0 * dip) if abs(np.cos(dip)) > 1e-9 else 0.0
    return share * smoothing.smooth(history["time_s"].to_numpy(float), difference)


def elastic_line(time: np.ndarray, stress: np.ndarray, displacement: np.ndarray, diameter: float) -> ElasticLine:
    """The line of step 1 of the definition through `displacement` (n,), m, over `stress` (n,), Pa."""
    first = passage(time, displacement - displacement[0], THRESHOLDS[0] * diameter)
    last = time[0] + 0.5 * ((time[-1] if first is None else first) - time[0])
    count = min(max(int(np.searchsorted(time, last, side="right")), 4), len(time) - 1)
    x, y = stress[:count], displacement[:count]
    centre = float(x.mean())
    sum_xx = float(np.sum((x - centre) ** 2))
    slope = float(np.sum((x - centre) * y) / sum_xx) if sum_xx > 0.0 else 0.0
    intercept = float(y.mean() - slope * centre)
    residual = y - intercept - slope * x
    deviation = float(np.sqrt(np.sum(residual ** 2) / max(count - 2, 1)))
    return ElasticLine(intercept, slope, deviation, count, centre, float(np.sqrt(sum_xx)))


def read_off(history_state: Mapping[str, np.ndarray], noise: Mapping[str, float], time_at: float,
             time_error: float, others: Mapping[float, float], cut_short: bool = False) -> Onset:
    """The onset at time `time_at` known to `time_error`; others: threshold -> time of its passage."""
    time = history_state["time_s"]
    low, high = min(others.values()), max(others.values())
    between = time[(time > low) & (time < high)]
    path = np.concatenate(([low, time_at, high], between))
    at, measurement = {}, {}
    for name in QUANTITIES:
        values = np.interp(path, time, history_state[name])
        near = np.interp([time_at - time_error, time_at + time_error], time, history_state[name])
        own = float(np.hypot(0.5 * abs(near[1] - near[0]), noise[name]))
        if name == "time_s":
            own = time_error
        measurement[name] = own
        value = time_at if name == "time_s" else float(np.interp(time_at, time, history_state[name]))
        at[name] = Quantity(value, float(np.hypot(0.5 * (values.max() - values.min()), own)))
    at_threshold = {threshold: {name: float(np.interp(where, time, history_state[name])) for name in QUANTITIES}
                    for threshold, where in others.items()}
    return Onset(at, at_threshold, measurement, cut_short)


def slip_of(run: Run, side: str, history_state: Mapping[str, np.ndarray], noise: Mapping[str, float],
            sign: float, diameter: float) -> Slip:
    """Steps 1 to 3 of the definition for the interface on `side`; sign: +1 or -1, the sense of the fault's slip."""
    time = history_state["time_s"]
    displacement = sign * run.history[f"slip_{side}_m"].to_numpy(float)
    stress = shear_stress(run)
    line = elastic_line(time, stress, displacement, diameter)
    slip = displacement - line.intercept - line.slope * stress
    passages = {threshold: passage(time, slip, threshold * diameter) for threshold in THRESHOLDS}
    if passages[THRESHOLD] is None:
        return Slip(side, slip, line.slope, line.noise, None)
    time_at = passages[THRESHOLD]
    after = min(max(int(np.searchsorted(time, time_at)), 1), len(time) - 1)
    interval = time[after] - time[after - 1]
    steepness = np.interp(time_at, time, smoothing.slope(time, slip))
    error = np.hypot(line.noise, line.error(float(np.interp(time_at, time, stress)))) / max(steepness, 1e-3 * abs(slip).max() / np.ptp(time))
    known = {threshold: where for threshold, where in passages.items() if where is not None}
    onset = read_off(history_state, noise, time_at, float(np.hypot(0.5 * interval, error)), known,
                     cut_short=len(known) < len(THRESHOLDS))
    return Slip(side, slip, line.slope, line.noise, onset)


def sliding_slope(case: Mapping[str, Any]) -> float | None:
    """d vertical strain / d horizontal strain when the blocks slide rigidly on the fault: tan(dip) Lx / Lz.

    None where case.json gives no box and dip, where the fault is upright and in scenes that hold the strain.
    """
    try:
        box, dip = case["pack"]["box_m"], float(case["fault"]["dip_degrees"])
        if case["scene"] == "supplement" or not 0.0 < dip < 85.0:
            return None
        return float(np.tan(np.radians(dip)) * box[0] / box[2])
    except (KeyError, TypeError, IndexError, ValueError, ZeroDivisionError):
        return None


def vertical_slope(history: pd.DataFrame) -> np.ndarray:
    """d vertical strain / d horizontal strain, (n,), over twice the smoothing window."""
    time = history["time_s"].to_numpy(float)
    return (smoothing.slope(time, history["vertical_strain"].to_numpy(float))
            / smoothing.slope(time, history["strain"].to_numpy(float)))


def way_to_sliding(run: Run) -> np.ndarray | None:
    """(n,): how far d(vertical strain)/d(strain) has gone from its early value (0) to that of rigid sliding (1).

    The early value is the median over the first tenth of the time.  None where sliding_slope is.
    """
    rigid = sliding_slope(run.case)
    if rigid is None:
        return None
    slope = vertical_slope(run.history)
    time = run.history["time_s"].to_numpy(float)
    early = float(np.median(slope[time <= time[0] + 0.1 * (time[-1] - time[0])]))
    return (slope - early) / (rigid - early)


def passage_of_level(time: np.ndarray, value: np.ndarray, level: float) -> float | None:
    """Time at which `value` first passes `level` upwards to stay above it for SMALLEST_WINDOW samples, or None."""
    above = value >= level
    held = smoothing.SMALLEST_WINDOW
    for index in np.flatnonzero(above):
        if (index and above[index - 1]) or index + held > len(above) or not above[index:index + held].all():
            continue
        if index == 0:
            return float(time[0])
        share = (level - value[index - 1]) / (value[index] - value[index - 1])
        return float(time[index - 1] + share * (time[index] - time[index - 1]))
    return None


def rate_onset(run: Run, history_state: Mapping[str, np.ndarray], noise: Mapping[str, float]) -> Onset | None:
    """Half of the way from the early slope of the vertical strain to rigid sliding, uncertainty from 1/4 and 3/4."""
    way = way_to_sliding(run)
    if way is None:
        return None
    time = history_state["time_s"]
    passages = {share: passage_of_level(time, way, share) for share in (0.25, 0.5, 0.75)}
    if passages[0.5] is None:
        return None
    known = {share: where for share, where in passages.items() if where is not None}
    return read_off(history_state, noise, passages[0.5], 0.5 * smoothing.window_width(time), known, len(known) < 3)


def peak_onset(history_state: Mapping[str, np.ndarray], noise: Mapping[str, float]) -> Onset | None:
    """The largest smoothed sigma_n, uncertainty from where it is within its noise (and 0.5 %) of the peak.

    None when sigma_n does not fall by that much before the run ends.
    """
    time, sigma_n = history_state["time_s"], history_state["sigma_n_Pa"]
    top = int(np.argmax(sigma_n))
    low_enough = sigma_n < sigma_n[top] - max(2.0 * noise["sigma_n_Pa"], 0.005 * abs(sigma_n[top]))
    before, after = np.flatnonzero(low_enough[:top]), np.flatnonzero(low_enough[top:])
    if not after.size:
        return None
    first, last = time[before[-1]] if before.size else time[0], time[top + after[0]]
    interval = 0.5 * float(time[top + 1] - time[max(top - 1, 0)])
    return read_off(history_state, noise, float(time[top]), interval, {-1.0: float(first), 1.0: float(last)})


def as_measured_onset(displacements: Sequence[np.ndarray], diameter: float, history_state: Mapping[str, np.ndarray],
                      noise: Mapping[str, float]) -> Onset | None:
    """The first of the interfaces' displacements (n,), m, to pass 0.005 d, without taking off an elastic part."""
    time = history_state["time_s"]
    found = []
    for displacement in displacements:
        passages = {threshold: passage(time, displacement, threshold * diameter) for threshold in THRESHOLDS}
        if passages[THRESHOLD] is not None:
            found.append({threshold: where for threshold, where in passages.items() if where is not None})
    if not found:
        return None
    known = min(found, key=lambda passages: passages[THRESHOLD])
    interval = float(np.median(np.diff(time)))
    return read_off(history_state, noise, known[THRESHOLD], 0.5 * interval, known, len(known) < len(THRESHOLDS))


def find_onsets(run: Run) -> RunOnsets:
    """All onsets of `run`."""
    diameter = mean_diameter(run.case, run.directory / "case.json")
    history_state = state(run.history)
    time = history_state["time_s"]
    sigma_noise = smoothing.noise(time, run.history["sigma_n_Pa"].to_numpy(float))
    noise = {name: sigma_noise if name.startswith("sigma") else 0.0 for name in QUANTITIES}
    ends = [float(run.history[f"slip_{side}_m"].iloc[-1]) for side in SIDES]
    sign = 1.0 if max(ends, key=abs) >= 0.0 else -1.0
    slips = {side: slip_of(run, side, history_state, noise, sign, diameter) for side in SIDES}
    slipped = [side for side in SIDES if slips[side].onset]
    faster = min(slipped, key=lambda side: slips[side].onset.at["time_s"].value) if slipped else None
    displacements = [sign * run.history[f"slip_{side}_m"].to_numpy(float) for side in SIDES]
    return RunOnsets(diameter, time, slips, faster, as_measured_onset(displacements, diameter, history_state, noise), peak_onset(history_state, noise),
                     rate_onset(run, history_state, noise))
