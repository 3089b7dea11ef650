"""Two-way coupling: grains change the pores' volumes, the fluid's pressures push the grains.

Between solves of the flow the grains make many small steps. The solve at an interval's end lets the fluid flow, from the pressures at
its start and with all of the interval's volume changes; the split decides what the grains feel in between:

undrained   the pressures answer each step at once as if no fluid passed any throat, dp = -dV / (beta V). Stable whatever the
            interval; what drains reaches the grains half an interval late, an error of first order.
predicted   so they do, and besides go on draining at the rate at the end of the interval before, dp/dt = (net flow into the pore) /
            (beta V); the solve is one of second order (`PoreFlow.implicit`), and so is the error.
drained     pressures stand still: stable only while the fluid's stiffness over the interval stays below the skeleton's.

The steps are made in C++ (`PoreResponse`), with the gradients of the pores' volumes as they were when the interval began. A DEM engine
can call it in each of its own steps: `TwoWayCoupling.for_engine`.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowsolver.boundary import type_faults
from flowsolver.checks import checked_array, checked_choice, checked_type
from flowsolver.flow import TOLERANCE, Boundary, FlowResult, PoreFlow, time_of, tolerance_of
from flowsolver.network import FORCE_LAWS, ForceLaw, InputError, PoreNetwork, new_response
from flowsolver.transfer import carry_pressure

Split = Literal["undrained", "predicted", "drained"]
SPLITS = get_args(Split)


class TwoWayCoupling:
    """Pressures of a flow that is coupled with moving grains. Methods are collective unless they say local.

    Parameters
    ----------
    network, flow
        The network must have been updated; the flow's fluid must have a compressibility above 0, unless the split is "drained", and no body force.
    boundary
        What is given at the flow's edges; it may be replaced between intervals.
    pressure : (m,) float64, Pa, at the start
    split
        "undrained", "predicted" or "drained"
    law
        Of the forces, as in `PoreNetwork.forces`.
    drainage
        As for `begin`.
    """

    def __init__(
        self,
        network: PoreNetwork,
        flow: PoreFlow,
        boundary: Boundary,
        pressure: ArrayLike,
        split: Split = "undrained",
        tolerance: float = TOLERANCE,
        law: ForceLaw = "total",
        drainage: ArrayLike | None = None,
    ) -> None:
        faults: list[str] = []
        if not checked_type("network", network, PoreNetwork, faults):
            # Without a network no rank can tell the others.
            raise InputError(faults[0])
        split, law = checked_choice("split", split, SPLITS, faults), checked_choice("law", law, FORCE_LAWS, faults)
        tolerance = tolerance_of(tolerance, faults)
        faults += type_faults(boundary)
        if checked_type("flow", flow, PoreFlow, faults) and flow.network is not network:
            faults.append("flow is one through another network: expected one through the network that is given")
        network.agree(faults)
        if split != "drained" and not (flow.storage > 0).all():
            faults.append(f"the split {split} needs a fluid with compressibility above 0")
        if flow.body_force.any():
            faults.append(f"the flow has a body force of {flow.body_force.tolist()} Pa/m, which two-way coupling does not take: "
                          "let pressures be those above the fluid's at rest, and give the grains their weight less their buoyancy")  # fmt: skip
        network.agree(faults)
        network.remember_previous()
        self.network, self.flow, self.boundary, self.split, self.tolerance, self.law = network, flow, boundary, split, tolerance, law
        self._response = new_response(network)
        self._lag = np.zeros(network.pores)
        self.begin(pressure, drainage)

    def begin(self, pressure: ArrayLike, drainage: ArrayLike | None = None) -> None:
        """Start an interval at these pressures, (m,) Pa, and where grains and walls are at the network's last update.

        drainage : (m,) Pa/s, for the split "predicted": at which the pressures go on draining. Default: none.
        """
        faults: list[str] = []
        m = self.network.pores
        self._at_start = checked_array("pressure", pressure, np.float64, (m,), faults)
        rate = np.zeros(m) if drainage is None else checked_array("drainage", drainage, np.float64, (m,), faults)
        for name, values in (("pressure", self._at_start), ("drainage", rate)):
            if not np.isfinite(values).all():
                faults.append(f"{name} has entries that are not finite")
        self.network.agree(faults)
        storage = self.flow.storage
        answers = ~self.flow.given(self.boundary) if self.split != "drained" else np.zeros(m, bool)
        self._stiffness = np.divide(1.0, storage, out=np.zeros(m), where=answers)
        self._drainage = np.where(answers, rate, 0.0) if self.split == "predicted" else np.zeros(m)
        self._response.begin(self.law, self._at_start, self._drainage, self._stiffness)
        self._force: NDArray[np.float64] | None = None
        self._begun = True

    @property
    def pressure(self) -> NDArray[np.float64]:
        """(m,) float64, Pa: the present pressures."""
        return self._response.pressure() if self._begun else self._at_start

    @property
    def drainage(self) -> NDArray[np.float64]:
        """(m,) float64, Pa/s, local: at which flow alone changed the pressures when the last interval ended; for `begin`."""
        return self._drainage

    @property
    def lag(self) -> NDArray[np.float64]:
        """(m,) float64, Pa, local: by how much the pressures that the last interval ended with differ from what the solve made of them: the
        error of its steps, which falls with the interval's square ("predicted") or with the interval."""
        return self._lag

    @property
    def work(self) -> tuple[float, float, float]:
        """Of this rank since the interval began, J: done on grains and walls, given by the fluid, and the sum of the sizes of the
        first's terms (local). With the law "total" the first two are the same over all ranks, but for rounding."""
        return tuple(self._response.work())

    @property
    def seconds(self) -> float:
        """Wall seconds that all steps so far took on this rank (local)."""
        return self._response.seconds

    @property
    def for_engine(self) -> tuple[int, int]:
        """Addresses of a C function and of its first argument (local), for an engine that makes the steps itself. They stay the same.

        const char *step(void *fluid, double dt, int n, const int *id, const double *velocity, const double *wall_velocity,
        double *force, double *wall_force): n grains of this rank, in any order, moved at `velocity` (n, 3) m/s over `dt` (s), and the
        walls at `wall_velocity` (G, 6) m/s outward. In: the forces (n, 3) N before the step; out: after it, and on the walls (G, 6) N,
        outward, over all ranks. Collective. Returns null, or what went wrong, on all ranks.
        """
        return self._response.for_engine

    def move(self, velocity: ArrayLike, dt: float, wall_velocity: ArrayLike | None = None) -> None:
        """One step of the grains: velocity (n, 3) m/s in the order of the network's last update, wall_velocity (G, 6) m/s
        outward, over dt (s)."""
        faults: list[str] = []
        dt = time_of(dt, faults)
        velocities = checked_array("velocity", velocity, np.float64, (self.network.native.grains, 3), faults)
        shape = (self.network.native.groups, 6)
        walls = np.zeros(shape) if wall_velocity is None else checked_array("wall_velocity", wall_velocity, np.float64, shape, faults)
        self.network.agree(faults)
        if self._force is None:
            self._force, _ = self.forces()
        self._response.step(dt, velocities, walls, self._force)

    def forces(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Forces of the present pressures: on grains, (n, 3) N, in the order of the network's last update, or of the engine's last step;
        on walls, (G, 6) N, outward, over all ranks."""
        if not self._begun:
            self.begin(self._at_start, self._drainage)
        return self._response.forces()

    def exchange(self) -> FlowResult:
        """End the interval: the fluid flows for the time of all its steps. The next one starts with `update`, `begin`, `forces` or `move`."""
        elapsed = self._response.elapsed if self._begun else 0.0
        self.network.agree([] if elapsed > 0 else ["exchange() needs at least one move() before it"])
        swept = self._response.swept()
        order = 2 if self.split == "predicted" else 1
        felt = self._response.pressure()
        result = self.flow.implicit(self.boundary, self._at_start, elapsed, swept / elapsed, self.tolerance, order)
        self._lag = result.pressure - felt
        drained = result.rate + self._stiffness * swept / elapsed
        self._drainage = np.where(self._stiffness > 0.0, drained, 0.0) if self.split == "predicted" else np.zeros(len(drained))
        self._response.end()
        self._at_start, self._begun, self._force = result.pressure, False, None
        return result

    def update(
        self, id: ArrayLike, position: ArrayLike, radius: ArrayLike, wall_position: ArrayLike | None = None, group: ArrayLike | None = None
    ) -> str:
        """Between intervals: take up the grains' present places, as `PoreNetwork.update`, with the pressures carried over."""
        moved = self._begun and self._response.elapsed > 0
        self.network.agree(["update() comes between intervals: call exchange() first"] if moved else [])
        before, pressure, drainage = self.network.pores, self.pressure, self._drainage
        outcome = self.network.update(id, position, radius, wall_position, group)
        if outcome != "kept":
            pressure = carry_pressure(self.network, pressure, before)
            # As pressures are: what drains from all pores together stays the same.
            drainage = carry_pressure(self.network, drainage, before)
        self.flow.refresh(self.flow.body_force)
        self.begin(pressure, drainage)
        return outcome
