"""Work-precision figure of a study: error against CPU time, and error against the first parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.ticker as ticker
from matplotlib.patheffects import withStroke

from postproc.error_time import Point, pareto_front, short
from postproc.figure_style import PAGE, Picture, plt, print_style, save

#: Line and marker of each value of the parameters after the first: colours that survive for the colour-blind, markers that survive in grey.
LOOKS = (
    ("#000000", "o", "-"), ("#0072B2", "s", (0, (5, 1.5))), ("#D55E00", "^", (0, (4, 1.2, 1, 1.2))), ("#009E73", "D", (0, (1, 1))),
    ("#CC79A7", "v", (0, (6, 1.5, 1, 1.5, 1, 1.5))), ("#999999", "P", "-"), ("#56B4E9", "X", (0, (3, 1))), ("#E69F00", "<", "-"),
)  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """A place in the right panel: a point, or a row where it stands over what settings are spread over."""

    option: Any
    error: float
    stable: bool
    best: bool = False


def draw(points: Sequence[Point], best: Sequence[Point], given: Sequence[str], tolerance: float, title: str, error_label: str, labels: dict[str, str],
         directory: Path, stem: str, dpi: int = 200) -> Picture:  # fmt: skip
    """Write <stem>.png. best: the recommended points. given: parameters that are no choice. labels: parameter to its name in the figure, in
    the order of the study; the first is the right panel's abscissa."""
    first = next(iter(labels))
    across = first in points[0].options
    others = [key for key in points[0].options if key != first]
    series: dict[str, list[Point]] = {}
    for point in points:
        if not any(row.is_reference for row in point.rows):
            series.setdefault(", ".join(short(point.options[key]) for key in others), []).append(point)
    marks = {name: _marks(line, first, across, best) for name, line in series.items()}
    # A list of numbers, as a pack's sizes, stands by its text.
    options = list({str(mark.option): mark.option for line in marks.values() for mark in line}.values())
    numeric = all(number(option) is not None for option in options)
    with print_style():
        figure, (work, sweep) = plt.subplots(1, 2, figsize=(PAGE, 3.2), sharey=True, layout="constrained")
        for (name, line), (colour, marker, dash) in zip(series.items(), LOOKS * (1 + len(series) // len(LOOKS))):
            look = {"color": colour, "marker": marker, "markersize": 4.5, "linewidth": 1.0}
            shown = [point for point in line if point.counts and point.error > 0.0]
            work.plot([point.cpu_s for point in shown], [point.error for point in shown], linestyle=dash if across and not given else "", label=name or None, **look)
            good = [mark for mark in marks[name] if mark.stable and mark.error > 0.0]
            sweep.plot([_place(mark.option, options, numeric) for mark in good], [mark.error for mark in good], linestyle=dash, **look)
            for point in shown:
                errors = [row.error for row in point.rows if len(point.rows) > 1]
                for axes, place in [(work, point.cpu_s)] + ([(sweep, _place(point.options[first], options, numeric))] if across else []):
                    axes.plot([place] * len(errors), errors, color=colour, marker="_", linestyle="-", linewidth=0.8, markersize=5)
        _scales(work, sweep, [point for line in series.values() for point in line if point.counts], options, numeric)
        if not given:
            _front(work, [point for line in series.values() for point in line if point.error > 0.0], first if across and numeric else None)
        _tolerance(work, sweep, tolerance)
        _failures(sweep, [_place(mark.option, options, numeric) for line in marks.values() for mark in line if not mark.stable])
        ring = {"marker": "o", "markersize": 11, "markerfacecolor": "none", "markeredgecolor": "black", "markeredgewidth": 1.2, "linestyle": ""}
        for point in (point for point in best if point.error > 0.0):
            work.plot(point.cpu_s, point.error, **ring)
        for mark in (mark for line in marks.values() for mark in line if mark.best and mark.error > 0.0):
            sweep.plot(_place(mark.option, options, numeric), mark.error, **ring)
        work.set(xlabel="CPU time, s", ylabel=error_label)
        sweep.set(xlabel=labels[first])
        _legend(figure, work, best, given, others, labels)
        work.set_title(title, loc="left", fontsize=8.5)
        return save(figure, directory, stem, title, dpi, False)


def _marks(line: Sequence[Point], first: str, across: bool, best: Sequence[Point]) -> list[Mark]:
    if across:
        return [Mark(point.options[first], point.error, point.stable, any(point is one for one in best)) for point in line]
    return [Mark(row.spread[first], row.error, row.stable) for point in line for row in point.rows]


def number(value: Any) -> float | None:
    """A parameter's value as a number, also where it is the label of a choice; None where it is none."""
    if isinstance(value, bool | list | dict):
        return None
    try:
        return float(value)
    except ValueError:
        return None


def _place(option: Any, options: Sequence[Any], numeric: bool) -> float:
    """Where an option stands: at its own number, or evenly in the order of the study."""
    return number(option) if numeric else options.index(option)


def _scales(work, sweep, shown: Sequence[Point], options: Sequence[Any], numeric: bool) -> None:
    errors = [row.error for point in shown for row in point.rows if row.error > 0.0]
    if errors:
        work.set_yscale("log")
        _limits(work.set_ylim, errors, 1.8)
        work.set_xscale("log")
        _limits(work.set_xlim, [point.cpu_s for point in shown], 1.3)
    if numeric and all(number(option) > 0 for option in options):
        sweep.set_xscale("log")
        values = sorted(number(option) for option in options)
        if len(values) <= 9 and values[-1] <= 1e3 * values[0]:
            sweep.set_xticks(values, [short(value) for value in values])
            sweep.xaxis.set_minor_locator(ticker.NullLocator())
    elif not numeric:
        names = [short(option) for option in options]
        sweep.set_xticks(range(len(names)), names, rotation=20 if max(map(len, names)) > 10 else 0)
        sweep.margins(x=0.15)
    for axis in (work.xaxis, work.yaxis):
        lowest, highest = axis.get_view_interval()
        axis.set_minor_formatter(ticker.NullFormatter())
        if 0.0 < lowest and highest < 60.0 * lowest:
            # Powers of ten alone would leave one number on such an axis, or none.
            leading = "123456789" if highest < 3.0 * lowest else "125"
            axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(ticker.FuncFormatter(lambda value, _, leading=leading: f"{value:g}" if f"{value:e}"[0] in leading else ""))


def _limits(setter, values: Sequence[float], margin: float) -> None:
    setter(min(values) / margin, max(values) * margin)


def _front(work, shown: Sequence[Point], named: str | None) -> None:
    """The Pareto front as steps: what can be had for a given time. named: parameter whose value stands beside each of its points."""
    front = pareto_front(shown)
    if not front:
        return
    right = work.get_xlim()[1]
    times = [point.cpu_s for point in front] + [right]
    errors = [point.error for point in front] + [front[-1].error]
    work.plot(times, errors, color="0.8", linewidth=5, zorder=0.5, drawstyle="steps-post", solid_joinstyle="miter", label="Pareto front")
    for point in front:
        if named:
            # A rim of the paper's colour keeps it readable where lines cross it.
            label = work.annotate(short(point.options[named]), (point.cpu_s, point.error), xytext=(6, 5), textcoords="offset points", fontsize=6.5, zorder=6)
            label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _tolerance(work, sweep, tolerance: float) -> None:
    low, high = work.get_ylim()
    if low < tolerance < high:
        for axes in (work, sweep):
            axes.axhline(tolerance, color="0.5", linewidth=0.8, linestyle=(0, (2, 2)))
        work.text(0.985, tolerance, "tolerance", transform=work.get_yaxis_transform(), ha="right", va="bottom", fontsize=7, color="0.35")


def _failures(sweep, places: Sequence[float]) -> None:
    """Settings that were refused or broke down, at the top."""
    if places:
        sweep.plot(places, [sweep.get_ylim()[1]] * len(places), "x", color="#D55E00", markersize=7, markeredgewidth=1.6, clip_on=False, zorder=5)
        sweep.set_title("x  refused or not stable", loc="right", fontsize=7, color="#D55E00")


def _legend(figure, work, best: Sequence[Point], given: Sequence[str], others: Sequence[str], labels: dict[str, str]) -> None:
    handles, names = work.get_legend_handles_labels()
    columns = max(1, min(len(names), 110 // (8 + max(map(len, names), default=0))))
    said = []
    if best:
        chosen = "; ".join(f"{labels.get(key, key)}: {short(value)}" for key, value in best[0].options.items())
        said.append("ringed: recommended" + (" for each" if given else f" ({chosen})"))
    said += [", ".join(labels.get(key, key) for key in others)] if others else []
    legend = figure.legend(handles, names, loc="outside lower center", ncols=columns, fontsize=7, title="\n".join(said) or None, title_fontsize=7.5)
    legend.get_title().set_multialignment("center")


def error_text(error: float) -> str:
    """An error for tables."""
    return "" if math.isnan(error) else f"{error:.2g}"
