"""The paper's claims against the runs: what is measured, the criterion, the verdict.

A claim is judged on every pack by itself and over all packs of a variant (scatter over packs in the judgement).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .results import MeasuredPack, MeasuredVariant

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
NOT_TESTED = "not tested"

ALL_PACKS = "all packs"
NOT_GIVEN = "no such run"


@dataclass(frozen=True)
class Measurement:
    """What a claim comes to on one pack or over all.  figure: in words and numbers; value: the number judged, or None."""

    figure: str
    value: float | None
    verdict: str


@dataclass(frozen=True)
class Claim:
    """One claim.  on_pack judges one pack; over_packs judges all packs (two or more)."""

    letter: str
    statement: str
    source: str
    criterion: str
    on_pack: Callable[[MeasuredPack], Measurement]
    over_packs: Callable[[Sequence[MeasuredPack]], Measurement]


@dataclass(frozen=True)
class Finding:
    """One line of claims.csv: a claim on one pack ("pack <seed>"), over ALL_PACKS, or NOT_GIVEN."""

    claim: str
    variant: str
    scope: str
    statement: str
    source: str
    figure: str
    value: float | None
    criterion: str
    verdict: str


def verdict_of(holds: bool) -> str:
    return REPRODUCED if holds else NOT_REPRODUCED


def untested(why: str) -> Measurement:
    return Measurement(why, None, NOT_TESTED)


def majority(claim_on_pack: Callable[[MeasuredPack], Measurement],
             unit: str) -> Callable[[Sequence[MeasuredPack]], Measurement]:
    """A judgement over packs for claims with one number: reproduced when it is on every pack that could be tested."""

    def over_packs(packs: Sequence[MeasuredPack]) -> Measurement:
        tested = [found for found in map(claim_on_pack, packs) if found.verdict != NOT_TESTED]
        if not tested:
            return untested("on no pack")
        held = sum(found.verdict == REPRODUCED for found in tested)
        values = np.array([found.value for found in tested if found.value is not None])
        number = f"{values.mean():.3g} ± {values.std(ddof=1):.2g} {unit}".strip() if len(values) > 1 else ""
        text = f"holds on {held} of {len(tested)} packs" + (f"; mean and sd over packs: {number}" if number else "")
        return Measurement(text, float(values.mean()) if len(values) else None, verdict_of(held == len(tested)))

    return over_packs


def judge(variants: Sequence[MeasuredVariant], claims: Sequence[Claim], scene: str) -> list[Finding]:
    """All findings for the variants of `scene`, "all packs" before the single packs."""
    findings = []
    for variant in (variant for variant in variants if variant.scene == scene):
        for claim in claims:
            scopes = [(f"pack {pack.seed}", claim.on_pack(pack)) for pack in variant.packs]
            if len(variant.packs) > 1:
                scopes.insert(0, (ALL_PACKS, claim.over_packs(variant.packs)))
            findings += [Finding(claim.letter, variant.label, scope, claim.statement, claim.source, found.figure,
                                 found.value, claim.criterion, found.verdict) for scope, found in scopes]
    return findings


def not_given(claims: Sequence[Claim], why: str) -> list[Finding]:
    """Findings for claims whose runs were not given at all."""
    return [Finding(claim.letter, "", NOT_GIVEN, claim.statement, claim.source, why, None, claim.criterion, NOT_TESTED)
            for claim in claims]


def chief(findings: Sequence[Finding]) -> dict[str, list[Finding]]:
    """variant -> its findings over all packs, or on its only pack; under "" also those of runs that were not given."""
    chosen: dict[str, list[Finding]] = {}
    several = {finding.variant for finding in findings if finding.scope == ALL_PACKS}
    for finding in findings:
        if finding.scope in (ALL_PACKS, NOT_GIVEN) or finding.variant not in several:
            chosen.setdefault(finding.variant, []).append(finding)
    return chosen


def table(findings: Sequence[Finding]) -> pd.DataFrame:
    """claims.csv: one line a finding."""
    return pd.DataFrame([vars(finding) for finding in findings],
                        columns=["claim", "variant", "scope", "statement", "source", "figure", "value", "criterion", "verdict"])
