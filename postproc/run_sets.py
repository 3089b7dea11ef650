"""Find the runs below the directories given and sort them: parameter variant, pack, pressure case.

Runs that differ in nothing but the pressures and the pack's seed belong to one variant; runs of one variant with one
seed share a pack and are compared case by case.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import ForeignFile, MissingFile
from .run_files import Run, read_json, read_run

CASE_NUMBERS = (1, 2, 3, 4, 5)
NOT_A_PARAMETER = ("case", "run", "group", "title", "decks_directory", "pack.seed", "pressure.mode", "pressure.left_target_Pa",
                   "pressure.right_target_Pa", "output", "derived")
"""Entries and sections of case.json in which runs of one variant may differ."""

OF_THE_FLUID = ("pressure", "flow")
"""Sections which do not matter to a dry run: it serves every variant that is otherwise like it."""


@dataclass(frozen=True)
class Pack:
    """The runs on one pack: case number (1 to 5) -> run."""

    seed: str
    runs: dict[int, Run]


@dataclass(frozen=True)
class Variant:
    """All packs computed with one set of parameters.

    label: what sets it apart from the other variants given ("" when it is the only one); scene: from case.json.
    """

    label: str
    scene: str
    packs: tuple[Pack, ...]

    @property
    def case_numbers(self) -> tuple[int, ...]:
        return tuple(sorted({number for pack in self.packs for number in pack.runs}))


def flatten(section: dict[str, Any], prefix: str = "") -> dict[str, str]:
    """Nested tables as one: {"loading.rate": "0.0078", ...}, each value as text."""
    flat: dict[str, str] = {}
    for key, value in section.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            flat.update(flatten(value, f"{name}."))
        else:
            flat[name] = f"{value:g}" if isinstance(value, float) else str(value)
    return flat


def parameters(case: dict[str, Any], passed_over: Sequence[str] = NOT_A_PARAMETER) -> dict[str, str]:
    """The entries of case.json which make a variant."""
    return {key: value for key, value in flatten(case).items()
            if key not in passed_over and key.split(".")[0] not in passed_over}


def scene_of(run: Run) -> str:
    """The scene's name, "two_sides" or "supplement"."""
    return str(run.case.get("scene", ""))


def seed_of(run: Run) -> str:
    return str(run.case["pack"].get("seed", "none"))


def target_pressures(run: Run) -> tuple[float, float]:
    """Pressures aimed at in the left and the right block, Pa; both 0 where the case has no fluid."""
    try:
        pressure = run.case["pressure"]
        if pressure.get("mode") == "none" or run.case.get("flow", {}).get("kind") == "none":
            return 0.0, 0.0
        return float(pressure["left_target_Pa"]), float(pressure["right_target_Pa"])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise ForeignFile(run.directory / "case.json", "it has no pressure.left_target_Pa and pressure.right_target_Pa",
                          "run the case again (poreslip run) or name another directory") from None


def is_dry(run: Run) -> bool:
    return target_pressures(run) == (0.0, 0.0)


def case_number(run: Run, full_pressure: float) -> int:
    """The number of the pressure case, from the targets left and right.

    1: both at the full pressure; 2: left only; 3: right only; 4: both at half; 5: dry.  full_pressure (Pa) is the
    largest target among the runs given; where it cannot tell 1 from 4, the name of the run does.
    """
    left, right = target_pressures(run)
    named = re.match(r"case([1-5])(?!\d)", str(run.case.get("group", run.name)))
    if left == right == 0.0:
        number = 5
    elif right == 0.0:
        number = 2
    elif left == 0.0:
        number = 3
    elif named and int(named[1]) in (1, 4):
        number = int(named[1])
    else:
        number = 1 if left > 0.75 * full_pressure else 4
    if named and int(named[1]) != number:
        raise ForeignFile(run.directory / "case.json", f"the run is called {run.name}, but its pressures ({left:g} Pa "
                          f"left, {right:g} Pa right) are those of case {number}",
                          "rename the run or set the pressures of its case")
    return number


def find_members(directories: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """Directories of the runs in `directories`, each a run's or a case's directory; also what had to be passed over."""
    found: list[Path] = []
    passed_over: list[str] = []
    seen: set[Path] = set()
    for directory in directories:
        if not directory.is_dir():
            raise MissingFile(directory, "there is no such directory",
                              "name the directory of a run or of a case, as printed by poreslip run")
        if (directory / "history.csv").exists() or (directory / "case.json").exists():
            members = [directory]
        elif (directory / "runs.json").exists():
            names = read_json(directory / "runs.json").get("runs")
            if not isinstance(names, list) or not names:
                raise ForeignFile(directory / "runs.json", 'it has no list "runs"', "run the case again (poreslip run)")
            listed = [directory / str(name) for name in names]
            # runs.json lists the runs of the last command only; earlier ones of the same case lie next to them.
            earlier = [path.parent for path in sorted(directory.glob("*/history.csv"))]
            members = [member for member in dict.fromkeys(listed + earlier) if (member / "history.csv").exists()]
            passed_over += [f"{member}: listed in runs.json, but it has no history.csv yet; left out" for member in listed if member not in members]
            if not members:
                raise MissingFile(directory, "none of its runs has a history.csv", "run the case "
                                  "(poreslip run) and wait for its first samples")
        else:
            raise MissingFile(directory, "it has neither history.csv (a run) nor runs.json (a case)",
                              "name the directory of a run or of a case, as printed by poreslip run")
        for member in members:
            if member.resolve() not in seen:
                seen.add(member.resolve())
                found.append(member)
    return found, passed_over


def find_runs(directories: Iterable[Path]) -> tuple[list[Run], list[str]]:
    """Read the runs in `directories`, each a run's or a case's directory; also what had to be passed over."""
    members, passed_over = find_members(directories)
    return [read_run(member) for member in members], passed_over


def label_of(own: dict[str, str], alternatives: Sequence[dict[str, str]], only_scene: bool) -> str:
    """What sets the parameters `own` apart from the other groups of its scene, and the scene where there are several."""
    keys = sorted({key for other in alternatives for key in other})
    varied = [f"{key} = {own.get(key, 'not given')}" for key in keys if len({other.get(key) for other in alternatives}) > 1]
    return ", ".join(([] if only_scene else [f"scene {own.get('scene', 'not given')}"]) + varied)


def group_by_parameters(runs: Sequence[Run]) -> list[tuple[dict[str, str], list[Run]]]:
    """Runs of equal parameters together, in the order given.

    A dry run whose fluid parameters match no group joins every group that is otherwise like it and has no dry run on
    the same pack.
    """
    groups: list[tuple[dict[str, str], list[Run]]] = []
    visitors: list[Run] = []
    for run in sorted(runs, key=is_dry):
        own = parameters(run.case)
        home = next((members for known, members in groups if known == own), None)
        if home is not None:
            home.append(run)
        elif is_dry(run):
            visitors.append(run)
        else:
            groups.append((own, [run]))
    for run in visitors:
        solid = parameters(run.case, NOT_A_PARAMETER + OF_THE_FLUID)
        homes = [members for _, members in groups
                 if parameters(members[0].case, NOT_A_PARAMETER + OF_THE_FLUID) == solid
                 and not any(is_dry(member) and seed_of(member) == seed_of(run) for member in members)]
        for members in homes:
            members.append(run)
        if not homes:
            groups.append((parameters(run.case), [run]))
    return groups


def sort_runs(runs: Sequence[Run]) -> tuple[Variant, ...]:
    """Variants in the order in which their first run was given, packs by seed, runs by case number."""
    groups = group_by_parameters(runs)
    only_scene = len({own.get("scene") for own, _ in groups}) == 1
    variants = []
    for own, members in groups:
        full = max(max(target_pressures(run)) for run in members)
        packs: dict[str, dict[int, Run]] = {}
        for run in members:
            number = case_number(run, full)
            seat = packs.setdefault(seed_of(run), {})
            if number in seat:
                raise ForeignFile(run.directory, f"it is the same case, pack and parameters as {seat[number].directory}",
                                  "name only one of the two")
            seat[number] = run
        alternatives = [other for other, _ in groups if other.get("scene") == own.get("scene")]
        variants.append(Variant(label_of(own, alternatives, only_scene), scene_of(members[0]),
                                tuple(Pack(seed, dict(sorted(packs[seed].items()))) for seed in sorted(packs, key=_order))))
    return tuple(variants)


def _order(seed: str) -> tuple[int, str]:
    return (int(seed), seed) if seed.isdigit() else (1 << 62, seed)
