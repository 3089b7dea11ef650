"""One-way coupling with a solved flow: the fluid's pressures push grains and walls, whose motion does not squeeze the fluid."""

from __future__ import annotations

from flowsolver.flow import FlowResult

from coupling.fluid.exchange import Dry, StandingForces
from coupling.fluid.two_way_flow import TwoWayFlow


class OneWayFlow(StandingForces, TwoWayFlow):
    """As the two-way flow, but forces stand still within an interval, and the grains change only what the fluid flows through."""

    def _prepare_engine(self) -> None:
        # The steps do not ask the fluid, which gives no work that it would lose.
        self._hint = ""
        self._worst.pop("work_residual", None)

    def update(self, progress: float, strain: float, time: float) -> None:
        with self._forces_change():
            super().update(progress, strain, time)

    def _begin_error(self) -> None:
        # The grains felt the pressures that stood: there is no prediction to look at.
        pass

    def interval_figures(self) -> dict[str, float]:
        return {}

    def _make_steps(self, steps: int) -> None:
        Dry.advance(self, steps)

    def _begin(self) -> None:
        self._force, self._wall_force = self._network.forces(self._pressure, self._law)
        self._begun = self._engine.step

    def _solve(self) -> FlowResult:
        elapsed = (self._engine.step - self._begun) * self._engine.time_step
        return self._flow.implicit(self._held.boundary(), self._pressure, elapsed, tolerance=self._case.flow.solver_tolerance)

    def _set_forces(self) -> None:
        # As prescribed pressures do: what grains do gives the fluid nothing that half a step of old forces could give back.
        self._engine.property_atom("pore_force")[:] = self._force
        self._walls.set_fluid_forces(self._engine, self._wall_force)
