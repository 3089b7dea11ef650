"""Error against run time: rows of a study, its Pareto front, and the setting to recommend."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from postproc.observables import NotObserved, Observed, ResultFiles, report


@dataclass(frozen=True)
class Cost:
    """CPU and wall seconds over all ranks, steps, and iterations of the linear solver."""

    cpu_s: float
    wall_s: float
    steps: int
    iterations: int


@dataclass(frozen=True)
class Row:
    """One setting. options: parameter to value; spread: those over which settings are taken together.

    value: the observable, NaN for a curve and where there is none. error: NaN where there is none. reason: why it is not stable, or why
    it has no error. revision: of the code that carried it out. is_reference: it is the run that the others are held against.
    """

    options: Mapping[str, Any]
    spread: Mapping[str, Any]
    value: float
    error: float
    cost: Cost
    stable: bool
    reason: str
    revision: str = ""
    is_reference: bool = False


@dataclass(frozen=True)
class Point:
    """Settings that differ in what they are spread over alone: the largest error, the mean costs, stable where all are."""

    options: Mapping[str, Any]
    rows: tuple[Row, ...]

    @property
    def error(self) -> float:
        return max((row.error for row in self.rows), key=lambda error: math.inf if math.isnan(error) else error)

    @property
    def smallest_error(self) -> float:
        return min(row.error for row in self.rows)

    @property
    def value(self) -> tuple[float, float]:
        """Mean and standard deviation of the observable."""
        values = np.array([row.value for row in self.rows])
        return float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else 0.0

    @property
    def cpu_s(self) -> float:
        return sum(row.cost.cpu_s for row in self.rows) / len(self.rows)

    @property
    def wall_s(self) -> float:
        return sum(row.cost.wall_s for row in self.rows) / len(self.rows)

    @property
    def stable(self) -> bool:
        return all(row.stable for row in self.rows)

    @property
    def counts(self) -> bool:
        """Whether it can be recommended: it was carried out, has an error, and is not what errors are held against."""
        return self.stable and math.isfinite(self.error) and not any(row.is_reference for row in self.rows)

    def __str__(self) -> str:
        return ", ".join(f"{key} = {short(value)}" for key, value in self.options.items())


def short(value: Any) -> str:
    """A parameter's value in tables and figures."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def cost(files: ResultFiles, wall_s: float, cpu_s: float) -> Cost:
    """What a run took by its own report, without what is made once for all runs; wall_s, cpu_s: of its process, where it left none."""
    try:
        found = report(files.directory)
    except (NotObserved, ValueError):
        return Cost(cpu_s, wall_s, 0, 0)
    if "loading_cpu_s" in found:
        return Cost(found["loading_cpu_s"], found["loading_wall_s"], int(found["steps"]), int(found.get("solver", {}).get("iterations", 0)))
    # Of poreflow: the computation without the start of the process, and without the files that a study reads.
    cpu_s, wall_s = found["cpu_seconds"] - found.get("cpu_seconds_files", 0.0), found["seconds"]["total"] - found["seconds"].get("files", 0.0)
    return Cost(float(cpu_s), float(wall_s), int(found.get("steps", 1)), int(found["iterations"]))


def error_of(observed: Observed, expected: Observed, relative: bool) -> float:
    """Root mean square of the difference, over that of what is expected if `relative`; NotObserved, with the reason, where there is none.

    A curve is held against another over the abscissas that both have, read off linearly.
    """
    value, wanted = observed.value, expected.value
    if observed.abscissa is not None and expected.abscissa is not None and not np.array_equal(observed.abscissa, expected.abscissa):
        if not (np.diff(expected.abscissa) >= 0.0).all():
            raise NotObserved("the reference's abscissa does not grow throughout, so nothing can be read off between its points")
        # Rounding at the ends is let pass.
        first, last = expected.abscissa[[0, -1]]
        slack = 1e-12 * max(abs(first), abs(last))
        common = (observed.abscissa >= first - slack) & (observed.abscissa <= last + slack)
        if not common.any():
            ours = observed.abscissa.min(), observed.abscissa.max()
            raise NotObserved(f"the reference goes from {first:.6g} to {last:.6g}, and no point from {ours[0]:.6g} to {ours[1]:.6g} lies within")
        value, wanted = value[common], np.interp(observed.abscissa[common], expected.abscissa, wanted)
    if value.shape != wanted.shape:
        raise NotObserved(f"{len(value)} values cannot be held against {len(wanted)} of the reference")
    size = float(np.sqrt(np.mean(wanted**2))) if relative else 1.0
    if not size > 0.0:
        raise NotObserved("the reference is 0, so no error is relative to it; set relative = false in the study")
    return float(np.sqrt(np.mean((value - wanted) ** 2))) / size


def gathered(rows: Sequence[Row]) -> list[Point]:
    """Rows as points: those with the same options are one, in the order in which they come first; references stand by themselves."""
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        found.setdefault((row.is_reference, *((key, str(value)) for key, value in row.options.items())), []).append(row)
    return [Point(rows[0].options, tuple(rows)) for rows in found.values()]


def pareto_front(points: Sequence[Point]) -> list[Point]:
    """Points that no other beats in both error and CPU time, the cheapest first."""
    front: list[Point] = []
    for point in sorted((point for point in points if point.counts), key=lambda point: (point.cpu_s, point.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def recommended(points: Sequence[Point], tolerance: float) -> Point | None:
    """The cheapest point within the tolerance."""
    within = [point for point in points if point.counts and point.error <= tolerance]
    return min(within, key=lambda point: (point.cpu_s, point.error), default=None)


def recommended_for_each(points: Sequence[Point], given: Sequence[str], tolerance: float) -> list[Point]:
    """What is recommended for each combination of the parameters that are given, where anything is."""
    kinds: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        kinds.setdefault(tuple(str(point.options.get(key)) for key in given), []).append(point)
    return [best for kind in kinds.values() if (best := recommended(kind, tolerance))]


def order_of(size: Sequence[float], error: Sequence[float]) -> float:
    """Order of convergence: slope of log error over log size, by least squares."""
    return float(np.polyfit(np.log(np.asarray(size, float)), np.log(np.asarray(error, float)), 1)[0])


def write_table(rows: Sequence[Row], path: Path) -> None:
    """error_time.csv: a line for each setting."""
    with open(path, "w", newline="") as file:
        write = csv.writer(file, lineterminator="\n").writerow
        names = [*rows[0].options, *rows[0].spread] if rows else []
        write([*names, "value", "error", "wall_s", "cpu_s", "steps", "iterations", "stable", "reason", "revision"])
        for row in rows:
            numbers = ["" if math.isnan(number) else f"{number:.6g}" for number in (row.value, row.error)]
            spent = [f"{row.cost.wall_s:.3g}", f"{row.cost.cpu_s:.3g}", row.cost.steps, row.cost.iterations]
            reason = "the reference" if row.is_reference else row.reason
            write([*row.options.values(), *row.spread.values(), *numbers, *spent, "yes" if row.stable else "no", " ".join(reason.split()), row.revision])
