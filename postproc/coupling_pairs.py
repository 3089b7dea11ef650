"""Pairs of runs that differ in the coupling alone, one-way and two-way: displacements and pressures of their grains against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .errors import ForeignFile, MissingFile
from .run_files import RERUN, Grains, Run, read_grains
from .run_sets import flatten

MAY_DIFFER = ("case", "run", "group", "title", "decks_directory", "flow.two_way", "flow.split")
"""Entries of case.json in which the runs of a pair may differ, and all of the section `output` and of what is derived."""


@dataclass(frozen=True)
class Difference:
    """One pair at one snapshot; fields of the N grains, by id.

    one_way, two_way: its grains.  displacement: (N, 3), m, of the two-way run less that of the one-way run; pressure: (N,), Pa, likewise.
    """

    strain: float
    one_way: Grains
    two_way: Grains
    displacement: np.ndarray
    pressure: np.ndarray

    @property
    def displacement_share(self) -> float:
        """Root mean square of the difference over that of the one-way displacements."""
        return root_mean_square(self.displacement) / root_mean_square(self.one_way.displacement)

    @property
    def worst_displacement_share(self) -> float:
        """Largest difference of a grain over the largest one-way displacement."""
        return float(np.linalg.norm(self.displacement, axis=1).max() / np.linalg.norm(self.one_way.displacement, axis=1).max())

    @property
    def largest_pressure(self) -> float:
        """Largest size of a change, Pa."""
        return float(np.abs(self.pressure).max())

    @property
    def rms_pressure(self) -> float:
        """Pa, over the grains."""
        return float(np.sqrt((self.pressure**2).mean()))


def root_mean_square(vectors: np.ndarray) -> float:
    """Of vectors (N, 3)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


@dataclass(frozen=True)
class Pair:
    """label: what sets it apart from the other pairs given, "" when it is the only one."""

    label: str
    one_way: Run
    two_way: Run

    @cached_property
    def differences(self) -> tuple[Difference, ...]:
        """At the snapshots after the first that both have, in order."""
        steps = [run.snapshots["step"].to_numpy(int) for run in (self.one_way, self.two_way)]
        common = [step for step in np.intersect1d(*steps) if step > 0]
        if not common:
            raise MissingFile(self.two_way.directory / "snapshots", f"it has no snapshot of a step at which {self.one_way.directory} has one too",
                              "run both with the same output.snapshots, above 1")
        return tuple(self._at(*(int(np.flatnonzero(of == step)[0]) for of in steps)) for step in common)

    @property
    def last(self) -> Difference:
        return self.differences[-1]

    @property
    def horizontal_stress(self) -> float:
        """Mean of both x walls at the last snapshot, Pa, one-way."""
        history = self.one_way.history
        both = 0.5 * (history["sigma_h_left_Pa"] + history["sigma_h_right_Pa"])
        return float(np.interp(self.last.strain, history["strain"], both))

    @property
    def largest_pressure(self) -> float:
        """Largest pressure change around a grain over all snapshots, Pa."""
        return max(one.largest_pressure for one in self.differences)

    @property
    def largest_rms_pressure(self) -> float:
        """Root mean square of the pressure changes over the grains, Pa, where it is largest."""
        return max(one.rms_pressure for one in self.differences)

    def _at(self, row_one: int, row_two: int) -> Difference:
        one, two = read_grains(self.one_way, row_one), read_grains(self.two_way, row_two)
        if len(one.id) != len(two.id) or not (one.id == two.id).all():
            raise ForeignFile(self.two_way.directory, f"its grains are not those of {self.one_way.directory}", RERUN)
        if one.pressure is None or two.pressure is None:
            raise ForeignFile(self.two_way.directory, "its snapshots hold no pressure", RERUN)
        strain = float(self.one_way.snapshots["strain"].iloc[row_one])
        return Difference(strain, one, two, two.displacement - one.displacement, two.pressure - one.pressure)


def split_off_pairs(runs: Sequence[Run]) -> tuple[list[Pair], list[Run]]:
    """Pairs among the runs, in the order in which their one-way runs were given; and the runs that are in no pair."""
    solved = [run for run in runs if run.case.get("flow", {}).get("kind") == "solve"]
    inputs = {id(run): _inputs(run) for run in solved}
    couples: list[tuple[Run, Run]] = []
    for run in solved:
        others = [other for other in solved if _is_two_way(other) and not _is_two_way(run) and inputs[id(other)] == inputs[id(run)]]
        if len(others) > 1:
            raise ForeignFile(others[1].directory, f"it is the same case as {others[0].directory}", "name only one of the two")
        couples += [(run, other) for other in others]
    taken = {id(run) for couple in couples for run in couple}
    keys = sorted({key for one, _ in couples for key in inputs[id(one)]})
    varied = [key for key in keys if len({inputs[id(one)].get(key) for one, _ in couples}) > 1]
    labels = [", ".join(f"{key} = {inputs[id(one)].get(key, 'not given')}" for key in varied) for one, _ in couples]
    return [Pair(label, *couple) for label, couple in zip(labels, couples)], [run for run in runs if id(run) not in taken]


def _is_two_way(run: Run) -> bool:
    return bool(run.case["flow"].get("two_way", True))


def _inputs(run: Run) -> dict[str, str]:
    return {key: value for key, value in flatten(run.case).items() if key not in MAY_DIFFER and key.split(".")[0] not in ("output", "derived")}
