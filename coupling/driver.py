"""From a case file to finished runs."""

from __future__ import annotations

import json
import math
from pathlib import Path

from coupling.case.run_case import CaseFile, RunCase
from coupling.collective import raised_together
from coupling.engine.liggghts import LiggghtsEngine
from coupling.errors import InputError
from coupling.fluid.pore_pressure import PrescribedPressure
from coupling.loading import Ending, Loading
from coupling.measures.of_case import measures_of
from coupling.memory import refuse_too_large
from coupling.plan import plan
from coupling.report import write_report
from coupling.results import checkpoint
from coupling.results.output import RunOutput, write_atomically
from coupling.results.phases import Phases
from coupling.results.progress import Progress
from coupling.run_options import RunOptions
from coupling.scene.walls import SceneWalls
from coupling.stages import prepared
from coupling.stages.deck_variables import fault_geometry, load_variables, plate_areas


def run_case_file(case_file: CaseFile, options: RunOptions) -> int:
    """Run every run of a case file, one after the other; return the exit status, the same on all ranks."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if options.dry_run:
        if comm.rank == 0:
            print(plan(case_file, comm.size))
        return 0
    base = options.output_root / case_file.stem
    if options.restart is None:
        with raised_together(comm):
            if comm.rank == 0:
                base.mkdir(parents=True, exist_ok=True)
                names = {"case": case_file.stem, "runs": [run.name for run in case_file.runs], "seed": [run.pack.seed for run in case_file.runs]}
                write_atomically(base / "runs.json", json.dumps(names, indent=2) + "\n")
    for run in case_file.runs:
        ending = Run(run, options.restart or base / run.name, comm, options.refuse_unstable).carry_out(restart=options.restart is not None)
        if ending.signal:
            return 128 + ending.signal
    return 0


class Run:
    """One run: its stages, its loading, its report."""

    def __init__(self, case: RunCase, directory: Path, comm, refuse_unstable: bool):
        self.case, self.directory, self.comm, self.refuse_unstable = case, directory, comm, refuse_unstable
        self.phases = Phases()
        self._measures = measures_of(case)

    def carry_out(self, restart: bool) -> Ending:
        """Run from the start, or from the newest checkpoint of the directory; collective."""
        case, comm = self.case, self.comm
        state = None
        if restart:
            with raised_together(comm):
                restart_file, state = checkpoint.read(self.directory, case)
            stage = prepared.Stage(restart_file, state["stage"])
            self.phases.resume(state["phases"], state["step"], comm)
            if state["ranks"] != comm.size:
                self._tell(f"the checkpoint is of {state['ranks']} ranks and goes on with {comm.size}: the same to rounding, not bitwise")
            if state["decks_sha256"] != prepared.load_deck_digest(case):
                self._tell("the loading deck was changed since the checkpoint was written: the run goes on with what it says now")
        else:
            refuse_too_large(case, comm)
            with self.phases.timed("stages"):
                stage = prepared.prepare(case, comm, LiggghtsEngine, self._tell)
        fault = fault_geometry(case, stage.manifest["geometry"], case.pack.box_m[2])
        walls = SceneWalls(case.scene, fault.lower, fault.upper, plate_areas(case, fault))

        output = None
        with raised_together(comm):
            output = RunOutput(self.directory, comm, self._measures.columns(case), case.bonded, state["tables"] if state else None)
        with raised_together(comm):
            output.json("case.json", case.to_dict())
        # LIGGGHTS begins its log anew: that of the run before the checkpoint stays.
        engine = LiggghtsEngine(comm, self.directory / (f"log-from-{state['step']}.liggghts" if state else "log.liggghts"))
        with self.phases.timed("engine"):
            engine.define(prepared.results_variable([prepared.load_deck(case)], self.directory))
            engine.deck(prepared.load_deck(case), load_variables(case, stage.restart, fault), stage.manifest["grains"])
            _require(case, engine)
        self._tell_of_the_deck(engine)
        if state is None:
            state = self._initial_state(engine, fault, walls) | {"stage": stage.manifest}
        saved = None
        with raised_together(comm):
            saved = checkpoint.flow_arrays(stage.restart)
        measures = self._measures(case, fault, walls, state["reference"])
        measures.resume(state["previous"])
        flow = self._flow(engine, fault, walls, measures, saved)
        if restart:
            flow.resume(state["flow_counts"])
        snapshots = self._snapshots(state["step"] if restart else None)
        loading = Loading(case, engine, comm, flow, walls, measures, output, snapshots, self.phases, state)
        progress = Progress(case.name, shown=comm.rank == 0)
        ending = loading.run(progress)
        progress.finish(f"{ending.reason}; {self.directory}/history.csv")
        write_report(case, comm, output, stage, state, loading, flow, engine, ending, self.phases)
        output.close()
        engine.close()
        return ending

    def _initial_state(self, engine, fault, walls) -> dict:
        """The driver's state when loading begins: nothing broken yet, and what later strains refer to."""
        engine.command("reset_timestep 0")
        # LIGGGHTS gives a new fix property/atom its default values in the first setup, not before.
        engine.run(0, setup=True)
        engine.property_atom("reference_position")[:] = engine.unwrapped_position()
        reference = self._measures.reference(engine, self.comm, fault, walls)
        return {"step": 0, "reference": reference, "broken": [0, 0], "previous": None, "worst": {}, "last": {}, "watch": None}

    def _flow(self, engine, fault, walls, measures, saved):
        from coupling.fluid import exchange

        case, comm = self.case, self.comm
        if not case.needs_mesh:
            return exchange.Dry(engine, self.phases)
        if case.flow.kind == "prescribed":
            return exchange.PrescribedFlow(case, engine, comm, walls, PrescribedPressure(case, fault), fault, self.phases)
        # The flow solver loads PETSc.
        from coupling.fluid import held_pressure
        from coupling.fluid.one_way_flow import OneWayFlow
        from coupling.fluid.two_way_flow import TwoWayFlow

        def now() -> tuple[float, float, float]:
            elapsed = engine.step * engine.time_step
            return measures.progress(engine, elapsed), measures.strain(engine), elapsed

        held = held_pressure.OfFault(case, comm, fault, PrescribedPressure(case, fault), now) if case.has_fault else held_pressure.OfSample(case)
        flow = TwoWayFlow if case.flow.two_way else OneWayFlow
        self._tell_of_the_split()
        return flow(case, engine, comm, walls, held, fault.lower, fault.upper, self.phases, saved, self.refuse_unstable)

    def _tell_of_the_deck(self, engine) -> None:
        """What the case's checks, and its number of steps, know nothing of."""
        case, step = self.case, engine.time_step
        if not step > 0.0:
            raise InputError(f"the deck {prepared.load_deck(case)} sets a time step of {step:g} s: it has to be above 0; leave it at ${{time_step}}, the case's")
        if not math.isclose(step, case.time_step_s, rel_tol=1e-9):
            longest = case.stable_time_step_s(case.material.local_damping, case.material.friction > 0.0)
            self._tell(f"{prepared.load_deck(case).name} sets a time step of {step:.3g} s, {step / case.time_step_s:.3g} times the case's: its {case.loading_steps} steps last "
                       f"{case.loading_steps * step:.3g} s, and limits are checked for the case's; the contacts of its grains bear {longest:.3g} s")
        for fix_id, style in engine.acting_fixes():
            if style == "nve":
                self._tell(f"{prepared.load_deck(case).name} moves grains by fix {fix_id} (nve), which never turns them, so that contacts slide where grains would roll; nve/sphere turns them")

    def _tell_of_the_split(self) -> None:
        flow = self.case.flow
        if flow.two_way and flow.split == "staggered":
            from coupling.case.staggered_limit import layers_of, range_text

            longest = layers_of(self.case).longest_interval()
            if flow.interval_steps > longest:
                self._tell(f'flow.interval_steps = {flow.interval_steps} is more than what flow.split = "staggered" bears, {range_text(longest)}')

    def _snapshots(self, resume_step: int | None):
        count, steps = self.case.output.snapshots, self.case.loading_steps
        if count == 0:
            return NoSnapshots()
        from coupling.results.snapshots import Snapshots

        wanted = {round(k * steps / max(count - 1, 1)) for k in range(count)}
        return Snapshots(self.directory, self.comm, wanted, resume_step)

    def _tell(self, text: str) -> None:
        if self.comm.rank == 0:
            print(f"{self.case.name}  {text}", flush=True)


def _require(case: RunCase, engine) -> None:
    """Refuse a deck without which the run would come to its end, and mean something else than its case."""
    engine.require_fix("reference_position", "fix reference_position all property/atom reference_position vector yes no no 0. 0. 0.")
    if case.needs_mesh:
        for name in ("pore_force", "add_pore_force"):
            engine.require_fix(name, "include ${inputs}/pore_force_${pore_force}.include")
    if case.bonded:
        engine.require_fix("bonds", "fix bonds all bond/settings armed no")


class NoSnapshots:
    """A run that asks for no snapshots: nothing is imported or written."""

    steps: frozenset[int] = frozenset()
