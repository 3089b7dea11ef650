"""Positions out to the pore network, pressure forces back to the engine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from coupling.case.run_case import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.errors import ComputationError
from coupling.fluid.intervals import Intervals
from coupling.fluid.pore_pressure import PrescribedPressure
from coupling.measures.pressure import around_grains, beside_gouge
from coupling.results.phases import Phases
from coupling.scene.fault_geometry import FaultGeometry
from coupling.scene.walls import SceneWalls


#: What may come of an update of the mesh.
MESHES = ("kept", "repaired", "rebuilt")


class Dry:
    """No fluid: nothing is imported, allocated or computed. What a flow has to offer to the loop of a run."""

    _network = None
    #: Intervals that the flow chooses itself; none where all are of flow.interval_steps.
    intervals: Intervals | None = None
    #: Work of the pore forces on this rank's grains, J, up to now, or, two-way, the most that the fluid could give them up to the last solve.
    work_on_grains = 0.0

    def __init__(self, engine: Engine, phases: Phases):
        self._engine, self._phases = engine, phases
        #: Residuals of the last interval by name, and counts of the linear solver over the run.
        self.final: dict[str, float] = {}
        self.solver: dict[str, float] = {}
        self._meshes_before: dict[str, int] = {}

    def synchronise(self, saved: dict[str, np.ndarray]) -> None:
        """Forget what a run that starts from this point's checkpoint does not know. saved: arrays of `state`, as the checkpoint holds them."""

    def update(self, progress: float, strain: float, time: float) -> None:
        """Take up where the grains are now, and set the fluid's forces on grains and walls; at the start of each interval."""

    def advance(self, steps: int) -> None:
        """Make steps of the engine."""
        with self._phases.timed("engine"):
            self._engine.run(steps, setup=False)

    def figures(self, progress: float, strain: float, time: float) -> dict[str, float]:
        """What a line of the history holds of the fluid; collective."""
        return {"p_left_Pa": 0.0, "p_right_Pa": 0.0}

    @property
    def residuals(self) -> dict[str, float]:
        """Balances that should close, and by how much they do not; of those that this flow has."""
        return {}

    def state(self) -> dict[str, np.ndarray]:
        """What a checkpoint has to hold of the fluid: arrays by name; those of rank 0 are written."""
        return {}

    @property
    def meshes(self) -> dict[str, int]:
        """Updates of the mesh since loading began by what came of them, none where there is no mesh; collective."""
        if self._network is None:
            return {}
        now = self._network.report()
        return {name: self._meshes_before.get(name, 0) + int(now.get(name, 0)) for name in MESHES}

    def interval_figures(self) -> dict[str, float]:
        """Error of an interval, and lengths of intervals that followed it, for the report."""
        return {}

    def counts(self) -> dict[str, dict[str, float]]:
        """Counts that a checkpoint has to hold, taken after `state`; collective."""
        return {"meshes": self.meshes, "solver": self.solver}

    def resume(self, counts: dict[str, dict[str, float]]) -> None:
        """Go on counting from a checkpoint."""
        self._meshes_before, self.solver = dict(counts["meshes"]), dict(counts["solver"])

    def report(self) -> dict:
        """The flow's own counts and times, of this process."""
        return {}

    def grain_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        """Ids (n,) of grains, over all ranks each once, and the mean pressure around each (n,), Pa; none without a fluid."""
        return np.zeros(0, np.int32), np.zeros(0)


class StandingForces(Dry):
    """A flow whose forces stand between updates."""

    _worked, _at_update = 0.0, None

    @property
    def work_on_grains(self) -> float:
        """Forces times displacements: summed over the ranks, for grains change rank in between."""
        return self._worked + (self._force_times_position() - self._at_update if self._at_update is not None else 0.0)

    @contextmanager
    def _forces_change(self) -> Iterator[None]:
        """A block in which the forces are set anew."""
        self._worked = self.work_on_grains
        yield
        self._at_update = self._force_times_position()

    def _force_times_position(self) -> float:
        """Sum over this rank's grains, J."""
        return float(np.einsum("ij,ij", self._engine.property_atom("pore_force"), self._engine.unwrapped_position()))


class PrescribedFlow(StandingForces):
    """One-way coupling: a prescribed pressure acts on the grains through the pore network's vector areas."""

    def __init__(self, case: RunCase, engine: Engine, comm, walls: SceneWalls, pressure: PrescribedPressure, fault: FaultGeometry, phases: Phases):
        # The network and its library are loaded only by a scene that has a pore pressure.
        from flowsolver.network import InputError, PoreNetwork

        super().__init__(engine, phases)
        self._refused = InputError
        self._comm, self._walls, self._pressure, self._fault = comm, walls, pressure, fault
        self._law, self._diameter = case.flow.forces, 2.0 * case.mean_radius_m
        # The forces of (2) alone lack the drag in the throats, and have no such balance.
        self._worst = {"momentum_residual": 0.0} if self._law == "total" else {}
        self._network = PoreNetwork(comm, np.array(fault.lower), np.array(fault.upper), np.array([False, False, walls.periodic_z]),
                                    case.flow.remesh_displacement * case.mean_radius_m)  # fmt: skip
        self._in_pores = np.zeros(0)
        self._always = case.flow.remesh == "always"
        self._rebuild = self._always

    def synchronise(self, saved: dict[str, np.ndarray]) -> None:
        """Build the mesh anew at the next update, as a run that starts from this point's checkpoint does."""
        self._rebuild = True

    def update(self, progress: float, strain: float, time: float) -> None:
        """Evaluate the pressure in the pores where the grains are now, and set the forces on grains and walls."""
        engine = self._engine
        with self._phases.timed("tessellation"):
            try:
                self._id = engine.atom("id").copy()
                self._network.update(
                    self._id, engine.atom("x"), engine.atom("radius"),
                    wall_position=self._walls.positions(self._walls.states(engine)), group=engine.atom("type") - np.int32(1), rebuild=self._rebuild)
            except self._refused as error:
                # The case was good when loading began: what is wrong now came about in the run.
                raise ComputationError(f"no pore network can be made at step {engine.step}: {error}") from None
            self._rebuild = self._always
        with self._phases.timed("pressure"), raised_together(self._comm):
            self._in_pores = self._pressure.at(self._network.pore_centre, progress, strain, time)
        with self._phases.timed("forces"):
            force, wall_force = self._network.forces(self._in_pores, self._law)
            with self._forces_change(), self._phases.timed("exchange"):
                engine.property_atom("pore_force")[:] = force
                self._walls.set_fluid_forces(engine, wall_force)
            if self._law == "total":
                self._measure_residual(force, wall_force)

    def _measure_residual(self, force: np.ndarray, wall_force: np.ndarray) -> None:
        """Keep the largest resultant of the fluid's forces on all grains and walls, over the sum of their sizes: 0 but for rounding."""
        sums = self._comm.allreduce(np.append(np.einsum("ij->j", force), np.sqrt(np.einsum("ij,ij->i", force, force)).sum()))
        resultant = sums[:3] + (wall_force[:, 1::2] - wall_force[:, 0::2]).sum(axis=0)
        size = sums[3] + np.abs(wall_force).sum()
        if size > 0.0:
            self.final["momentum_residual"] = float(np.linalg.norm(resultant) / size)
            self._worst["momentum_residual"] = max(self._worst["momentum_residual"], self.final["momentum_residual"])

    @property
    def residuals(self) -> dict[str, float]:
        return dict(self._worst)

    def figures(self, progress: float, strain: float, time: float) -> dict[str, float]:
        """Pressures of the left and the right block, Pa: those that the case ramps, and of a formula the means beside the gouge."""
        left, right = self._pressure.in_blocks(progress)
        if not self._pressure.even_in_blocks:
            pressure = np.zeros(0)
            with raised_together(self._comm):
                pressure = self._pressure.at(self._network.pore_centre, progress, strain, time)
            left, right = beside_gouge(self._network, pressure, self._fault, self._diameter)
        return {"p_left_Pa": left, "p_right_Pa": right}

    def report(self) -> dict:
        """The network's own counts and times."""
        return self._network.report()

    def grain_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        return self._id, around_grains(self._network, self._in_pores, self._id)
