"""Figures of histories: strain rate against stress (the paper's Fig. 6), slip on both interfaces, stress against strain,
onsets over packs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator

from . import smoothing
from .figure_style import CASE_MARKER, CASE_STYLE, CASE_WORDS, MEGA, PAGE, Picture, letter, print_style, save
from .onset import SIDES, THRESHOLD, sliding_slope, state
from .results import MeasuredPack, MeasuredRun, MeasuredVariant
from .scene_geometry import is_upright

STRESS_WORDS = {
    "sigma_n_Pa": r"$\sigma_n$ (MPa)",
    "sigma_n_minus_max_p_Pa": r"$\sigma_n - \max(p_L, p_R)$ (MPa)",
    "sigma_n_minus_mean_p_Pa": r"$\sigma_n - (p_L + p_R)/2$ (MPa)",
}


def case_legend(figure: plt.Figure, axes: plt.Axes, columns: int) -> None:
    """One legend for all panels, above them."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.4)


HIGHEST_RATE = 2.5
"""Upper end of the strain-rate axis over the rate of rigid sliding; what is faster is opening, not sliding."""


def rate_of_sliding(measured: MeasuredRun) -> float | None:
    """Vertical strain rate (1/s) of blocks that slide rigidly on the fault at the case's horizontal rate."""
    rate, slope = measured.run.case.get("loading", {}).get("strain_rate_per_s"), sliding_slope(measured.run.case)
    return float(rate) * slope if rate and slope else None


def strain_rate(pack: MeasuredPack, directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """Like Fig. 6: vertical strain rate against sigma_n, sigma_n - max p and sigma_n - mean p."""
    curves = {}
    for number, measured in pack.runs.items():
        time = measured.run.history["time_s"].to_numpy(float)
        curves[number] = time, smoothing.slope(time, measured.run.history["vertical_strain"].to_numpy(float))
    sliding = rate_of_sliding(next(iter(pack.runs.values())))
    fastest = max(float(rate.max()) for _, rate in curves.values())
    top = fastest if sliding is None else min(1.1 * fastest, HIGHEST_RATE * sliding)
    with print_style():
        figure, panels = plt.subplots(1, 3, figsize=(PAGE, 2.9), sharey=True, layout="constrained")
        for number, measured in pack.runs.items():
            time, rate = curves[number]
            onset = measured.onsets.onset
            stresses = state(measured.run.history)
            for axes, name in zip(panels, STRESS_WORDS):
                axes.plot(stresses[name] * MEGA, rate, label=CASE_WORDS[number], **CASE_STYLE[number])
                if onset:
                    at = min(float(np.interp(onset.at["time_s"].value, time, rate)), top)
                    axes.plot(onset.at[name].value * MEGA, at, CASE_MARKER[number], color=CASE_STYLE[number]["color"], clip_on=False,
                              markersize=5, markeredgecolor="white", markeredgewidth=0.7, zorder=5)
        for axes, words in zip(panels, STRESS_WORDS.values()):
            axes.set_xlabel(words)
            if sliding is not None:
                axes.axhline(sliding, color="0.4", linewidth=0.6, linestyle=(0, (1, 2)))
                axes.set_ylim(min(-0.15 * top, 1.1 * min(float(rate.min()) for _, rate in curves.values())), top)
        panels[0].set_ylabel("vertical strain rate (1/s)")
        letter(panels)
        case_legend(figure, panels[0], 5)
        return save(figure, directory, stem, strain_rate_caption(pack, sliding, fastest > top), dpi, pdf)


def strain_rate_caption(pack: MeasuredPack, sliding: float | None, cut: bool) -> str:
    """What is drawn, how it is smoothed, and how well cases 1 to 3 collapse."""
    widths = [2e3 * smoothing.window_width(measured.run.history["time_s"].to_numpy(float)) for measured in pack.runs.values()]
    words = ("Vertical strain rate (extension positive) against (a) the normal stress on the fault, (b) less the larger and (c) less the mean of the two "
             f"pressures, like Fig. 6 of the paper. Slopes of straight lines fitted over windows of {min(widths):.2g} to {max(widths):.2g} ms, "
             f"{200 * smoothing.WINDOW_SHARE:g} % of a run; marks: onsets of slip.")
    if sliding is not None:
        words += f" Dotted: blocks sliding rigidly, {sliding:.3g} 1/s" + ("; faster parts, where the blocks part, are cut off." if cut else ".")
    if pack.collapse is not None:
        numbers = ", ".join(f"{panel} {pack.collapse[name].number:.2f}" for panel, name in zip(("(a)", "(b)", "(c)"), STRESS_WORDS))
        words += f" Collapse of 1-3 (spread over distance of the nearest other case): {numbers}."
    return words


def abscissa(measured: MeasuredRun) -> tuple[str, float, str]:
    """What histories are drawn against: quantity, factor, words.  Strain, but time in the scene that holds the stresses."""
    if is_upright(measured.run):
        return "time_s", 1e3, "time (ms)"
    return "strain", 1e3, r"horizontal strain ($10^{-3}$)"


def slip_histories(pack: MeasuredPack, directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """Slip on the left and the right interface against strain or time, with the onset threshold."""
    with print_style():
        figure, panels = plt.subplots(1, 2, figsize=(PAGE, 2.8), sharey=True, sharex=True, layout="constrained")
        top = 0.0
        for number, measured in pack.runs.items():
            against, factor, words = abscissa(measured)
            for axes, side in zip(panels, SIDES):
                slip = measured.onsets.slips[side]
                axes.plot(measured.run.history[against] * factor, slip.slip * 1e6, label=CASE_WORDS[number], **CASE_STYLE[number])
                top = max(top, slip.largest)
                if slip.onset:
                    at = slip.onset.at[against]
                    axes.errorbar(at.value * factor, THRESHOLD * measured.onsets.diameter * 1e6, xerr=at.uncertainty * factor,
                                  fmt=CASE_MARKER[number], color=CASE_STYLE[number]["color"], markersize=4, capsize=2,
                                  elinewidth=0.8, markeredgecolor="white", markeredgewidth=0.5, zorder=5)
        for axes, side in zip(panels, SIDES):
            axes.axhline(THRESHOLD * measured.onsets.diameter * 1e6, color="0.4", linewidth=0.6, linestyle=(0, (1, 2)))
            axes.set_xlabel(words)
            axes.text(0.03, 0.94, f"{side} interface", transform=axes.transAxes, va="top")
            axes.set_yscale("symlog", linthresh=10.0, linscale=0.6)
            axes.set_ylim(-5.0, max(2e6 * top, 50.0))
            axes.yaxis.set_major_locator(FixedLocator([0, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]))
            axes.yaxis.set_major_formatter("{x:.0f}")
            axes.yaxis.set_minor_locator(NullLocator())
        panels[0].set_ylabel(r"slip ($\mu$m)")
        letter(panels)
        case_legend(figure, panels[0], 5)
        caption = (f"Slip of the left and the right block against the gouge next to it, elastic part taken off; linear below 10 micrometres, "
                   f"logarithmic above. Dotted: the onset's threshold, {THRESHOLD:g} d; marks: onsets with their uncertainty.")
        return save(figure, directory, stem, caption, dpi, pdf)


def stress_strain(pack: MeasuredPack, directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """sigma_n and sigma_n - max p against strain or time, with onsets."""
    names = ("sigma_n_Pa", "sigma_n_minus_max_p_Pa")
    with print_style():
        figure, panels = plt.subplots(1, 2, figsize=(PAGE, 2.8), sharex=True, layout="constrained")
        for number, measured in pack.runs.items():
            stresses = state(measured.run.history)
            onset = measured.onsets.onset
            against, factor, words = abscissa(measured)
            for axes, name in zip(panels, names):
                axes.plot(stresses[against] * factor, stresses[name] * MEGA, label=CASE_WORDS[number], **CASE_STYLE[number])
                if onset:
                    axes.plot(onset.at[against].value * factor, onset.at[name].value * MEGA, CASE_MARKER[number],
                              color=CASE_STYLE[number]["color"], markersize=5, markeredgecolor="white", markeredgewidth=0.7, zorder=5)
        for axes, name in zip(panels, names):
            axes.set_xlabel(words)
            axes.set_ylabel(STRESS_WORDS[name])
        letter(panels)
        case_legend(figure, panels[0], 5)
        caption = "Normal stress on the fault (a) and less the larger pressure (b), smoothed; marks are onsets of slip."
        return save(figure, directory, stem, caption, dpi, pdf)


ONSET_PANELS = (
    ("strain", 1e3, r"onset strain ($10^{-3}$)"),
    ("sigma_n_Pa", MEGA, STRESS_WORDS["sigma_n_Pa"]),
    ("sigma_n_minus_max_p_Pa", MEGA, STRESS_WORDS["sigma_n_minus_max_p_Pa"]),
    ("sigma_n_minus_mean_p_Pa", MEGA, STRESS_WORDS["sigma_n_minus_mean_p_Pa"]),
)


def onset_values(measured: Mapping[int, MeasuredRun], name: str, factor: float) -> tuple[list[int], list[float], list[float]]:
    """Cases that slip, their onset in quantity `name` and its uncertainty, times `factor`."""
    slipping = {number: one.onsets.onset for number, one in measured.items() if one.onsets.onset}
    return (list(slipping), [onset.at[name].value * factor for onset in slipping.values()],
            [onset.at[name].uncertainty * factor for onset in slipping.values()])


def onsets_over_packs(variant: MeasuredVariant, directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """Onsets of every case and pack with their uncertainties, and the mean over packs."""
    with print_style():
        figure, panels = plt.subplots(1, 4, figsize=(PAGE, 2.4), layout="constrained")
        offsets = np.linspace(-0.25, 0.25, len(variant.packs)) if len(variant.packs) > 1 else np.zeros(1)
        upright = any(is_upright(one.run) for pack in variant.packs for one in pack.runs.values())
        for axes, (name, factor, words) in zip(panels, (("time_s", 1e3, "onset time (ms)"), *ONSET_PANELS[1:]) if upright else ONSET_PANELS):
            collected: dict[int, list[float]] = {}
            for pack, offset in zip(variant.packs, offsets):
                numbers, values, errors = onset_values(pack.runs, name, factor)
                for number, value, error in zip(numbers, values, errors):
                    collected.setdefault(number, []).append(value)
                    axes.errorbar(number + offset, value, yerr=error, fmt=CASE_MARKER[number], color=CASE_STYLE[number]["color"],
                                  markersize=3.5, capsize=1.5, elinewidth=0.7, markeredgewidth=0.7)
            for number, values in collected.items():
                if len(values) > 1:
                    axes.plot([number - 0.38, number + 0.38], [np.mean(values)] * 2, color="black", linewidth=0.9)
            axes.set_xlabel("case")
            axes.set_ylabel(words)
            axes.set_xticks(list(variant.case_numbers))
            axes.set_xlim(0.4, 5.6)
            axes.margins(y=0.1)
        letter(panels)
        packs = f"{len(variant.packs)} packs side by side, line: their mean" if len(variant.packs) > 1 else "one pack"
        caption = f"Onset of slip on the faster interface, case by case ({packs}; bars: stated uncertainty)."
        return save(figure, directory, stem, caption, dpi, pdf)
