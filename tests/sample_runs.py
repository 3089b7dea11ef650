"""Runs of the scene "sample", for the tests of two-way coupling, and what they have to agree with."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

CASES = Path(__file__).resolve().parent.parent / "cases"
#: 384 grains squeezed by 6 per cent within 800 steps: the mesh changes in every interval.
SQUEEZE = """\
scene = "sample"
pack.box_m = [0.014, 0.014, 0.014]
pack.porosity = 0.40
material.local_damping = 0.2
loading.time_step_fraction = 0.25

[sample]
walls = { z_top = "speed 20" }
loading_time_s = 4e-5

[fluid]
viscosity_Pa_s = 10.0
faces = { zmax = 0.0 }

[flow]
kind = "solve"
interval_steps = 20

[output]
history_interval_steps = 40
checkpoint_every_steps = 400
"""


@dataclass(frozen=True)
class Result:
    """What a run left: columns of its history, its report, its inputs."""

    directory: Path

    @property
    def history(self) -> dict[str, np.ndarray]:
        with open(self.directory / "history.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}

    @property
    def report(self) -> dict:
        return json.loads((self.directory / "report.json").read_text())

    @property
    def case(self) -> dict:
        return json.loads((self.directory / "case.json").read_text())


def terzaghi(time_factor: np.ndarray) -> np.ndarray:
    """Mean degree of consolidation of a layer that drains at one face: U = 1 - sum 2 / M^2 exp(-M^2 T_v), M = pi (2 m + 1) / 2."""
    root = np.pi * (2 * np.arange(500) + 1) / 2
    return 1 - (2 / root**2 * np.exp(-np.outer(np.maximum(time_factor, 0.0), root**2))).sum(axis=1)
