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

    def synchronise(self) -> None:
        pass

    def update(self, progress: float, strain: float, time: float) -> None:
        pass

    def block_pressures(self, progress: float) -> tuple[float, float]:
        return 0.0, 0.0

    def report(self) -> dict:
        return {}
