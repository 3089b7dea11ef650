"""Everything measured on one variant, once, for tables, claims and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from . import collapse, onset
from .run_files import Run
from .run_sets import Variant


@dataclass(frozen=True)
class MeasuredRun:
    run: Run
    onsets: onset.RunOnsets


@dataclass(frozen=True)
class MeasuredPack:
    """runs: case number -> run; collapse: stress -> its collapse, None when not all five cases can be compared."""

    seed: str
    runs: Mapping[int, MeasuredRun]
    collapse: Mapping[str, collapse.Collapse] | None


@dataclass(frozen=True)
class MeasuredVariant:
    label: str
    scene: str
    packs: tuple[MeasuredPack, ...]

    @property
    def case_numbers(self) -> tuple[int, ...]:
        return tuple(sorted({number for pack in self.packs for number in pack.runs}))


def measure(variants: tuple[Variant, ...]) -> tuple[MeasuredVariant, ...]:
    """Onsets of every run and the collapse on every pack."""
    return tuple(
        MeasuredVariant(variant.label, variant.scene, tuple(
            MeasuredPack(pack.seed, {number: MeasuredRun(run, onset.find_onsets(run)) for number, run in pack.runs.items()},
                         collapse.measure(pack.runs))
            for pack in variant.packs))
        for variant in variants)
