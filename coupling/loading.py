"""The loop of a run: pressure on the grains, steps of the engine, measures, snapshots, checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

from coupling import checkpoint
from coupling.case_schema import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.measures import Measures
from coupling.output import RunOutput
from coupling.phases import Phases
from coupling.progress import Progress
from coupling.signals import StopRequest
from coupling.stages import load_deck_digest
from coupling.walls import SceneWalls


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

    def __init__(self, case: RunCase, engine: Engine, comm, flow, walls: SceneWalls, measures: Measures, output: RunOutput,
                 snapshots, phases: Phases, state: dict):  # fmt: skip
        self._case, self._engine, self._comm = case, engine, comm
        self._flow, self._measures, self._output, self._snapshots, self._phases = flow, measures, output, snapshots, phases
        self.walls = walls
        self._reference, self._stage = state["reference"], state["stage"]
        self._broken = list(state["broken"])
        self._rebuilds_before = state["rebuilds"]
        self._steps = case.loading_steps
        self.worst: dict[str, float] = dict(state["worst"])
        self.last: dict[str, float] = dict(state["last"])

    def run(self, progress: Progress) -> Ending:
        """Make the remaining steps. A signal, or the parting of the blocks, ends the run after the current interval."""
        case, engine = self._case, self._engine
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
                if engine.step % case.flow.interval_steps == 0:
                    self._exchange()
                steps = self._next_event(engine.step) - engine.step
                with self._phases.timed("engine"):
                    engine.run(steps, setup=False)
                ended = self._ending(stop)
                if engine.step % every_history == 0 or engine.step >= self._steps or ended:
                    self._measure()
                    progress.show(engine.step / self._steps, self._line())
                    ended = ended or self._ending(stop)
                self._snapshot(last=ended is not None)
                if every_checkpoint and engine.step % every_checkpoint == 0 and engine.step < self._steps:
                    self._checkpoint()
                    # The neighbour list, the forces and the mesh are made anew, as they are in a run that starts from here.
                    engine.run(0, setup=True)
                    self._flow.synchronise()
                if ended:
                    return ended
        return Ending("the end of loading", complete=True)

    def _next_event(self, step: int) -> int:
        """The next step at which something has to be done."""
        intervals = [self._case.flow.interval_steps, self._case.output.history_interval_steps]
        if self._case.output.checkpoint_every_steps:
            intervals.append(self._case.output.checkpoint_every_steps)
        return min(self._steps, *((step // n + 1) * n for n in intervals), *(s for s in self._snapshots.steps if s > step))

    def _progress_of_ramp(self) -> float:
        if self._case.scene == "supplement":
            return min(1.0, self._time / self._case.supplement.ramp_time_s)
        return min(1.0, self._strain / self._case.loading.horizontal_strain)

    @property
    def _time(self) -> float:
        return self._engine.step * self._engine.time_step

    @property
    def _strain(self) -> float:
        """Horizontal strain, from the x walls, positive in compression."""
        length = self._engine.wall("x_right").position - self._engine.wall("x_left").position
        return 1.0 - length / self._reference["length"]

    def _exchange(self) -> None:
        self._flow.update(self._progress_of_ramp(), self._strain, self._time)

    def _measure(self) -> None:
        with self._phases.timed("measures"):
            breaks = self._engine.take_breaks()
            rows = [row for part in self._comm.allgather(breaks) for row in part]
            for broken in rows:
                self._broken[0 if int(broken[3]) == 1 else 1] += 1
            pressures = self._flow.block_pressures(self._progress_of_ramp())
            row = self._measures.row(self._engine, self._comm, self._time, pressures, tuple(self._broken), self._rebuilds)
        with self._phases.timed("output"), raised_together(self._comm):
            self._output.history(row)
            self._output.breaks(rows, row["strain"])
        self.last = row
        self.worst["momentum_residual"] = max(self.worst.get("momentum_residual", 0.0), self._flow.momentum_residual)
        for name in ("unbalanced_force_ratio", "overlap_max_over_d", "inertial_number", "kinetic_energy_J"):
            self.worst[name] = max(self.worst.get(name, 0.0), row[name])
        left, right = row["sigma_h_left_Pa"], row["sigma_h_right_Pa"]
        self.worst["wall_stress_difference"] = max(self.worst.get("wall_stress_difference", 0.0), 2 * abs(left - right) / max(abs(left + right), 1e-300))

    def _snapshot(self, last: bool = False) -> None:
        if self._engine.step in self._snapshots.steps or (last and self._snapshots.steps):
            with self._phases.timed("output"):
                self._snapshots.write(self._engine, self._strain)

    def _checkpoint(self) -> None:
        with self._phases.timed("output"):
            state = {
                "step": self._engine.step,
                "reference": self._reference,
                "stage": self._stage,
                "decks_sha256": load_deck_digest(self._case),
                "broken": self._broken,
                "rebuilds": self._rebuilds,
                "previous": self._measures.previous,
                "worst": self.worst,
                "last": self.last,
                "ranks": self._comm.size,
                "case_sha256": checkpoint.case_digest(self._case),
                "tables": self._output.lengths(),
            }
            checkpoint.write(self._output.directory, self._engine, self._comm, state)

    @property
    def _rebuilds(self) -> int:
        return self._rebuilds_before + self._flow.rebuilds

    def _ending(self, stop: StopRequest) -> Ending | None:
        received = stop.agreed(self._comm)
        if received:
            return Ending(f"stopped by signal {received} at step {self._engine.step}", complete=False, signal=received)
        if self.last and self.last["vertical_strain"] >= self._case.loading.stop_vertical_strain and self._case.scene == "two_sides":
            return Ending(f"the blocks part: vertical strain {self.last['vertical_strain']:.3g} reached loading.stop_vertical_strain", complete=True)
        slip = max(abs(self.last.get("slip_left_m", 0.0)), abs(self.last.get("slip_right_m", 0.0))) if self.last else 0.0
        if self._case.scene == "supplement" and slip >= self._case.supplement.stop_slip_m:
            return Ending(f"the fault slips: {slip:.3g} m reached supplement.stop_slip_m", complete=True)
        return None

    def _line(self) -> str:
        row = self.last
        return f"strain {row['strain']:.2e}  sigma_n {row['sigma_n_Pa'] / 1e6:.1f} MPa  slip {1e6 * row['slip_left_m']:.0f} / {1e6 * row['slip_right_m']:.0f} um"
