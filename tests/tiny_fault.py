"""A fault of a few hundred grains that runs in a second, for the tests of the driver, and readers of what a run leaves."""

from __future__ import annotations

import csv
from pathlib import Path

import meshio
import numpy as np

from coupling.stability.small_cases import FAULT_BOX, FAULT_LOADING, UPRIGHT_BOX

#: 396 steps of 467 grains, weak enough bonds that dozens break. As fast as it is loaded it is far from quasi-static.
TINY = FAULT_BOX + """\
bonds.strength_mean_Pa = 3e6
bonds.strength_sd_Pa = 0.6e6
""" + FAULT_LOADING + """\
time_step_fraction = 0.5

[flow]
interval_steps = 10

[[run]]
name = "wet"
pressure.mode = "linear"
pressure.left_target_Pa = 2.5e7

[[run]]
name = "dry"
pressure.mode = "none"
"""
#: An upright fault, periodic along it, in the scene "supplement"; as many steps.
UPRIGHT = UPRIGHT_BOX + """\
loading.time_step_fraction = 0.5
flow.interval_steps = 10

[supplement]
shear_stress_Pa = 1.2e7
ramp_time_s = 2e-5
hold_time_s = 2e-5

[[run]]
name = "wet"
pressure.left_target_Pa = 2.5e7

[[run]]
name = "dry"
pressure.mode = "none"
"""
#: Loading that goes on for minutes, for runs that are to be stopped.
LONG = ("loading.horizontal_strain=0.05", "loading.stop_vertical_strain=0.9")


def settings(*pairs: str) -> list[str]:
    """`--set` arguments."""
    return [part for pair in pairs for part in ("--set", pair)]


def history(run: Path) -> dict[str, np.ndarray]:
    """Columns of a run's history.csv."""
    with open(run / "history.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def broken_bonds(run: Path) -> list[dict[str, str]]:
    """Rows of a run's bonds.csv."""
    with open(run / "bonds.csv", newline="") as file:
        return list(csv.DictReader(file))


def last_grains(run: Path) -> dict[str, np.ndarray]:
    """Grains of a run's last snapshot, ordered by id: point data, and `position` (n, 3) m."""
    with open(run / "snapshots" / "index.csv", newline="") as file:
        name = list(csv.DictReader(file))[-1]["grains"]
    mesh = meshio.read(run / "snapshots" / name)
    return dict(mesh.point_data) | {"position": mesh.points}
