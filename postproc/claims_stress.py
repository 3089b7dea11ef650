"""Claims about stresses, contacts and bonds: collapse of the strain rates, force chains, Coulomb friction, broken bonds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from . import smoothing
from .claims import Claim, Measurement, majority, untested, verdict_of
from .results import MeasuredPack, MeasuredRun

LARGEST_COLLAPSE = 0.5
WORSE_AGAINST_MEAN = 2.0
OPENING_RATIO = 0.7
"""Larger pressure over the vertical stress held from which on a block may part from its plate rather than slide."""

SAME_PRESSURE = 1.25
"""Largest over smallest pressure among cases 1 to 4 up to which that pressure alone accounts for where the curves rise."""

CONTACTS_LOST = (0.10, 0.30)
FORCE_GROWTH = (5.0, 20.0)
COULOMB_RATIO = (0.5, 2.0)


def strain_rates_collapse(pack: MeasuredPack) -> Measurement:
    """The claim (d); the number is that of collapse.py."""
    if pack.collapse is None:
        return untested("all five cases have to be there, and 1 to 4 have to reach a common share of the rate of rigid sliding")
    by_max, by_mean = pack.collapse["sigma_n_minus_max_p_Pa"], pack.collapse["sigma_n_minus_mean_p_Pa"]
    plain = pack.collapse["sigma_n_Pa"]
    levels = f"{by_max.levels[0]:g} to {by_max.levels[-1]:g}"
    text = (f"collapse {by_max.number:.2f} against sigma_n - max p (spread of 1-3 {by_max.spread / 1e6:.2f} MPa, nearest "
            f"other case {by_max.distance / 1e6:.2f} MPa away), {by_mean.number:.2f} against sigma_n - mean p, {plain.number:.2f} "
            f"against sigma_n; at {levels} of the way to rigid sliding; "
            f"{'(4)' if by_max.without_dry else '(4) and (5)'} {'apart' if by_max.apart else 'not apart'}")
    if by_max.without_dry:
        text += "; (5) never moves that fast"
    text += "".join(f"; {doubt}" for doubt in doubts(pack))
    holds = by_max.number <= LARGEST_COLLAPSE and by_mean.number >= WORSE_AGAINST_MEAN * by_max.number and by_max.apart
    return Measurement(text, by_max.number, verdict_of(holds))


def doubts(pack: MeasuredPack) -> list[str]:
    """What the collapse on a pack does not show: the maximum rather than the mean, sliding rather than opening."""
    if pack.collapse is None:
        return []
    by_max, found = pack.collapse["sigma_n_minus_max_p_Pa"], []
    if by_max.if_mean_ruled <= LARGEST_COLLAPSE:
        found.append("this does not tell the maximum from the mean: were 2 and 3 to slip where case 4 does, the number against "
                     f"sigma_n - max p would be {by_max.if_mean_ruled:.2f}")
    wet = {number: value for number, value in by_max.pressure_ratio.items() if number != 5}
    if wet and min(wet.values()) >= OPENING_RATIO and max(wet.values()) <= SAME_PRESSURE * min(wet.values()):
        found.append("this does not tell sliding from opening: all four curves rise where the larger pressure comes near the vertical stress on "
                     f"the plates, at {per_case(wet, '.2f')} of it, and the blocks part")
    return found


def strain_rates_collapse_over_packs(packs: Sequence[MeasuredPack]) -> Measurement:
    """The claim (d) over packs, with the doubts of the packs."""
    found = majority(strain_rates_collapse, "against sigma_n - max p")(packs)
    doubted = [f"pack {pack.seed}: {doubt}" for pack in packs for doubt in doubts(pack)]
    return Measurement("; ".join([found.figure, *doubted]), found.value, found.verdict)


def ends_of(measured: MeasuredRun, column: str) -> tuple[float, float]:
    """First and last value of a history column, smoothed; a sample without contacts counts as 0."""
    history = measured.run.history
    smoothed = smoothing.smooth(history["time_s"].to_numpy(float), history[column].fillna(0.0).to_numpy(float))
    return float(smoothed[0]), float(smoothed[-1])


def per_case(values: Mapping[int, float], form: str) -> str:
    return ", ".join(f"({number}) {format(value, form)}" for number, value in values.items())


def slipped_cases(pack: MeasuredPack) -> dict[int, MeasuredRun]:
    return {number: measured for number, measured in pack.runs.items() if measured.onsets.faster is not None}


def contacts_drop(pack: MeasuredPack) -> Measurement:
    """The claim (e), number of contacts in the gouge."""
    lost = {}
    for number, measured in slipped_cases(pack).items():
        first, last = ends_of(measured, "contacts_gouge")
        if first > 0.0:
            lost[number] = 1.0 - last / first
    if not lost:
        return untested("no run has slipped")
    mean = float(np.mean(list(lost.values())))
    return Measurement(f"share of contacts lost: {per_case(lost, '.2f')}; mean {mean:.2f}", mean,
                       verdict_of(CONTACTS_LOST[0] <= mean <= CONTACTS_LOST[1]))


def largest_force_grows(pack: MeasuredPack) -> Measurement:
    """The claim (e), largest contact force in the gouge."""
    growth = {}
    for number, measured in slipped_cases(pack).items():
        first, last = ends_of(measured, "contact_force_max_N")
        if first > 0.0:
            growth[number] = last / first
    if not growth:
        return untested("no run has slipped")
    mean = float(np.mean(list(growth.values())))
    return Measurement(f"largest force at the end over that at the start: {per_case(growth, '.2g')}; mean {mean:.2g}", mean,
                       verdict_of(FORCE_GROWTH[0] <= mean <= FORCE_GROWTH[1]))


def at_onset(measured: MeasuredRun) -> dict[str, float] | None:
    """sigma_n, sigma_v, sigma_h and the larger pressure (Pa) at the onset of the faster interface, smoothed."""
    onset = measured.onsets.onset
    if onset is None:
        return None
    history = measured.run.history
    time = history["time_s"].to_numpy(float)
    columns = {
        "sigma_n": history["sigma_n_Pa"], "sigma_v": history["sigma_v_Pa"],
        "sigma_h": 0.5 * (history["sigma_h_left_Pa"] + history["sigma_h_right_Pa"]),
        "p": history[["p_left_Pa", "p_right_Pa"]].max(axis=1),
    }
    where = onset.at["time_s"].value
    return {name: float(np.interp(where, time, smoothing.smooth(time, column.to_numpy(float)))) for name, column in columns.items()}


def coulomb(pack: MeasuredPack) -> Measurement:
    """The claim (f): on a fault that dips 45 degrees tau = sigma_n - sigma_v, so tau = mu (sigma_n - p) gives
    sigma_n = (sigma_v - mu p) / (1 - mu), with mu = tau / sigma_n of the dry run at its onset and p the larger pressure.
    """
    dry = at_onset(pack.runs[5]) if 5 in pack.runs else None
    if dry is None:
        return untested("case 5 has to be there with an onset, it gives the gouge's friction")
    if abs(float(pack.runs[5].run.case.get("fault", {}).get("dip_degrees", 0.0)) - 45.0) > 1e-6:
        return untested("the formula is that of a fault that dips 45 degrees")
    friction = 0.5 * (dry["sigma_h"] - dry["sigma_v"]) / dry["sigma_n"]
    ratios, words = {}, []
    for number in (1, 2, 3, 4):
        wet = at_onset(pack.runs[number]) if number in pack.runs else None
        if wet is None:
            continue
        expected = (wet["sigma_v"] - friction * wet["p"]) / (1.0 - friction)
        ratios[number] = wet["sigma_n"] / expected if expected > 0.0 else float("inf")
        words.append(f"({number}) {wet['sigma_n'] / 1e6:.3g} against {expected / 1e6:.3g}")
    if not ratios:
        return untested("none of the cases 1 to 4 has an onset")
    worst = max(ratios.values(), key=lambda ratio: abs(np.log(ratio)) if np.isfinite(ratio) else np.inf)
    return Measurement(f"macroscopic mu {friction:.3f}; sigma_n at onset against Coulomb, MPa: {', '.join(words)}", worst,
                       verdict_of(all(COULOMB_RATIO[0] <= ratio <= COULOMB_RATIO[1] for ratio in ratios.values())))


def bonds_hold(pack: MeasuredPack) -> Measurement:
    """The claim (g)."""
    broken = {number: int(measured.run.history[["bonds_broken_tension", "bonds_broken_shear"]].iloc[-1].sum())
              for number, measured in pack.runs.items()}
    intact = {number: int(measured.run.history["bonds_intact"].iloc[0]) for number, measured in pack.runs.items()}
    if not any(intact.values()):
        return untested("the blocks are not bonded")
    return Measurement(f"bonds broken: {per_case(broken, 'd')}, of {max(intact.values())}", float(sum(broken.values())),
                       verdict_of(not any(broken.values())))


STRESS_CLAIMS = (
    Claim("d", "Strain-rate curves of cases 1 to 3 collapse against sigma_n - max(p_L, p_R), not against sigma_n - mean p, with 4 and 5 apart",
          "Fig. 6", f"collapse (spread of 1-3 over the distance of the nearest other case) at most {LARGEST_COLLAPSE} against the maximum, at least "
          f"{WORSE_AGAINST_MEAN:g} times that against the mean, 4 and 5 outside of 1-3", strain_rates_collapse, strain_rates_collapse_over_packs),
    Claim("e, contacts", "Contacts in the gouge drop by about a fifth", "Fig. 5",
          f"mean over the cases that slip between {CONTACTS_LOST[0]:g} and {CONTACTS_LOST[1]:g}", contacts_drop, majority(contacts_drop, "")),
    Claim("e, force", "The largest contact force in the gouge grows about tenfold", "Fig. 5",
          f"mean over the cases that slip between {FORCE_GROWTH[0]:g} and {FORCE_GROWTH[1]:g}", largest_force_grows, majority(largest_force_grows, "")),
    Claim("f", "sigma_n at onset is that of Coulomb friction, (sigma_v - mu p)/(1 - mu), in order of magnitude", "Fig. 6",
          f"ratio between {COULOMB_RATIO[0]:g} and {COULOMB_RATIO[1]:g} in cases 1 to 4, mu from the dry case",
          coulomb, majority(coulomb, "(worst ratio)")),
    Claim("g", "No bond breaks in the blocks", "Table I", "no broken bond in any case", bonds_hold, majority(bonds_hold, "bonds broken")),
)
