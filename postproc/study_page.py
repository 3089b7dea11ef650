"""The page of a study: what was asked, what is recommended, every setting with its error and its cost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from postproc.error_time import Point, pareto_front, short
from postproc.work_precision import error_text


def page(
    title: str, about: str, command: str, points: Sequence[Point], best: Sequence[Point], given: Sequence[str], tolerance: float, error_label: str, picture: str
) -> str:  # fmt: skip
    """Markdown. given: parameters that are no choice."""
    lines = [f"# {title}", "", f"    {command}", ""]
    if about:
        lines += [about.strip(), ""]
    lines += [f"![{title}]({picture})", "", *verdict(points, best, tolerance), "", *choices(points, given), *table(points, error_label), "", made_by(points)]
    return "\n".join(lines) + "\n"


def verdict(points: Sequence[Point], best: Sequence[Point], tolerance: float) -> list[str]:
    """The recommended setting in a sentence; a list of them where some parameter is given."""
    said = [f"{one} (error {one.error:.2g}, {one.cpu_s:.3g} CPU s)" for one in best]
    if len(said) == 1:
        return [f"**Recommended, the cheapest within {tolerance:g}:** {said[0]}."]
    if said:
        return [f"**Recommended, the cheapest within {tolerance:g}, for each:**", "", *(f"- {one}" for one in said)]
    counting = [point for point in points if point.counts]
    if not counting:
        return [f"No setting has an error to judge by, so none is recommended for {tolerance:g}."]
    nearest = min(counting, key=lambda point: point.error)
    return [f"No setting is within {tolerance:g}; the nearest is {nearest} with an error of {nearest.error:.2g}."]


def choices(points: Sequence[Point], given: Sequence[str]) -> list[str]:
    """The setting to take for any wanted error: the Pareto front as a table, one for each combination of what is given."""
    kinds: dict[tuple[str, ...], list[Point]] = {}
    for point in points:
        kinds.setdefault(tuple(f"{key} = {short(point.options[key])}" for key in given if key in point.options), []).append(point)
    lines = []
    for kind, members in kinds.items():
        if front := pareto_front(members):
            lines += [f"To choose{', '.join(('', *kind))}:", "", "| for an error of | take | CPU s |", "|---|---|---|"]
            lines += [f"| {error_text(point.error)} | {_chosen(point, given)} | {point.cpu_s:.3g} |" for point in reversed(front)] + [""]
    return lines


def _chosen(point: Point, given: Sequence[str]) -> str:
    return ", ".join(f"{key} = {short(value)}" for key, value in point.options.items() if key not in given) or "what is given"


def made_by(points: Sequence[Point]) -> str:
    """The revision of the code that carried the settings out, or that they are of several."""
    names = list(dict.fromkeys(row.revision for point in points for row in point.rows))
    if len(names) == 1:
        return f"Carried out by revision {names[0]}."
    return f"**Carried out by {len(names)} revisions, {'; '.join(names)}**: error_time.csv tells which setting by which. Without --keep all are made by the present one."


def table(points: Sequence[Point], error_label: str) -> list[str]:
    """A line for each setting."""
    several = any(len(point.rows) > 1 for point in points)
    numbered = any(not math.isnan(point.value[0]) for point in points)
    head = [*points[0].options, *(["value"] if numbered else []), error_label, "CPU s", "steps", "iterations", "stable"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for point in points:
        cells = [short(value) for value in point.options.values()]
        mean, deviation = point.value
        if numbered:
            cells.append("" if math.isnan(mean) else f"{mean:.4g}" + (f" +- {deviation:.2g}" if several else ""))
        error = error_text(point.error)
        if several and error:
            error += f" ({error_text(point.smallest_error)} at best)"
        reason = next((row.reason for row in point.rows if row.reason), "")
        if any(row.is_reference for row in point.rows):
            error, reason = "", "the reference"
        row = point.rows[0]
        state = "yes" if point.stable else "no"
        cells += [error, f"{point.cpu_s:.3g}", str(row.cost.steps), str(row.cost.iterations), state + (f": {' '.join(reason.split())}" if reason else "")]
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return lines
