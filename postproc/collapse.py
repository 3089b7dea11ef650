"""How well the strain-rate curves of cases 1 to 3 fall together, as one number for each stress they are drawn against.

The curve of a case is d(vertical strain)/d(strain) against a stress x (the paper's Fig. 6 draws the rate, which is the
same times the constant horizontal rate).  As stress rises and falls again, the curve is read the other way round: x_k(w)
is the stress at which case k first has gone the share w of the way from the early slope to rigid sliding
(onset.way_to_sliding), at every w of LEVELS that all the cases reach.  Averaged over these levels,

    spread   = max(x_1, x_2, x_3) - min(x_1, x_2, x_3)
    distance = the smaller of |x_4 - m| and |x_5 - m|, m the mean of x_1, x_2, x_3; a case 5 that never reaches a level
               lies beyond the largest x that it has reached, and does not count
    collapse = spread / distance

so that 0 is a perfect collapse and 1 says that cases 1 to 3 lie as far apart as from the nearest other case.

A small number alone does not show that the larger pressure rules: where pressure and sigma_n rise together with strain,
sigma_n - p hardly changes, and curves fall together whenever slip begins.  So the number is taken a second time with
cases 2 and 3 put where they would be if the mean pressure ruled, that is with the strain and sigma_n at which case 4
reaches the level and their own pressures at that strain.  Only if that is much larger does the collapse tell the two
apart.

Nor does the rate tell sliding from opening: a block whose pore pressure reaches the total vertical stress on its plates
parts from the other.  The pressure where the curves are read is therefore given over the vertical stress.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .onset import passage_of_level, state, way_to_sliding
from .run_files import Run

LEVELS = tuple(round(0.5 + 0.05 * k, 2) for k in range(9))
"""Shares of the way to rigid sliding at which the curves are compared: 0.5 to 0.9.  Below, blocks that only swell as
their pore pressure rises reach a level as well."""

AGAINST = ("sigma_n_Pa", "sigma_n_minus_max_p_Pa", "sigma_n_minus_mean_p_Pa")

TOGETHER = (1, 2, 3)
APART = (4, 5)


@dataclass(frozen=True)
class Collapse:
    """spread, distance: Pa, averaged over `levels`; apart: whether 4 and 5 lie outside of 1 to 3 on average.

    if_mean_ruled: the collapse number with cases 2 and 3 put where the mean pressure would have them slip.
    without_dry: case 5 never reaches a level.  pressure_ratio: case -> its larger pressure over the vertical stress held,
    averaged over the levels; empty where case.json gives no such stress.
    """

    spread: float
    distance: float
    apart: bool
    levels: tuple[float, ...]
    if_mean_ruled: float
    without_dry: bool
    pressure_ratio: Mapping[int, float]

    @property
    def number(self) -> float:
        """0: perfect; infinite where case 4 or 5 lies at the mean of 1 to 3."""
        return ratio(self.spread, self.distance)


def ratio(spread: float, distance: float) -> float:
    return spread / distance if distance > 0.0 else float("inf")


def at_levels(run: Run) -> dict[float, dict[str, float]]:
    """level -> stresses of AGAINST (Pa) and "strain" where the run first reaches it; levels not reached are left out."""
    way = way_to_sliding(run)
    if way is None:
        return {}
    history_state = state(run.history)
    time = history_state["time_s"]
    found = {}
    for level in LEVELS:
        at = passage_of_level(time, way, level)
        if at is not None:
            found[level] = {name: float(np.interp(at, time, history_state[name])) for name in (*AGAINST, "strain")}
    return found


def as_case_4(run: Run, case_4: Mapping[float, Mapping[str, float]]) -> dict[float, dict[str, float]]:
    """level -> stresses of AGAINST (Pa) with the strain and sigma_n of case 4 and the pressures of `run` at that strain."""
    strain = run.history["strain"].to_numpy(float)
    left, right = run.history["p_left_Pa"].to_numpy(float), run.history["p_right_Pa"].to_numpy(float)
    found = {}
    for level, at in case_4.items():
        p_left, p_right = np.interp(at["strain"], strain, left), np.interp(at["strain"], strain, right)
        sigma_n = at["sigma_n_Pa"]
        found[level] = {"sigma_n_Pa": sigma_n, "sigma_n_minus_max_p_Pa": float(sigma_n - max(p_left, p_right)),
                        "sigma_n_minus_mean_p_Pa": float(sigma_n - 0.5 * (p_left + p_right))}
    return found


def spread_and_distance(curves: Mapping[int, Mapping[float, Mapping[str, float]]], levels: tuple[float, ...],
                        name: str) -> tuple[float, float, bool]:
    """Spread and distance (Pa) of the definition, and whether 4 and 5 lie outside of 1 to 3 on average over the levels."""
    together = np.array([[curves[number][level][name] for number in TOGETHER] for level in levels])
    apart = np.array([[curves[number][level][name] for number in APART if number in curves] for level in levels])
    gaps = np.abs((apart - together.mean(axis=1)[:, None]).mean(axis=0))
    low, high = together.mean(axis=0).min(), together.mean(axis=0).max()
    outside = (apart.mean(axis=0) > high) | (apart.mean(axis=0) < low)
    return float(np.ptp(together, axis=1).mean()), float(gaps.min()), bool(outside.all())


def pressure_ratios(runs: Mapping[int, Run], curves: Mapping[int, Mapping[float, Mapping[str, float]]],
                    levels: tuple[float, ...]) -> dict[int, float]:
    """case -> max(p_L, p_R) over the vertical stress that the loading holds, averaged over the levels."""
    found = {}
    for number, curve in curves.items():
        held = runs[number].case.get("loading", {}).get("vertical_stress_Pa")
        if held:
            pressures = [curve[level]["sigma_n_Pa"] - curve[level]["sigma_n_minus_max_p_Pa"] for level in levels]
            found[number] = float(np.mean(pressures)) / float(held)
    return found


def measure(runs: Mapping[int, Run]) -> dict[str, Collapse] | None:
    """stress of AGAINST -> its collapse, for the runs (case number -> run) on one pack.

    None unless all five cases are there and cases 1 to 4 share a level.
    """
    if any(number not in runs for number in TOGETHER + APART):
        return None
    curves = {number: at_levels(runs[number]) for number in TOGETHER + APART}
    without_dry = not curves[5]
    if without_dry:
        del curves[5]
    levels = tuple(level for level in LEVELS if all(level in curve for curve in curves.values()))
    if not levels:
        return None
    by_mean = curves | {number: as_case_4(runs[number], curves[4]) for number in (2, 3)}
    ratios = pressure_ratios(runs, curves, levels)
    result = {}
    for name in AGAINST:
        spread, distance, apart = spread_and_distance(curves, levels, name)
        result[name] = Collapse(spread, distance, apart, levels, ratio(*spread_and_distance(by_mean, levels, name)[:2]), without_dry, ratios)
    return result
