"""Work-precision figure of a study: error against CPU time, and error against the first parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.ticker as ticker

from postproc.error_time import Point, pareto_front, short
from postproc.figure_style import PAGE, Picture, plt, print_style, save

#: Line and marker of each value of the parameters after the first: colours that survive for the colour-blind, markers that survive in grey.
LOOKS = (
    ("#000000", "o", "-"), ("#0072B2", "s", (0, (5, 1.5))), ("#D55E00", "^", (0, (4, 1.2, 1, 1.2))), ("#009E73", "D", (0, (1, 1))),
    ("#CC79A7", "v", (0, (6, 1.5, 1, 1.5, 1, 1.5))), ("#999999", "P", "-"), ("#56B4E9", "X", (0, (3, 1))), ("#E69F00", "<", "-"),
)  # fmt: skip


def draw(points: Sequence[Point], best: Point | None, tolerance: float, title: str, error_label: str, labels: dict[str, str],
         directory: Path, stem: str, dpi: int = 200) -> Picture:  # fmt: skip
    """Write <stem>.png. labels: parameter to its name in the figure."""
    shown = [point for point in points if point.counts and point.error > 0.0]
    first, *others = points[0].options
    series: dict[str, list[Point]] = {}
    for point in points:
        series.setdefault(", ".join(short(point.options[key]) for key in others), []).append(point)
    numeric = all(isinstance(point.options[first], int | float) and not isinstance(point.options[first], bool) for point in points)
    with print_style():
        figure, (work, sweep) = plt.subplots(1, 2, figsize=(PAGE, 3.2), sharey=True, layout="constrained")
        for (name, line), (colour, marker, dash) in zip(series.items(), LOOKS * (1 + len(series) // len(LOOKS))):
            good = [point for point in line if point in shown]
            for axes, places in ((work, [point.cpu_s for point in good]), (sweep, [_place(point, first, points, numeric) for point in good])):
                axes.plot(places, [point.error for point in good], color=colour, linestyle=dash, marker=marker, markersize=4.5, linewidth=1.0,
                          label=name or None)  # fmt: skip
                for place, point in zip(places, good):
                    if len(point.rows) > 1:
                        axes.plot([place] * len(point.rows), [row.error for row in point.rows], color=colour, marker="_", linestyle="", markersize=5)
        if numeric:
            for point in shown:
                work.annotate(short(point.options[first]), (point.cpu_s, point.error), xytext=(4, 3), textcoords="offset points", fontsize=6, color="0.3")
        _scales(work, sweep, shown, points, first, numeric)
        _front(work, shown)
        low, high = work.get_ylim()
        _failures(sweep, points, first, numeric, high)
        if low < tolerance < high:
            for axes in (work, sweep):
                axes.axhline(tolerance, color="0.5", linewidth=0.8, linestyle=(0, (2, 2)))
            work.text(0.985, tolerance, "tolerance", transform=work.get_yaxis_transform(), ha="right", va="bottom", fontsize=7, color="0.35")
        if best is not None and best.error > 0.0:
            work.plot(best.cpu_s, best.error, "o", markersize=11, markerfacecolor="none", markeredgecolor="black", markeredgewidth=1.2)
            sweep.plot(_place(best, first, points, numeric), best.error, "o", markersize=11, markerfacecolor="none", markeredgecolor="black",
                       markeredgewidth=1.2)  # fmt: skip
        work.set(xlabel="CPU time, s", ylabel=error_label)
        sweep.set(xlabel=labels.get(first, first))
        _legend(figure, work, best, others, labels)
        work.set_title(title, loc="left", fontsize=8.5)
        return save(figure, directory, stem, title, dpi, False)


def _place(point: Point, first: str, points: Sequence[Point], numeric: bool) -> Any:
    """Where a value of the first parameter stands: at itself, or evenly in the order of the study."""
    if numeric:
        return point.options[first]
    return list(dict.fromkeys(str(one.options[first]) for one in points)).index(str(point.options[first]))


def _scales(work, sweep, shown: Sequence[Point], points: Sequence[Point], first: str, numeric: bool) -> None:
    if shown:
        work.set_yscale("log")
        _limits(work.set_ylim, [row.error for point in shown for row in point.rows if row.error > 0.0], 1.8)
        work.set_xscale("log")
        _limits(work.set_xlim, [point.cpu_s for point in shown], 1.3)
    if numeric and all(point.options[first] > 0 for point in points):
        sweep.set_xscale("log")
        values = sorted({point.options[first] for point in points})
        if len(values) <= 8 and values[-1] < 1e4 * values[0]:
            sweep.set_xticks(values, [short(value) for value in values])
            sweep.xaxis.set_minor_locator(ticker.NullLocator())
    elif not numeric:
        names = list(dict.fromkeys(short(point.options[first]) for point in points))
        sweep.set_xticks(range(len(names)), names, rotation=20 if max(map(len, names)) > 8 else 0)
        sweep.margins(x=0.15)
    for axis in (work.xaxis, work.yaxis):
        lowest, highest = axis.get_view_interval()
        if 0.0 < lowest and highest < 30.0 * lowest:
            # Powers of ten alone would leave one number on such an axis, or none.
            leading = "123456789" if highest < 3.0 * lowest else "125"
            axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(ticker.FuncFormatter(lambda value, _, leading=leading: f"{value:g}" if f"{value:e}"[0] in leading else ""))


def _limits(setter, values: Sequence[float], margin: float) -> None:
    setter(min(values) / margin, max(values) * margin)


def _front(work, shown: Sequence[Point]) -> None:
    """The Pareto front as steps: what can be had for a given time."""
    front = pareto_front(shown)
    if not front:
        return
    right = work.get_xlim()[1]
    times = [point.cpu_s for point in front] + [right]
    errors = [point.error for point in front] + [front[-1].error]
    work.plot(times, errors, color="0.8", linewidth=5, zorder=0.5, drawstyle="steps-post", solid_joinstyle="miter", label="Pareto front")


def _failures(sweep, points: Sequence[Point], first: str, numeric: bool, high: float) -> None:
    """Settings that were refused or broke down, at the top."""
    failed = [point for point in points if not point.stable]
    if failed:
        places = [_place(point, first, points, numeric) for point in failed]
        sweep.plot(places, [high] * len(places), "x", color="#D55E00", markersize=7, markeredgewidth=1.6, clip_on=False, zorder=5)
        sweep.annotate("x: refused or not stable", (0.985, 0.955), xycoords="axes fraction", ha="right", va="top", fontsize=7, color="#D55E00")


def _legend(figure, work, best: Point | None, others: Sequence[str], labels: dict[str, str]) -> None:
    handles, names = work.get_legend_handles_labels()
    if best is not None:
        handles.append(plt.Line2D([], [], marker="o", markersize=9, markerfacecolor="none", markeredgecolor="black", linestyle=""))
        names.append("recommended: " + ", ".join(f"{labels.get(key, key)} {short(value)}" for key, value in best.options.items()))
    figure.legend(handles, names, loc="outside lower center", ncols=min(4, max(1, len(names))), fontsize=7, title=", ".join(labels.get(key, key) for key in others) or None,
                  title_fontsize=7)  # fmt: skip


def error_text(error: float) -> str:
    """An error for tables."""
    return "" if math.isnan(error) else f"{error:.2g}"
