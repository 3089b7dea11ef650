"""Where the pressures of a solved flow are given, and what they are at the start."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from flowsolver.boundary import Boundary
from flowsolver.network import PoreNetwork

from coupling.case.run_case import RunCase
from coupling.case.schema import FACES, PACK
from coupling.collective import raised_together
from coupling.fluid.pore_pressure import PrescribedPressure
from coupling.measures.pressure import beside_gouge
from coupling.scene.fault_geometry import FaultGeometry


class HeldPressure(Protocol):
    """What a scene gives to its flow."""

    #: Face to pressure, Pa, where these alone are given and stay as they are.
    at_faces: dict[str, float]
    #: Pa: by how much the case's inputs may change the pressures; the measure of what an interval errs by.
    largest_change: float

    def boundary(self) -> Boundary:
        """What is given now."""

    def initial(self, centre: np.ndarray) -> np.ndarray:
        """(m,) Pa: pressures of pores with centres (m, 3), m, when loading begins."""

    def figures(self, network: PoreNetwork, pressure: np.ndarray, outflow: dict[str, float]) -> dict[str, float]:
        """What a line of the scene's history holds of pressures (m,), Pa, and flows out of the box, m^3/s; collective."""


class OfSample:
    """Pressures at faces of a box, which stay as they are."""

    def __init__(self, case: RunCase):
        self.at_faces = {face: float(pressure) for face, pressure in case.fluid.faces.items()}
        self._initial = case.fluid.initial_pressure_Pa
        given = [abs(pressure - self._initial) for pressure in self.at_faces.values()]
        # At most all of a wall's stress comes on the fluid.
        borne = [abs(stress - case.sample.initial_stress_Pa) for kind, stress in map(case.sample.motion, PACK) if kind == "stress"]
        self.largest_change = max(given + borne, default=0.0)

    def boundary(self) -> Boundary:
        return Boundary(pressure=self.at_faces)

    def initial(self, centre: np.ndarray) -> np.ndarray:
        return np.full(len(centre), self._initial)

    def figures(self, network: PoreNetwork, pressure: np.ndarray, outflow: dict[str, float]) -> dict[str, float]:
        """What left through each face in the last interval."""
        return {f"outflow_{face}_m3_per_s": outflow.get(face, 0.0) for face in FACES}


class OfFault:
    """The field of [pressure], given in the blocks or at their outer faces; between them the fluid flows through the gouge.

    now: how far the ramp has gone, 0 to 1, the horizontal strain, and the time, s. Of `boundary` and `initial`, and of the functions in a
    boundary, all ranks make the same calls.
    """

    at_faces: dict[str, float] = {}

    def __init__(self, case: RunCase, comm, fault: FaultGeometry, field: PrescribedPressure, now: Callable[[], tuple[float, float, float]]):
        self._comm, self._fault, self._field, self._now = comm, fault, field, now
        self._diameter = 2.0 * case.mean_radius_m
        self._in_blocks = case.fluid.held == "blocks"
        self.largest_change = max(case.pressure.left_target_Pa, case.pressure.right_target_Pa)
        # A y face is closed; a periodic direction has none.
        self._faces = FACES[:2] if case.periodic_z else FACES[:2] + FACES[4:]

    def boundary(self) -> Boundary:
        now = self._now()

        def in_blocks(centre: np.ndarray) -> np.ma.MaskedArray:
            pressure = self._at(centre, now)
            return np.ma.masked_array(pressure, np.abs(self._fault.across(centre)) < 0.5 * self._fault.width)

        return Boundary(inside=in_blocks) if self._in_blocks else Boundary(pressure=dict.fromkeys(self._faces, in_blocks))

    def initial(self, centre: np.ndarray) -> np.ndarray:
        return self._at(centre, self._now())

    def figures(self, network: PoreNetwork, pressure: np.ndarray, outflow: dict[str, float]) -> dict[str, float]:
        """Pressures beside the gouge, and what left the box in the last interval."""
        left, right = beside_gouge(network, pressure, self._fault, self._diameter)
        return {"p_left_Pa": left, "p_right_Pa": right, "outflow_m3_per_s": sum(outflow.values())}

    def _at(self, centre: np.ndarray, now: tuple[float, float, float]) -> np.ndarray:
        pressure = np.zeros(0)
        with raised_together(self._comm):
            pressure = np.array(self._field.at(centre, *now))
        return pressure
