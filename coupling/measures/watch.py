"""Whether a run is still sound: numbers finite, grains in the box and not pressed into each other, no energy from nothing.

Looked at with every line of the history, so that a run which has become unstable ends with a message and not with a wrong result.
"""

from __future__ import annotations

import math

import numpy as np

from coupling.case.run_case import RunCase
from coupling.engine.interface import Engine
from coupling.errors import ComputationError
from coupling.scene.walls import SceneWalls

#: Largest overlap over a mean diameter: beyond it a contact is no longer small against its grains, neither the linear law nor the pores mean anything.
MOST_OVERLAP = 0.2
#: Energy of the grains that no work accounts for, over what they had and what was done on them: a stable run has none of it.
MOST_ENERGY_GAIN = 0.1
#: Fixes whose work is counted, or that can only take energy: by style, and of styles that can do anything those of the decks by their ids.
COUNTED_STYLES = {
    "bond/settings", "contacthistory", "damping/local", "freeze", "nve", "nve/limit", "nve/sphere", "poreforce", "poreforce/two_way", "setforce", "viscous"}  # fmt: skip
COUNTED_FIXES = {"add_pore_force", "shear_left", "shear_right"}


class Watch:
    """Looks after one run; methods are collective.

    flow: whose `work_on_grains` is this rank's share of the fluid's work, J. state: `state` of the checkpoint that the run goes on from, if any.
    """

    def __init__(self, case: RunCase, engine: Engine, comm, walls: SceneWalls, flow, state: dict | None):
        self._case, self._engine, self._comm, self._walls, self._flow = case, engine, comm, walls, flow
        #: Fixes of the deck's own that may do work which is not counted: with them energy from nothing is no sign of anything.
        self.uncounted = [
            f"fix {name} ({style})" for name, style in engine.acting_fixes()
            if style not in COUNTED_STYLES and name not in COUNTED_FIXES and name not in walls.plates]  # fmt: skip
        self._start: dict[str, float] | None = state["start"] if state else None
        self._fluid_work = state["fluid_work"] if state else 0.0

    @property
    def state(self) -> dict:
        """What a checkpoint has to hold of it."""
        return {"start": self._start, "fluid_work": self._comm.allreduce(self._flow.work_on_grains) + self._fluid_work}

    def look(self, row: dict[str, float], residuals: dict[str, float]) -> dict[str, float]:
        """Raise ComputationError if the run is unsound at this line of its history; figures to keep the worst of. residuals: the flow's."""
        self._finite(row, row | residuals)
        if row["overlap_max_over_d"] > MOST_OVERLAP:
            raise ComputationError(
                f"step {row['step']}: two grains overlap by {row['overlap_max_over_d']:.3g} of a mean diameter, more than {MOST_OVERLAP:g}, where contacts "
                "mean nothing any more. Raise material.modulus_Pa or lower the stress; if the run was calm before, it is unstable: "
                f"{self._advice()}")
        energy = self._energies(row)
        if self._start is None:
            self._start = energy
        gain, size = self._gain(energy)
        if gain > MOST_ENERGY_GAIN * size and not self.uncounted:
            raise ComputationError(
                f"step {row['step']}: the grains hold {energy['held']:.3g} J, {gain:.3g} J more than they had and than walls and fluid gave them "
                f"({size:.3g} J): the motion is unstable: {self._advice()}")
        return {"energy_gain": max(gain, 0.0) / size if size > 0.0 else 0.0}

    def _advice(self) -> str:
        """What makes an unstable run stable."""
        case = self._case
        advice = f"lower loading.time_step_fraction, {case.loading.time_step_fraction:g}"
        if case.flow.kind == "solve" and case.flow.two_way and case.flow.split == "staggered":
            return f'with flow.split = "staggered" a fluid must not be stiffer than the skeleton: set "undrained", or {advice} and flow.interval_steps'
        return advice

    def _finite(self, row: dict[str, float], figures: dict[str, float]) -> None:
        bad = [name for name, value in figures.items() if not math.isfinite(value)]
        if bad:
            raise ComputationError(
                f"step {row['step']}: {', '.join(bad)} is not a finite number: the run has become unstable: "
                f"{self._advice()}; the last sound state is in the lines before")

    def _energies(self, row: dict[str, float]) -> dict[str, float]:
        """Held by grains and contacts, given by walls and by the fluid, J. Raises if a grain has gone through a wall."""
        engine, stiffness = self._engine, self._case.normal_stiffness_N_per_m
        state = self._walls.states(engine)
        depth, worst, wall = 0.0, -np.inf, ""
        squeezed = 0.0
        for name, gap, radius in self._walls.gaps(engine, state):
            overlap = np.maximum(radius - gap, 0.0)
            squeezed += float(overlap @ overlap)
            depth = float((-gap / radius).max(initial=-np.inf))
            if depth > worst:
                worst, wall = depth, name
        deepest, at = max(self._comm.allgather((worst, wall)))
        if deepest > 0.0:
            raise ComputationError(
                f"step {row['step']}: the centre of a grain has gone through the wall {at}, by {deepest:.3g} of its radius. The wall or the grain moves "
                "too fast for the time step, or the stress is too high for the stiffness: lower the speed or loading.time_step_fraction")
        squeezed, fluid = self._comm.allreduce(np.array([0.5 * stiffness * squeezed, self._flow.work_on_grains]))
        held = row["kinetic_energy_J"] + row["contact_energy_J"] + float(squeezed)
        walls = sum(one.work for one in state.values())
        return {"held": held, "walls": walls, "grips": self._grip_work(), "fluid": float(fluid) + self._fluid_work}

    def _grip_work(self) -> float:
        """Work of the supplement's shear stress up to now, but for a constant, J: its grips share a force along z alike among their grains."""
        if self._case.scene != "supplement":
            return 0.0
        engine = self._engine
        height, mask = engine.unwrapped_position()[:, 2], engine.atom("mask")
        grips = [mask & engine.group_bit(f"{side}_grip") != 0 for side in ("left", "right")]
        left, left_count, right, right_count = self._comm.allreduce(np.array([part for grip in grips for part in (height[grip].sum(), grip.sum())], dtype=float))
        force = self._case.supplement.shear_stress_Pa * self._walls.x_wall_area
        return float(force * (right / right_count - left / left_count))

    def _gain(self, energy: dict[str, float]) -> tuple[float, float]:
        """Energy that no work accounts for, and what there was and was done, J."""
        done = [energy[name] - self._start[name] for name in ("walls", "grips", "fluid")]
        return energy["held"] - self._start["held"] - sum(done), self._start["held"] + sum(abs(work) for work in done)
