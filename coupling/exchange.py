"""Positions out to the pore network, pressure forces back to the engine."""

from __future__ import annotations

import numpy as np

from coupling.case_schema import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.errors import ComputationError
from coupling.phases import Phases
from coupling.pore_pressure import PrescribedPressure
from coupling.walls import SceneWalls


class PrescribedFlow:
    """One-way coupling: a prescribed pressure acts on the grains through the pore network's vector areas."""

    def __init__(self, case: RunCase, engine: Engine, comm, walls: SceneWalls, pressure: PrescribedPressure, lower, upper, phases: Phases):
        # The network and its library are loaded only by a scene that has a pore pressure.
        from flowsolver.network import InputError, PoreNetwork

        self._refused = InputError
        self._engine, self._comm = engine, comm
        self._walls, self._pressure, self._phases = walls, pressure, phases
        self._law = case.flow.forces
        self._network = PoreNetwork(comm, np.array(lower), np.array(upper), np.array([False, False, walls.periodic_z]))
        self._rebuild = False
        self.momentum_residual = 0.0

    def synchronise(self) -> None:
        """Build the mesh anew at the next update, as a run that starts from this point's checkpoint does."""
        self._rebuild = True

    def update(self, progress: float, strain: float, time: float) -> None:
        """Evaluate the pressure in the pores where the grains are now, and set the forces on grains and walls."""
        engine = self._engine
        with self._phases.timed("tessellation"):
            try:
                self._network.update(
                    engine.atom("id"), engine.atom("x"), engine.atom("radius"),
                    wall_position=self._walls.positions(self._walls.states(engine)), group=engine.atom("type") - np.int32(1), rebuild=self._rebuild)
            except self._refused as error:
                # The case was good when loading began: what is wrong now came about in the run.
                raise ComputationError(f"no pore network can be made at step {engine.step}: {error}") from None
            self._rebuild = False
        with self._phases.timed("pressure"), raised_together(self._comm):
            pressure = self._pressure.at(self._network.pore_centre, progress, strain, time)
        with self._phases.timed("forces"):
            force, wall_force = self._network.forces(pressure, self._law)
            engine.property_atom("pore_force")[:] = force
            self._walls.set_fluid_forces(engine, wall_force)
            if self._law == "total":
                self._measure_residual(force, wall_force)

    def _measure_residual(self, force: np.ndarray, wall_force: np.ndarray) -> None:
        """Keep the largest resultant of the fluid's forces on all grains and walls, over the sum of their sizes: 0 but for rounding.

        With the forces of (2) alone the drag in the throats is missing, and there is no such balance.
        """
        sums = self._comm.allreduce(np.append(force.sum(axis=0), np.linalg.norm(force, axis=1).sum()))
        resultant = sums[:3] + (wall_force[:, 1::2] - wall_force[:, 0::2]).sum(axis=0)
        size = sums[3] + np.abs(wall_force).sum()
        if size > 0.0:
            self.momentum_residual = max(self.momentum_residual, float(np.linalg.norm(resultant) / size))

    def block_pressures(self, progress: float) -> tuple[float, float]:
        """Pressures of the left and the right block, Pa."""
        return self._pressure.in_blocks(progress)

    @property
    def rebuilds(self) -> int:
        """How often the mesh was built."""
        return int(self._network.report()["rebuilt"])

    def report(self) -> dict:
        """The network's own counts and times."""
        return self._network.report()


class Dry:
    """No fluid: nothing is imported, allocated or computed."""

    rebuilds = 0
    momentum_residual = 0.0

    def synchronise(self) -> None:
        pass

    def update(self, progress: float, strain: float, time: float) -> None:
        pass

    def block_pressures(self, progress: float) -> tuple[float, float]:
        return 0.0, 0.0

    def report(self) -> dict:
        return {}
