"""Scenes of grains and fluid together, two-way: extremes of the fluid, loads beyond what grains bear, and the limits of either split."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from coupling.case.run_case import RunCase
from coupling.case.staggered_limit import layers_of
from coupling.errors import ComputationError, InputError
from coupling.stability.grain_limits import GROWN, PERTURBED, AtRest
from coupling.stability.grain_scenes import sheared
from coupling.stability.program_run import Ran, judged, run
from coupling.stability.scene import FAILED, REFUSED, STABLE, STOPPED, Outcome, Scene, bisected, limit
from coupling.stability.small_cases import FAULT, UPRIGHT, WET
from coupling.stages import prepared
from coupling.stages.deck_variables import fault_geometry

WATER = 4.6e-10
FIXED = 'sample.walls={ z_top = "fixed" }'
#: A fluid ten times as stiff as water, which answers at solves alone.
STIFF_LATE = (f"fluid.compressibility_per_Pa={WATER / 10}", 'flow.split="staggered"')


def intervals(steps: int) -> tuple[str, str]:
    """`--set` values: steps between solves, and lines of the history that fall on them."""
    return f"flow.interval_steps={steps}", f"output.history_interval_steps={steps * max(1, 20 // steps)}"


def borne(ran: Ran) -> tuple[bool, str]:
    """Whether the top bears its load, grains and fluid together."""
    stress, pressure = ran.history["sigma_z_Pa"][-1], ran.history["pressure_max_Pa"]
    words = f"top bears {stress / 1.1e7:.4f} of its load, pressure up to {max(pressure) / 1e6:.3g} MPa, work {ran.figures['work_residual']:.1e}, mass {ran.figures['mass_residual']:.1e}"
    return abs(stress / 1.1e7 - 1.0) < 0.05 and max(pressure) < 5e6, words


def at_rest(ran: Ran) -> tuple[bool, str]:
    """Whether a pack between fixed walls stays at rest."""
    energy, ratio = ran.figures["energy_gain"], ran.figures["unbalanced_force_ratio"]
    return energy < 1e-6 and ratio < 0.05, f"at rest: energy gain {energy:.1e}, unbalanced force {ratio:.1e} of the mean contact force"


def pressed(ran: Ran) -> tuple[bool, str]:
    """Where the fluid alone decides: balances, and overlaps that stay small."""
    overlap = ran.figures["overlap_max_over_d"]
    return overlap < 0.05, f"work {ran.figures['work_residual']:.1e}, mass {ran.figures['mass_residual']:.1e}, overlap {overlap:.1e} d"


def wet(*settings: str, figure=borne):
    """Act of a scene on the wet box of grains."""
    return lambda directory: judged(run(directory, WET, *settings), figure)


def case_of(directory: Path, *settings: str) -> RunCase:
    from coupling.case.files import load_case

    directory.mkdir(parents=True, exist_ok=True)
    (directory / "case.toml").write_text(WET)
    return load_case(directory / "case.toml", settings).runs[0]


class Wet(AtRest):
    """A wet pack at rest, that can be run past what the program would refuse."""

    def moves(self, fraction: float, interval: int, steps: int) -> bool:
        """Whether a small motion grows in so many steps with this time step and interval."""
        from coupling.fluid.held_pressure import OfSample
        from coupling.results.phases import Phases
        from coupling.fluid.two_way_flow import TwoWayFlow
        from coupling.scene.walls import SceneWalls

        case = dataclasses.replace(
            self.case, loading=dataclasses.replace(self.case.loading, time_step_fraction=fraction),
            flow=dataclasses.replace(self.case.flow, interval_steps=interval))  # fmt: skip
        engine = self.engine(case.time_step_s)
        box = fault_geometry(case, self.stage.manifest["geometry"], case.pack.box_m[2])
        walls = SceneWalls("sample", box.lower, box.upper, {})
        flow = TwoWayFlow(case, engine, self._comm, walls, OfSample(case), box.lower, box.upper, Phases(), {}, refuse_unstable=False)

        def kinetic() -> float:
            return float(engine.atom("rmass") @ (engine.atom("v") ** 2).sum(axis=1))

        try:
            flow.update(0.0, 0.0, 0.0)
            engine.run(0, setup=True)
            engine.atom("v")[:] = PERTURBED * np.random.default_rng(1).normal(size=engine.atom("v").shape)
            before = kinetic()
            largest = 0.0
            while engine.step < steps:
                if engine.step:
                    flow.update(0.0, 0.0, 0.0)
                flow.advance(interval)
                largest = max(largest, kinetic()) if engine.step > steps // 2 else 0.0
            engine.close()
        except ComputationError:
            return True
        return largest > GROWN * before


def _at_rest(directory: Path, *settings: str) -> Wet:
    from mpi4py import MPI

    from coupling.engine.liggghts import LiggghtsEngine

    case = case_of(directory, *settings)
    stage = prepared.prepare(case, MPI.COMM_SELF, LiggghtsEngine, lambda text: None)
    return Wet(case, stage, directory)


def undrained_limit(compressibility: float):
    """Act: the longest stable step of grains whose pores do not drain, against what is refused."""

    def act(directory: Path) -> Outcome:
        pack = _at_rest(directory, f"fluid.compressibility_per_Pa={compressibility}", "material.local_damping=0.0")
        # What the program names when it is asked for the longest step that contacts alone bear.
        refused = run(directory / "asked", WET, f"fluid.compressibility_per_Pa={compressibility}", FIXED, "material.local_damping=0.0", "loading.time_step_fraction=0.81")
        if refused.status != InputError.exit_status or "cannot drain in it" not in refused.said:
            return Outcome(FAILED, f"not refused: {refused.said[-200:]}")
        words = refused.said.split("poreslip: ", 1)[1]
        predicted = float(words.split("cannot drain in it, ")[1].split(" s")[0]) / pack.case.critical_time_step_s
        found = bisected(lambda fraction: not pack.moves(fraction, 600, 600), 0.5 * predicted, 2.0 * predicted)
        # Contacts and fluid add up only where the same motion is the stiffest of both.
        return limit(found, predicted, "of 0.63 sqrt(m_min/k_n)", "600 steps without a solve; the program refuses longer ones", 0.45)

    return act


def with_solves(directory: Path) -> Outcome:
    """The same with a solve after every step, which takes nothing from the limit."""
    pack = _at_rest(directory, "fluid.compressibility_per_Pa=1e-12", "material.local_damping=0.0", "fluid.viscosity_Pa_s=1e-3")
    without = bisected(lambda fraction: not pack.moves(fraction, 300, 300), 0.05, 0.5)
    found = bisected(lambda fraction: not pack.moves(fraction, 1, 300), 0.05, 0.5)
    return limit(found, 0.99 * without, "of 0.63 sqrt(m_min/k_n)", "a solve after every step, against none in 300", 1.0)


def staggered_limit(directory: Path) -> Outcome:
    """The longest interval for which pressures may stand still."""
    pack = _at_rest(directory, f"fluid.compressibility_per_Pa={WATER / 10}", "flow.interval_steps=1", 'flow.split="staggered"')
    predicted = layers_of(pack.case).longest_interval()
    found = 1
    for interval in sorted({max(1, round(predicted * 2.0 ** (k / 2.0))) for k in range(-4, 5)}):
        if pack.moves(0.25, interval, 2000 // interval * interval):
            break
        found = interval
    sound = 0.5 * predicted <= found <= 4.0 * predicted
    return Outcome(STABLE if sound else FAILED, "a small motion that grows within 2000 steps; the program refuses twice the predicted interval", found, predicted, "steps")


def servo_limit(directory: Path) -> Outcome:
    """Runs whose wall holds a stress, against the interval that the refusal of a longer one names."""
    base = (*STIFF_LATE, "sample.loading_time_s=6e-5")
    refused = run(directory / "asked", WET, *base, *intervals(12))
    if refused.status != InputError.exit_status or "answers its servo only at the solves" not in refused.said:
        return Outcome(FAILED, f"not refused: {refused.said[-200:]}")
    predicted, found = int(refused.said.split("Set ")[1].split(" or fewer")[0]), 0
    for steps in range(1, 13):
        ran = run(directory / str(steps), WET, *base, *intervals(steps), unrefused=True)
        if judged(ran, borne).ended != STABLE:
            break
        found = steps
    sound = predicted <= found <= 2 * predicted
    return Outcome(STABLE if sound else FAILED, "runs past what is refused, 1200 steps of the engine", found, predicted, "steps")


def named_step(directory: Path) -> Outcome:
    """The time step that a refusal names, with its interval."""
    base = (f"fluid.compressibility_per_Pa={WATER / 100}", 'flow.split="predicted"', *intervals(50), FIXED, "fluid.faces={ zmin = 1e6 }")
    refused = run(directory / "asked", WET, *base, "loading.time_step_fraction=0.7")
    if refused.status != InputError.exit_status or "cannot drain in it" not in refused.said:
        return Outcome(FAILED, f"not refused: {refused.said[-200:]}")
    fraction = refused.said.split("Set ")[1].split(",")[0]
    outcome = judged(run(directory, WET, *base, f"loading.time_step_fraction={fraction}"), pressed)
    return dataclasses.replace(outcome, figure=f"loading.time_step_fraction = {fraction}: {outcome.figure}")


def slipped(ran: Ran) -> tuple[bool, str]:
    """Of an upright fault: walls hold their stress while it shears."""
    stress, gain = ran.history["sigma_h_left_Pa"][-1], ran.figures["energy_gain"]
    slip = ran.history["slip_left_m"][-1]
    return abs(stress / 4e7 - 1.0) < 0.1, f"x wall bears {stress / 4e7:.3f} of its load, slip {1e6 * slip:.2g} um, energy gain {gain:.1e}"


def flowing(case: str, figure, split: str, factor: float, decks: dict[str, str] | None = None, extra: tuple[str, ...] = ()):
    """Act: a fault with pressure on its left and a flow that is solved two-way; factor: times water's compressibility."""
    wet = case.replace('pressure.mode = "none"', 'pressure.left_target_Pa = 1e7\nflow.kind = "solve"\nflow.interval_steps = 10')
    settings = (f'flow.split="{split}"', f"fluid.compressibility_per_Pa={factor * WATER}", *extra)
    return lambda directory: judged(run(directory, wet, *settings, decks=decks), figure)


def lifted(ran: Ran) -> tuple[bool, str]:
    """Of a fault whose pressure exceeds the vertical stress: the plates part, and the run says so."""
    opened = ran.history["vertical_strain"][-1]
    return opened > 0.0, f"vertical strain {opened:.2g} (opening), energy gain {ran.figures['energy_gain']:.1e}"


def above_stress(directory: Path) -> Outcome:
    """2.5e7 Pa of pore pressure in blocks that bear 1e7 Pa."""
    case = FAULT.replace('pressure.mode = "none"', 'pressure.mode = "uniform"\npressure.left_target_Pa = 2.5e7\npressure.right_target_Pa = 2.5e7')
    return judged(run(directory, case, "loading.horizontal_strain=2e-3", "output.history_interval_steps=50"), lifted)


def scenes() -> list[Scene]:
    """All of them, in the order of the table."""
    found = []
    for factor, expected in ((1e-4, REFUSED), (1e-2, REFUSED), (0.1, STABLE), (1.0, STABLE), (1e2, STABLE), (1e4, STABLE)):
        act = wet(f"fluid.compressibility_per_Pa={factor * WATER}")
        found.append(Scene(f"coupling/compressibility/{factor:g}", f"{factor:g} times water's compressibility", (expected,), act, quick=factor == 1e-4))
    found += [
        Scene("coupling/compressibility/0", "incompressible, undrained split", (REFUSED,), wet("fluid.compressibility_per_Pa=0.0"), quick=True),
        Scene("coupling/compressibility/0_staggered", "incompressible, staggered split", (STABLE, REFUSED),
              wet("fluid.compressibility_per_Pa=0.0", 'flow.split="staggered"', "flow.interval_steps=1", "fluid.viscosity_Pa_s=1e-3")),
    ]  # fmt: skip
    found += [Scene(f"coupling/viscosity/{eta:g}", f"viscosity {eta:g} Pa s", (STABLE,), wet(f"fluid.viscosity_Pa_s={eta}")) for eta in (1e-6, 1e-3, 1.0, 1e3)]
    found += [Scene(f"coupling/undrained/limit/{b:g}", f"longest stable step, undrained, compressibility {b:g} 1/Pa", (STABLE,), undrained_limit(b)) for b in (4.6e-11, 4.6e-12)]
    found.append(Scene("coupling/undrained/limit/solves", "longest stable step with a solve after each", (STABLE,), with_solves))
    found += [Scene(f"coupling/undrained/interval/{n}", f"undrained split, {n} steps between solves", (STABLE,),
                    wet(f"fluid.compressibility_per_Pa={WATER / 10}", f"flow.interval_steps={n}", f"output.history_interval_steps={max(n, 20)}"), quick=n == 200)
              for n in (1, 10, 50, 200)]  # fmt: skip
    found.append(Scene("coupling/staggered/limit", "longest stable interval, staggered split", (STABLE,), staggered_limit))
    for share, expected in ((0.1, (STABLE,)), (1.0, (STABLE,)), (2.0, (STABLE, STOPPED)), (8.0, (REFUSED,))):
        def act(directory: Path, share: float = share) -> Outcome:
            predicted = layers_of(case_of(directory, *STIFF_LATE, *intervals(1))).longest_interval()
            steps = max(1, round(share * predicted))
            outcome = judged(run(directory, WET, *STIFF_LATE, *intervals(steps), FIXED, "fluid.faces={ zmin = 1e6 }"), pressed)
            return dataclasses.replace(outcome, figure=f"{steps} steps; {outcome.figure}")

        what = f"staggered split at {share:g} of the predicted interval, fixed walls, 1e6 Pa at a face at once"
        found.append(Scene(f"coupling/staggered/interval/{share:g}", what, expected, act, quick=share == 8))
    found.append(Scene("coupling/staggered/servo", "longest stable interval, staggered split, behind a wall that holds a stress", (STABLE,), servo_limit))
    found += [Scene(f"coupling/predicted/interval/{n}", f"predicted split, {n} steps between solves", (STABLE,),
                    wet(f"fluid.compressibility_per_Pa={WATER / 10}", 'flow.split="predicted"', *intervals(n)))
              for n in (1, 10, 50, 200)]  # fmt: skip
    found.append(Scene("coupling/predicted/step", "predicted split at the step that the refusal of a longer one names, 50 steps between solves", (STABLE,), named_step))
    for split in ("undrained", "predicted", "staggered"):
        for factor, expected in ((1.0, STABLE), (1e-3, REFUSED if split != "staggered" else STABLE)):
            what = f"fault with flow between its blocks, {split} split, {factor:g} times water's compressibility"
            # At half of the contacts' step, the default, packs of other ranks lie on both sides of what water allows.
            found.append(Scene(f"coupling/fault/{split}/{factor:g}", what, (expected,), flowing(FAULT, sheared, split, factor, extra=("loading.time_step_fraction=0.4",))))
    found.append(Scene("coupling/fault/plates", "fault with flow, 0.01 times water's compressibility, at a step that it bears: the plates' servos do not", (REFUSED,),
                       flowing(FAULT, sheared, "undrained", 1e-2, extra=("loading.time_step_fraction=0.2",))))
    found.append(Scene("coupling/supplement", "upright fault under shear stress, undrained split", (STABLE,), flowing(UPRIGHT, slipped, "undrained", 1.0)))
    found.append(Scene("coupling/supplement/step_of_deck", "the same, staggered split, with a step of twice the limit, set in a deck", (STOPPED,),
                       flowing(UPRIGHT, slipped, "staggered", 1.0, {"in.load_supplement": "timestep 2.1e-7"})))
    found += [
        Scene("coupling/jump", "1e8 Pa at a face at once, pack under 1e7 Pa between fixed walls", (STABLE, STOPPED), wet("fluid.faces={ zmin = 1e8 }", FIXED, figure=pressed)),
        Scene("coupling/jump_servo", "1e8 Pa below a wall that holds 1.1e7 Pa", (STABLE, STOPPED), wet("fluid.faces={ zmin = 1e8 }", figure=pressed)),
        Scene("coupling/above_stress", "pore pressure 2.5 times the vertical stress, prescribed in a fault", (STABLE,), above_stress),
        Scene("coupling/at_rest", "pack between fixed walls, water, 600 steps", (STABLE,), wet(FIXED, figure=at_rest), quick=True),
        Scene("coupling/porosity_0.9", "porosity 0.9 asked for, wet", (REFUSED, STOPPED), wet("pack.porosity=0.9")),
        Scene("coupling/graded", "sizes 10 apart, wet", (STABLE, REFUSED),
              wet("pack.box_m=[0.02, 0.02, 0.02]", "pack.diameter_m=[5e-4, 5e-3]", f"fluid.compressibility_per_Pa={WATER * 10}")),
    ]  # fmt: skip
    return found
