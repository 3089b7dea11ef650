"""Figures of a run with the range in which they may lie, in one table; a run warns of those that leave it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

_SLOWER = "lower loading.strain_rate_per_s"
#: The same where another input drives the scene.
_SLOWER_IN = {
    "supplement": "raise supplement.ramp_time_s",
    "sample": "lower the speeds in sample.walls, or raise sample.ramp_time_s",
}


@dataclass(frozen=True)
class StatedRange:
    """highest: where the range ends; all figures are 0 or above. what: the figure in words. advice: what it means that it is larger."""

    highest: float
    what: str
    advice: str


STATED_RANGES: dict[str, StatedRange] = {
    "unbalanced_force_ratio": StatedRange(
        5e-2, "mean resultant force on a grain over the mean contact force", f"the loading is not quasi-static: {_SLOWER}"),
    "inertial_number": StatedRange(
        1e-2, "strain rate times d sqrt(density / stress)", f"the grains flow inertially: {_SLOWER}, or pack.density_kg_m3"),
    # Within it the onset of slip is that of half the rate to 5 % (cases/studies/loading_onset.toml).
    "loading_rate": StatedRange(
        5e-2, "way of a driven wall in a step over the mean overlap of contacts", f"a wall outruns the contact forces: {_SLOWER}"),
    "wall_stress_difference": StatedRange(
        0.1, "difference of the stresses on the left and the right wall over their mean", f"the walls do not bear the same stress: {_SLOWER}"),
    "held_stress_error": StatedRange(
        0.1, "difference of a stress that walls hold from the one asked for, over the latter",
        "walls do not hold their stress: the grains give way faster than the walls may follow (wall_speed_limited_steps in report.json), as they do once a fault has "
        f"failed, or the load rises as fast as a wave: {_SLOWER}"),
    "overlap_max_over_d": StatedRange(
        2e-2, "largest overlap over the mean diameter", "grains overlap by more than 2 % of d: raise material.modulus_Pa, or lower the stress"),
    "energy_gain": StatedRange(
        1e-3, "energy of the grains that no work accounts for, over all that they had and were given", "the motion is unstable: lower loading.time_step_fraction"),
    # Of an interval's throughput, which is next to nothing in a sealed pack at rest.
    "mass_residual": StatedRange(
        1e-8, "fluid that an interval gains over its throughput", "the balance of the fluid's mass does not close: the linear solver did not converge far enough"),
    "remesh_mass_residual": StatedRange(
        1e-12, "fluid that a change of mesh gains over what there is", "fluid was lost in a change of mesh: a defect, please report it"),
    "momentum_residual": StatedRange(
        1e-10, "resultant of the fluid's forces on grains and walls over the sum of their sizes",
        "the fluid's forces on grains and walls do not sum to zero: a defect, please report it"),
    "work_residual": StatedRange(
        1e-10, "the fluid's work less that on grains and walls, over the latter", "the fluid's work is not that on grains and walls: a defect, please report it"),
}  # fmt: skip
#: Of the figures above, those of the fluid: balances that close but for rounding and the linear solver's tolerance.
BALANCES = ("mass_residual", "remesh_mass_residual", "momentum_residual", "work_residual")


def warnings(worst: Mapping[str, float], scene: str = "two_sides", uncounted: Sequence[str] = ()) -> list[str]:
    """A sentence for each figure, at its worst in the run, that is outside of its range, or is no number. uncounted: fixes of the deck's own
    whose work is in no balance."""
    said = []
    for name, stated in STATED_RANGES.items():
        # What is not a number is not within.
        if name in worst and not worst[name] <= stated.highest:
            advice = stated.advice.replace(_SLOWER, _SLOWER_IN.get(scene, _SLOWER))
            if name == "energy_gain" and uncounted:
                advice = f"this is the work of {', '.join(uncounted)}, which is not counted, or {advice}"
            said.append(f"{name} reached {worst[name]:.3g}, its range ends at {stated.highest:g}: {advice}")
    return said
