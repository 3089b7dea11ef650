"""Claims about where and when slip begins: the side, the order of the cases, equal onsets, the supplement."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from .claims import NOT_TESTED, REPRODUCED, Claim, Measurement, majority, untested, verdict_of
from .onset import THRESHOLD, THRESHOLDS
from .results import MeasuredPack, MeasuredRun

HIGH_SIDE = {2: "left", 3: "right"}
OTHER_SIDE = {"left": "right", "right": "left"}
LEAST_RATIO = 1.5
SMALLEST_SLIP = 1e-3
"""Slip (in d) below which the slower side does not count as a divisor: the ratio is then "more than"."""

EQUAL_WITHIN = 0.05
"""Share of sigma_n within which onsets count as equal ("about the same" in the paper) where their uncertainty is smaller."""

NOT_LATER = ((1, 2), (1, 3))
EARLIER = ((1, 4), (2, 4), (3, 4), (4, 5))
NAMES = {"strain": ("strain", 1e3, "1e-3"), "sigma_n_Pa": ("sigma_n", 1e-6, "MPa")}


def side_ratio(measured: MeasuredRun, high: str, strain: float) -> tuple[float, bool]:
    """Slip of the high-pressure side over that of the other at `strain` (as measured, with the elastic part).

    The second value says that the other side had not slipped SMALLEST_SLIP, so that the ratio is a lower bound.
    """
    history = measured.run.history
    slips = {side: float(np.interp(strain, history["strain"], history[f"slip_{side}_m"])) for side in OTHER_SIDE}
    sense = 1.0 if max(slips.values(), key=abs) >= 0.0 else -1.0
    floor = SMALLEST_SLIP * measured.onsets.diameter
    other = sense * slips[OTHER_SIDE[high]]
    return sense * slips[high] / max(other, floor), other < floor


def side_of_slip(pack: MeasuredPack) -> Measurement:
    """Which side slips first in cases 2 and 3, and by how much more."""
    parts, ratios, right_side = [], [], True
    for number, high in HIGH_SIDE.items():
        if number not in pack.runs:
            continue
        measured = pack.runs[number]
        if measured.onsets.faster is None:
            parts.append(f"case {number}: no slip")
            right_side = False
            continue
        strain = measured.run.history["strain"]
        half = min(0.5 * float(measured.run.case.get("loading", {}).get("horizontal_strain", strain.iloc[-1])), strain.iloc[-1])
        words = []
        for at in (half, float(strain.iloc[-1])):
            ratio, bound = side_ratio(measured, high, at)
            words.append(f"{'more than ' if bound else ''}{ratio:.3g} at strain {at * 1e3:.3g}e-3")
            if at == half:
                ratios.append(ratio)
        right_side &= measured.onsets.faster == high
        parts.append(f"case {number}: {measured.onsets.faster} side first, high pressure {high}; ratio of slips " + ", ".join(words))
    if not parts:
        return untested("cases 2 and 3 are not there")
    smallest = min(ratios) if ratios else None
    return Measurement("; ".join(parts), smallest, verdict_of(right_side and smallest is not None and smallest >= LEAST_RATIO))


def pair_difference(pack: MeasuredPack, first: int, second: int, name: str, threshold: float) -> tuple[float, float] | None:
    """Onset of case `second` minus that of `first` in quantity `name` at `threshold`, and its uncertainty.

    The threshold is the same for both, so its choice is no part of the uncertainty.  A case that does not slip within its
    run slips later than all others: infinite in strain; in other quantities, and at thresholds not reached, None.
    """
    if first not in pack.runs or second not in pack.runs:
        return None
    early, late = pack.runs[first].onsets.onset, pack.runs[second].onsets.onset
    if early is not None and late is None and name == "strain":
        return float("inf"), 0.0
    if early is None and late is not None and name == "strain":
        return float("-inf"), 0.0
    if early is None or late is None or threshold not in early.at_threshold or threshold not in late.at_threshold:
        return None
    return (late.at_threshold[threshold][name] - early.at_threshold[threshold][name],
            float(np.hypot(early.measurement[name], late.measurement[name])))


def onset_list(pack: MeasuredPack, name: str) -> str:
    """The onsets of all cases on a pack in words, e.g. "(1) 20.6 ± 0.4, (2) 22.6 ± 0.5 MPa"."""
    _, factor, unit = NAMES[name]
    words = []
    for number, measured in pack.runs.items():
        onset = measured.onsets.onset
        words.append(f"({number}) " + ("no slip" if onset is None else
                                       f"{onset.at[name].value * factor:.3g} ± {onset.at[name].uncertainty * factor:.2g}"))
    return ", ".join(words) + f" {unit}"


def pair_holds(pack: MeasuredPack, first: int, second: int, name: str, threshold: float, strict: bool) -> bool | None:
    """Whether `first` comes before `second` (strict), or not later than its uncertainty and EQUAL_WITHIN allow; None: not known."""
    difference = pair_difference(pack, first, second, name, threshold)
    if difference is None:
        return None
    if strict or not np.isfinite(difference[0]):
        return difference[0] > difference[1]
    alike = EQUAL_WITHIN * abs(pack.runs[first].onsets.onset.at_threshold[threshold][name])
    return difference[0] >= -max(difference[1], alike)


def order_on_pack(name: str):
    """The claim (b) in quantity `name` on one pack: judged at the onset's threshold, the other thresholds are told."""

    def judge(pack: MeasuredPack) -> Measurement:
        failed: dict[float, list[str]] = {threshold: [] for threshold in THRESHOLDS}
        tested, known = 0, set()
        for pairs, strict in ((NOT_LATER, False), (EARLIER, True)):
            for first, second in pairs:
                for threshold in THRESHOLDS:
                    holds = pair_holds(pack, first, second, name, threshold, strict)
                    if holds is None:
                        continue
                    if threshold == THRESHOLD:
                        tested += 1
                        known |= {first, second}
                    if not holds:
                        failed[threshold].append(f"({first}) {'<' if strict else '<='} ({second})")
        if not {1, 4, 5} <= known:
            return untested(f"{onset_list(pack, name)}; cases 1, 4 and 5 have to be there with an onset")
        here = failed.pop(THRESHOLD)
        text = onset_list(pack, name) + f"; {tested - len(here)} of {tested} comparisons hold" + (f", not {', '.join(here)}" if here else "")
        text += "".join(f"; at {threshold} d not {', '.join(pairs)}" for threshold, pairs in failed.items() if pairs)
        return Measurement(text, (tested - len(here)) / tested, verdict_of(not here))

    return judge


def order_over_packs(name: str):
    """The claim (b) over packs: the mean of each difference within a pack against its standard error."""

    def judge(packs: Sequence[MeasuredPack]) -> Measurement:
        label, factor, unit = NAMES[name]
        words, failed, known = [], [], set()
        for pairs, strict in ((NOT_LATER, False), (EARLIER, True)):
            for first, second in pairs:
                differences = [found[0] for found in (pair_difference(pack, first, second, name, THRESHOLDS[1]) for pack in packs)
                               if found is not None and np.isfinite(found[0])]
                if len(differences) < 2:
                    continue
                known |= {first, second}
                mean, error = float(np.mean(differences)), float(np.std(differences, ddof=1) / np.sqrt(len(differences)))
                words.append(f"({second}) - ({first}) {mean * factor:.3g} ± {error * factor:.2g}")
                alike = 0.0 if strict else EQUAL_WITHIN * float(np.mean([pack.runs[first].onsets.onset.at[name].value for pack in packs
                                                                         if first in pack.runs and pack.runs[first].onsets.onset]))
                if not (mean > error if strict else mean >= -max(error, alike)):
                    failed.append(f"({first}) {'<' if strict else '<='} ({second})")
        if not {1, 4, 5} <= known:
            return untested("cases 1, 4 and 5 have to be there with an onset on two packs or more")
        text = f"{label}, {unit}, mean and standard error over packs: " + ", ".join(words)
        return Measurement(text + (f"; fails: {', '.join(failed)}" if failed else ""), None, verdict_of(not failed))

    return judge


def share_of_the_way(pack: MeasuredPack) -> str:
    """Where cases 2 and 3 begin to slip between case 1 (0: the larger pressure rules) and case 4 (1: the mean does), in words."""
    onsets = {number: pack.runs[number].onsets.onset for number in (1, 2, 3, 4) if number in pack.runs}
    if len(onsets) < 4 or None in onsets.values():
        return ""
    words = []
    for name, (label, _, _) in NAMES.items():
        at = {number: onset.at[name].value for number, onset in onsets.items()}
        if at[4] > at[1]:
            words.append(f"{(0.5 * (at[2] + at[3]) - at[1]) / (at[4] - at[1]):.2f} in {label}")
    return "; 2 and 3 on the way from 1 (0, maximum) to 4 (1, mean): " + ", ".join(words) if words else ""


def difference_of_onsets(pack: MeasuredPack, first: int, second: int) -> tuple[float, float] | None:
    """sigma_n (Pa) at the onset of case `second` minus that of `first`, and the uncertainty of the difference.

    Both are read at one threshold, so what its choice leaves open is half the range of their difference over the
    thresholds; sampling and noise are added in quadrature.
    """
    differences = {threshold: pair_difference(pack, first, second, "sigma_n_Pa", threshold) for threshold in THRESHOLDS}
    found = {threshold: difference for threshold, difference in differences.items() if difference is not None}
    if THRESHOLDS[1] not in found:
        return None
    values = [difference[0] for difference in found.values()]
    value, measurement = found[THRESHOLDS[1]]
    return value, float(np.hypot(0.5 * (max(values) - min(values)), measurement))


def equal_onsets(pack: MeasuredPack) -> Measurement:
    """The claim (c) on one pack."""
    found = {pair: difference_of_onsets(pack, *pair) for pair in combinations((1, 2, 3), 2)}
    if None in found.values():
        return untested("cases 1, 2 and 3 have to be there with an onset")
    alike = EQUAL_WITHIN * pack.runs[1].onsets.onset.at["sigma_n_Pa"].value
    worst = max(abs(value) / max(allowed, alike) for value, allowed in found.values())
    text = [f"({second}) - ({first}) {value / 1e6:.2f} ± {allowed / 1e6:.2f}" for (first, second), (value, allowed) in found.items()]
    text.append("sigma_n - max p: " + ", ".join(f"({number}) {pack.runs[number].onsets.onset.at['sigma_n_minus_max_p_Pa'].value / 1e6:.3g}"
                                              for number in (1, 2, 3)))
    return Measurement("; ".join(text) + " MPa" + share_of_the_way(pack), worst, verdict_of(worst <= 1.0))


def equal_onsets_over_packs(packs: Sequence[MeasuredPack]) -> Measurement:
    """The claim (c) over packs."""
    text, worst = [], 0.0
    levels = [pack.runs[1].onsets.onset.at["sigma_n_Pa"].value for pack in packs if 1 in pack.runs and pack.runs[1].onsets.onset]
    for first, second in combinations((1, 2, 3), 2):
        found = [difference for pack in packs if (difference := difference_of_onsets(pack, first, second)) is not None]
        if len(found) < 2:
            return untested("cases 1, 2 and 3 have to be there with an onset on two packs or more")
        values = [value for value, _ in found]
        error = 2.0 * float(np.std(values, ddof=1)) / np.sqrt(len(values))
        limit = max(float(np.mean([allowed for _, allowed in found])), error, EQUAL_WITHIN * float(np.mean(levels)))
        worst = max(worst, abs(float(np.mean(values))) / limit)
        text.append(f"({second}) - ({first}) {np.mean(values) / 1e6:.2f}, limit {limit / 1e6:.2f}")
    return Measurement("mean differences over packs: " + "; ".join(text) + " MPa", worst, verdict_of(worst <= 1.0))


def supplement_slips(pack: MeasuredPack) -> Measurement:
    """The claim (h) on one pack."""
    if not ({2, 3} & set(pack.runs)) or 4 not in pack.runs:
        return untested("case 4 and case 2 or 3 of the supplement have to be there")
    slipped = {number: measured.onsets.faster is not None for number, measured in pack.runs.items()}
    text = ", ".join(f"({number}) " + ("slips" if slips else "does not slip")
                     + f" (largest {max(s.largest for s in pack.runs[number].onsets.slips.values()) * 1e6:.3g} um)"
                     for number, slips in slipped.items())
    holds = all(slipped[number] for number in (2, 3) if number in slipped) and not slipped[4]
    return Measurement(text, float(holds), verdict_of(holds))


def supplement_over_packs(packs: Sequence[MeasuredPack]) -> Measurement:
    tested = [found for found in map(supplement_slips, packs) if found.verdict != NOT_TESTED]
    if not tested:
        return untested("case 4 and case 2 or 3 of the supplement have to be there")
    held = sum(found.verdict == REPRODUCED for found in tested)
    return Measurement(f"holds on {held} of {len(tested)} packs", held / len(tested), verdict_of(held == len(tested)))


ONSET_CLAIMS = (
    Claim("a", "Slip of cases 2 and 3 is on the high-pressure side", "Figs 4 and 6",
          f"the high-pressure interface slips first in both, and at half of the case's horizontal "
          f"strain it has slipped at least {LEAST_RATIO} times as far as the other",
          side_of_slip, majority(side_of_slip, "(smaller ratio of slips)")),
    Claim("b, strain", "Onset at the faster interface comes in the order (1) <= (2), (3) < (4) < (5) in horizontal strain", "Fig. 6",
          f"at equal threshold, < beyond sampling and noise, <= within that or {100 * EQUAL_WITHIN:g} %; "
          "over packs, beyond or within the standard error of the mean difference",
          order_on_pack("strain"), order_over_packs("strain")),
    Claim("b, sigma_n", "Onset at the faster interface comes in the order (1) <= (2), (3) < (4) < (5) in sigma_n", "Fig. 6",
          "as for the strain", order_on_pack("sigma_n_Pa"), order_over_packs("sigma_n_Pa")),
    Claim("c", "Cases 1, 2 and 3 begin to slip at the same sigma_n", "Fig. 6",
          f"differences, read at equal threshold, within their uncertainty (thresholds, sampling, noise) or {100 * EQUAL_WITHIN:g} % "
          "of sigma_n; over packs, mean differences within that or two standard errors",
          equal_onsets, equal_onsets_over_packs),
)

SUPPLEMENT_CLAIMS = (
    Claim("h", "Fault normal along x: cases 2 and 3 slip, case 4 with the same mean pressure does not", "Supplement",
          f"slip of {THRESHOLD:g} d is reached in cases 2 and 3 and not in case 4", supplement_slips, supplement_over_packs),
)
