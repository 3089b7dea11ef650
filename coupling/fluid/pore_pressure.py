"""Prescribed pore pressure: what the case says, as a function of position and strain."""

from __future__ import annotations

import numpy as np

from coupling.case.run_case import RunCase
from coupling.errors import ComputationError
from coupling.scene.fault_geometry import FaultGeometry


class PrescribedPressure:
    """The pressure field of a case's [pressure] section.

    progress: how far the ramp has gone, 0 to 1: strain over its final value (time over ramp_time_s in the scene "supplement").
    """

    def __init__(self, case: RunCase, fault: FaultGeometry):
        self._mode = case.pressure.mode
        self._fault = fault
        self._targets = (case.pressure.left_target_Pa, case.pressure.right_target_Pa)
        if self._mode == "uniform":
            self._targets = (case.pressure.left_target_Pa,) * 2
        if self._mode == "none":
            # With a solved flow: nothing but 0 is held.
            self._mode, self._targets = "uniform", (0.0, 0.0)
        if self._mode == "expression":
            # Only a formula needs it.
            import numexpr

            numexpr.set_num_threads(1)
            self._evaluate = numexpr.evaluate
            self._expression = case.pressure.expression

    @property
    def even_in_blocks(self) -> bool:
        """Whether each block has one pressure, that of `in_blocks`."""
        return self._mode != "expression"

    def in_blocks(self, progress: float) -> tuple[float, float]:
        """Ramped targets of the left and the right block, Pa."""
        left, right = self._targets
        return left * progress, right * progress

    def at(self, position: np.ndarray, progress: float, strain: float, time: float) -> np.ndarray:
        """Pressure (n,) at points (n, 3) m, Pa."""
        left, right = self.in_blocks(progress)
        if self._mode == "uniform":
            return np.full(len(position), left)
        across = self._fault.across(position)
        if self._mode == "linear":
            return left + (right - left) * np.clip(across / self._fault.width + 0.5, 0.0, 1.0)
        x, y, z = position.T
        names = {"x": x, "y": y, "z": z, "s": across, "width": self._fault.width, "strain": strain, "time": time,
                 "p_left": left, "p_right": right, "p_t": max(self._targets)}
        values = np.broadcast_to(np.asarray(self._evaluate(self._expression, local_dict=names), dtype=float), len(position))
        if not np.all(np.isfinite(values)):
            worst = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ComputationError(
                f"pressure.expression = {self._expression!r} gives {values[worst]} at {position[worst].tolist()} m, strain {strain:.6g}; "
                "give a formula that is finite in every pore")
        return np.ascontiguousarray(values)
