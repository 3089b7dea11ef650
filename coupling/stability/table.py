"""The stability map as stability.csv and as a page, stability.md."""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from coupling.results.output import write_atomically
from coupling.stability.scene import Outcome
from coupling.study.revision import revision

COLUMNS = ("scene", "what", "may_end", "ended", "as_it_may", "limit_found", "limit_predicted", "unit", "ranks", "figure", "wall_s")
TITLES = {"grains": "Grains", "flow": "Pore network and flow", "coupling": "Grains and fluid, two-way"}
#: Longer messages are cut in the page; they are whole in the CSV file.
LONGEST = 260


@dataclass(frozen=True)
class Line:
    """One scene. seconds: wall time."""

    name: str
    what: str
    expected: tuple[str, ...]
    outcome: Outcome
    seconds: float

    @property
    def as_it_may(self) -> bool:
        return self.outcome.ended in self.expected


def write(lines: list[Line], directory: Path, ranks: int = 1) -> None:
    """Write stability.csv and stability.md."""
    with open(directory / "stability.csv", "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for line in lines:
            o = line.outcome
            limits = ["" if value is None else f"{value:.4g}" for value in (o.found, o.predicted)]
            table.writerow([line.name, line.what, " or ".join(line.expected), o.ended, line.as_it_may, *limits, o.unit, o.ranks, _plain(o.figure), f"{line.seconds:.1f}"])
    write_atomically(directory / "stability.md", page(lines, ranks))


def page(lines: list[Line], ranks: int = 1) -> str:
    """The map as a page of Markdown. ranks: of the scenes that can be spread over them."""
    counts = Counter(line.outcome.ended for line in lines)
    wrong = [line.name for line in lines if not line.as_it_may]
    text = [
        "# Stability map", "",
        "Stiff and extreme scenes, each carried out by the program's own parts in a process of its own, made by", "",
        "    ./poreslip stability" + (f" --ranks {ranks}" if ranks > 1 else ""), "",
        f"by revision {revision()}.", "",
        "*stable*: came to its end, and is sound by the figure beside it. *refused*: caught before the first step. *stopped*: caught in the run. Each",
        "with the message that a user reads; *warned*: told of in the run's report. *failed* would be a crash, a hang, or a wrong answer without a",
        "word.", "",
        "What catches: beforehand time_step_limit.py and staggered_limit.py of coupling/case, two_way_checks.py and servo_checks.py of",
        "coupling/fluid; in the run coupling/measures/watch.py, with each line of the history: finite numbers, overlaps below 0.2 d, no grain through",
        "a wall, and no energy that the work of walls and fluid does not account for.", "",
        f"{len(lines)} scenes: " + ", ".join(f"{count} {ended}" for ended, count in sorted(counts.items()))
        + (f"; {sum(line.outcome.ranks > 1 for line in lines)} of them on {ranks} ranks" if ranks > 1 else "")
        + (f". **Not as they may end: {', '.join(wrong)}.**" if wrong else "; each as it may end."),
    ]  # fmt: skip
    for group, title in TITLES.items():
        own = [line for line in lines if line.name.startswith(f"{group}/")]
        limits = [line for line in own if line.outcome.found is not None]
        others = [line for line in own if line.outcome.found is None]
        if own:
            text += ["", f"## {title}"]
        if limits:
            text += ["", "| limit | found | predicted | unit | |", "|---|---|---|---|---|"]
            text += [f"| {line.what} | {line.outcome.found:.3g} | {line.outcome.predicted:.3g} | {line.outcome.unit} | {_cell(line)} |" for line in limits]
        if others:
            text += ["", "| scene | ended | figure or message |", "|---|---|---|"]
            text += [f"| {line.what} | {line.outcome.ended} | {_cell(line)} |" for line in others]
    return "\n".join(text) + "\n"


def _plain(words: str) -> str:
    """Without the paths of the machine that made it."""
    return re.sub(r"(/[\w.+-]+)+/", "", " ".join(words.split()))


def _cell(line: Line) -> str:
    words = _plain(line.outcome.figure).replace("|", "\\|")
    return words if len(words) <= LONGEST else words[: LONGEST - 4].rsplit(" ", 1)[0] + " ..."
