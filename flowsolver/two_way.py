"""Two-way coupling: grains change the pores' volumes, the fluid's pressures push the grains.

Between solves of the flow the grains make many small steps. With split "undrained" the pressures answer each of them at once as
if no fluid passed any throat, dp = -dV / (beta V); the solve at the interval's end then lets the fluid flow, from the pressures
at its start and with all of the interval's volume changes. With split "drained" pressures stand still between solves: that is
stable only while the fluid's stiffness over the interval stays below the skeleton's.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flowsolver.flow import TOLERANCE, Boundary, FlowResult, PoreFlow
from flowsolver.network import ForceLaw, PoreNetwork
from flowsolver.transfer import carry_pressure

Split = Literal["undrained", "drained"]


class TwoWayCoupling:
    """Pressures of a flow that is coupled with moving grains. Methods are collective.

    Parameters
    ----------
    network, flow
        The network must have been updated; the flow's fluid must have a compressibility above 0.
    boundary
        What is given at the flow's edges; it may be replaced between intervals.
    pressure : (m,) float64, Pa, at the start
    split
        "undrained" or "drained"
    """

    def __init__(
        self, network: PoreNetwork, flow: PoreFlow, boundary: Boundary, pressure: ArrayLike, split: Split = "undrained", tolerance: float = TOLERANCE
    ) -> None:
        faults = [] if split in ("undrained", "drained") else [f'split is {split!r}: expected "undrained" or "drained"']
        if split == "undrained" and not (flow.storage > 0).all():
            faults.append("the undrained split needs a fluid with compressibility above 0")
        network.agree(faults)
        network.remember_previous()
        self.network, self.flow, self.boundary, self.split, self.tolerance = network, flow, boundary, split, tolerance
        self.pressure: NDArray[np.float64] = np.array(pressure, float)
        """(m,) float64, Pa: the present pressures."""
        self._begin()

    def _begin(self) -> None:
        """Start an interval at the present pressures."""
        self._at_start = self.pressure.copy()
        self._swept = np.zeros(self.network.pores)
        self._elapsed = 0.0
        self._given = self.flow.given(self.boundary)

    def move(self, velocity: ArrayLike, dt: float, wall_velocity: ArrayLike | None = None) -> None:
        """One step of the grains: velocity (n, 3) m/s in the order of the network's last update, wall_velocity (G, 6) m/s
        outward, over dt (s)."""
        self.network.agree([] if np.isfinite(dt) and dt > 0 else [f"dt is {dt!r} s: expected a finite number above 0"])
        swept = self.network.volume_rate(velocity, wall_velocity) * dt
        self._swept += swept
        self._elapsed += dt
        if self.split == "undrained":
            self.pressure = np.where(self._given, self.pressure, self.pressure - swept / self.flow.storage)

    def forces(self, law: ForceLaw = "total") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Forces of the present pressures on grains and walls, as of `PoreNetwork.forces`."""
        return self.network.forces(self.pressure, law)

    def exchange(self) -> FlowResult:
        """End the interval: the fluid flows for the time of all its steps."""
        self.network.agree([] if self._elapsed > 0 else ["exchange() needs at least one move() before it"])
        result = self.flow.implicit(self.boundary, self._at_start, self._elapsed, self._swept / self._elapsed, self.tolerance)
        self.pressure = result.pressure
        self._begin()
        return result

    def update(
        self, id: ArrayLike, position: ArrayLike, radius: ArrayLike, wall_position: ArrayLike | None = None, group: ArrayLike | None = None
    ) -> str:
        """Between intervals: take up the grains' present places, as `PoreNetwork.update`, with the pressures carried over."""
        self.network.agree(["update() comes between intervals: call exchange() first"] if self._elapsed > 0 else [])
        before = self.network.pores
        outcome = self.network.update(id, position, radius, wall_position, group)
        if outcome != "kept":
            self.pressure = carry_pressure(self.network, self.pressure, before)
        self.flow.refresh(self.flow.body_force)
        self._begin()
        return outcome
