"""The loop of a run: pressure on the grains, steps of the engine, measures, snapshots, checkpoints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from coupling.case.run_case import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.fluid.intervals import EvenIntervals
from coupling.measures.fault import Measures
from coupling.measures.sample import SampleMeasures
from coupling.measures.watch import Watch
from coupling.results import checkpoint
from coupling.results.output import RunOutput
from coupling.results.phases import Phases
from coupling.results.progress import Progress
from coupling.scene.walls import SceneWalls
from coupling.signals import StopRequest
from coupling.stages.prepared import load_deck_digest


@dataclass
class Ending:
    """How a run ended: `reason` in words, whether all of its steps were made, and the signal that stopped it, 0 for none."""

    reason: str
    complete: bool
    signal: int = 0


class Loading:
    """One run from the start of loading, or from a checkpoint, to its end.

    state: the driver's state as a checkpoint holds it. worst, last: largest values of the run so far, and the last line of its history.
    """

    def __init__(self, case: RunCase, engine: Engine, comm, flow, walls: SceneWalls, measures: Measures | SampleMeasures, output: RunOutput,
                 snapshots, phases: Phases, state: dict):  # fmt: skip
        self._case, self._engine, self._comm = case, engine, comm
        self._flow, self._measures, self._output, self._snapshots, self._phases = flow, measures, output, snapshots, phases
        self._intervals = flow.intervals or EvenIntervals(case.flow.interval_steps)
        self.walls = walls
        self._reference, self._stage = state["reference"], state["stage"]
        self._broken = list(state["broken"])
        self._steps = case.loading_steps
        self._watch = Watch(case, engine, comm, walls, flow, state["watch"])
        self.uncounted = self._watch.uncounted
        self.worst: dict[str, float] = dict(state["worst"])
        self.last: dict[str, float] = dict(state["last"])

    def run(self, progress: Progress) -> Ending:
        """Make the remaining steps. A signal, or the parting of the blocks, ends the run after the current interval."""
        case, engine = self._case, self._engine
        intervals = self._intervals
        every_history, every_checkpoint = case.output.history_interval_steps, case.output.checkpoint_every_steps
        if engine.step == 0:
            self._exchange()
        # From a checkpoint, with the pore forces that its grains carry.
        engine.run(0, setup=True)
        if engine.step == 0:
            self._measure()
            self._snapshot()
        with StopRequest() as stop:
            while engine.step < self._steps:
                # Steps at which something is only written must not change what is computed.
                if intervals.begins(engine.step):
                    self._exchange()
                steps = self._next_event(engine.step) - engine.step
                self._flow.advance(steps)
                ended = self._ending(stop)
                if engine.step % every_history == 0 or engine.step >= self._steps or ended:
                    self._measure()
                    progress.show(engine.step / self._steps, self._measures.line(self.last))
                    ended = ended or self._ending(stop)
                self._snapshot(last=ended is not None)
                if every_checkpoint and engine.step % every_checkpoint == 0 and engine.step < self._steps:
                    restart = self._checkpoint()
                    if not ended:
                        self._go_on_as_from(restart)
                if ended:
                    return ended
        return Ending(f"the end of loading{self._measures.shortfall(self.last)}", complete=True)

    def _go_on_as_from(self, restart: Path) -> None:
        """Make anew what a run that starts from this checkpoint has to make: the neighbour list, the forces and all of the flow, so that both go on
        with the same bits. restart: the engine's file in it."""
        self._engine.run(0, setup=True)
        saved = None
        with raised_together(self._comm):
            saved = checkpoint.flow_arrays(restart)
        self._flow.synchronise(saved)

    def _next_event(self, step: int) -> int:
        """The next step at which something has to be done."""
        due = [every for every in (self._case.output.history_interval_steps, self._case.output.checkpoint_every_steps) if every]
        return min(self._steps, self._intervals.end_after(step), *((step // n + 1) * n for n in due), *(s for s in self._snapshots.steps if s > step))

    @property
    def broken(self) -> dict[str, int]:
        """Bonds broken since loading began, by mode."""
        return dict(zip(("tension", "shear"), self._broken))

    @property
    def _time(self) -> float:
        return self._engine.step * self._engine.time_step

    def _now(self) -> tuple[float, float, float]:
        """How far the ramp of the pressures has gone, 0 to 1, strain, and time, s."""
        return self._measures.progress(self._engine, self._time), self._measures.strain(self._engine), self._time

    def _exchange(self) -> None:
        self._flow.update(*self._now())

    def _measure(self) -> None:
        with self._phases.timed("measures"):
            rows = self._take_breaks()
            figures = self._flow.figures(*self._now()) | {
                "bonds_broken_tension": self._broken[0], "bonds_broken_shear": self._broken[1], "mesh_rebuilds": self._flow.meshes.get("rebuilt", 0)}  # fmt: skip
            row = self._measures.row(self._engine, self._comm, self._time, figures)
        with self._phases.timed("output"), raised_together(self._comm):
            self._output.history(row)
            self._output.breaks(rows, self._measures.strain(self._engine))
        self.last = row
        with self._phases.timed("measures"):
            watched = self._watch.look(row, self._flow.residuals)
        for name, value in (self._flow.residuals | self._measures.quality(row) | watched).items():
            self.worst[name] = max(self.worst.get(name, 0.0), value)

    def _take_breaks(self) -> list:
        """Bonds broken since they were last asked for, of all ranks; counted."""
        rows = [row for part in self._comm.allgather(self._engine.take_breaks()) for row in part]
        for broken in rows:
            self._broken[0 if int(broken[3]) == 1 else 1] += 1
        return rows

    def _snapshot(self, last: bool = False) -> None:
        if self._engine.step in self._snapshots.steps or (last and self._snapshots.steps):
            with self._phases.timed("output"):
                self._snapshots.write(self._engine, self._measures.strain(self._engine), self._flow.grain_pressure())

    def _checkpoint(self) -> Path:
        """Write a checkpoint; the engine's file in it."""
        # Those broken since the last line of the history are in no restart file of the engine's.
        with self._phases.timed("measures"):
            rows = self._take_breaks()
        with self._phases.timed("output"):
            with raised_together(self._comm):
                self._output.breaks(rows, self._measures.strain(self._engine))
            arrays = self._flow.state()
            state = {
                "step": self._engine.step,
                "reference": self._reference,
                "stage": self._stage,
                "decks_sha256": load_deck_digest(self._case),
                "broken": self._broken,
                "flow_counts": self._flow.counts(),
                "phases": self._phases.state(self._comm),
                "previous": self._measures.previous,
                "worst": self.worst,
                "last": self.last,
                "watch": self._watch.state,
                "ranks": self._comm.size,
                "case_sha256": checkpoint.case_digest(self._case),
                "tables": self._output.lengths(),
            }
            return checkpoint.write(self._output.directory, self._engine, self._comm, state, arrays)

    def _ending(self, stop: StopRequest) -> Ending | None:
        received = stop.agreed(self._comm)
        if received:
            return Ending(f"stopped by signal {received} at step {self._engine.step}", complete=False, signal=received)
        reason = self._measures.ending(self.last) if self.last else None
        return Ending(reason, complete=True) if reason else None
