"""Runs of the scene "sample": which is which, and what each one measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .errors import RunFileError, TruncatedFile
from .observables import Layer, NotObserved, ResultFiles, consolidation
from .references import terzaghi
from .run_files import RERUN, read_json, read_table

COLUMNS = ("step", "time_s", "strain_x", "strain_y", "strain_z", "sigma_x_Pa", "sigma_y_Pa", "sigma_z_Pa", "pressure_mean_Pa", "porosity")
AXES = {"x": ("x_left", "x_right"), "y": ("y_front", "y_back"), "z": ("z_bottom", "z_top")}
#: Of the paper: k0, m^2, at porosity 0.35 and d = 2 mm, and the strain rate of its loading, 1/s.
PAPER_PERMEABILITY, PAPER_STRAIN_RATE = 1.0e-9, 7.8e-3


@dataclass(frozen=True)
class Sample:
    """One run. history: COLUMNS and more; report: None before its end."""

    directory: Path
    case: dict[str, Any]
    history: pd.DataFrame
    report: dict[str, Any] | None

    @property
    def name(self) -> str:
        return f"{self.case['case']}/{self.case['run']}"

    @property
    def dry(self) -> bool:
        return self.case["flow"]["kind"] == "none"

    @property
    def faces(self) -> dict[str, float]:
        """Pressures held at faces, Pa."""
        return {} if self.dry else self.case["fluid"]["faces"]

    @property
    def raised(self) -> tuple[str, ...]:
        """Axes along which the stress is raised."""
        walls = self.case["sample"]["walls"]
        return tuple(axis for axis, names in AXES.items() if any(str(walls.get(name, "")).startswith("stress") for name in names))

    @property
    def permeability(self) -> float | None:
        """Along the driven axis, m^2, where two opposite faces have different pressures."""
        return ((self.report or {}).get("pore_network_by_rank") or [{}])[0].get("permeability_m2")

    @property
    def storage(self) -> float:
        """Porosity times compressibility, 1/Pa."""
        return float(self.history["porosity"].iloc[0]) * self.case["fluid"]["compressibility_per_Pa"]

    def like(self, other: Sample) -> bool:
        """Whether both have the same pack under the same stress."""
        return all(self.case[part] == other.case[part] for part in ("pack", "material")) and (
            self.case["sample"]["initial_stress_Pa"] == other.case["sample"]["initial_stress_Pa"])

    def rise(self, axes: Sequence[str]) -> np.ndarray:
        """(n,): mean rise of the total stress along axes, Pa."""
        return self.history[[f"sigma_{axis}_Pa" for axis in axes]].mean(axis=1).to_numpy(float) - self.case["sample"]["initial_stress_Pa"]


def is_sample(directory: Path) -> bool:
    """Whether a directory holds a run of the scene "sample"."""
    path = directory / "case.json"
    return path.is_file() and read_json(path).get("scene") == "sample"


def read_sample(directory: Path, warnings: list[str]) -> Sample:
    """Read one run; what had to be left out of it goes to `warnings`."""
    report = read_json(directory / "report.json") if (directory / "report.json").exists() else None
    history = read_table(directory / "history.csv", COLUMNS, warnings)
    if history.empty:
        raise TruncatedFile(directory / "history.csv", "no line of the run was written", RERUN)
    return Sample(directory, read_json(directory / "case.json"), history, report)


def with_neighbours(given: Sequence[Sample], warnings: list[str]) -> list[Sample]:
    """The runs given, and of the other cases' results next to theirs those of the same packs that they may need."""
    known = {sample.directory.resolve() for sample in given}
    found = []
    for root in dict.fromkeys(sample.directory.resolve().parent.parent for sample in given):
        for path in sorted(root.glob("*/*/history.csv")):
            if path.parent in known or not is_sample(path.parent):
                continue
            try:
                other = read_sample(path.parent, [])
            except RunFileError as error:
                warnings.append(f"{path.parent}: left out: {error}")
                continue
            if any(other.like(sample) for sample in given):
                found.append(other)
    return [*given, *found]


@dataclass(frozen=True)
class Consolidation:
    """Degree of consolidation of a drained layer against Terzaghi's. time_factor, settled, drained, analytic: (n,), past the load's rise.

    settled: from the settlement, drained: from the mean pressure. stiffness: E_oed, Pa; permeability: m^2; diffusivity: c_v, m^2/s.
    """

    sample: Sample
    time_factor: np.ndarray
    settled: np.ndarray
    drained: np.ndarray
    analytic: np.ndarray
    stiffness: float
    permeability: float
    diffusivity: float

    def error(self, values: np.ndarray) -> tuple[float, float]:
        """Rms and largest difference from the analytic curve."""
        difference = values - self.analytic
        return float(np.sqrt((difference**2).mean())), float(np.abs(difference).max())


def dry_twin(sample: Sample, others: Sequence[Sample]) -> Sample:
    """The same load on the same pack without a fluid, of the same case where there is one; NotObserved if there is none."""
    twins = [other for other in others if other.dry and other.report and other.like(sample) and other.case["sample"]["walls"] == sample.case["sample"]["walls"]]
    if not twins:
        raise NotObserved('the stiffness is missing: run the same load with flow.kind = "none", and name its results too if they lie elsewhere')
    return min(twins, key=lambda other: other.directory.resolve().parent != sample.directory.resolve().parent)


def measure_consolidation(sample: Sample, others: Sequence[Sample]) -> Consolidation:
    """NotObserved where a run is missing that gives the stiffness or the permeability."""
    dry = dry_twin(sample, others)
    permeable = next((other for other in others if other.like(sample) and other.permeability), None)
    if permeable is None:
        raise NotObserved("the permeability is missing: run cases/darcy on the same pack, and name its results too if they lie elsewhere")
    files = ResultFiles(sample.directory, {"dry": dry.directory, "darcy": permeable.directory})
    layer, settled = Layer(files), consolidation(files)
    diffusivity = permeable.permeability / sample.case["fluid"]["viscosity_Pa_s"] / (1.0 / layer.stiffness + layer.storage)
    later = sample.history["time_s"].to_numpy(float) > sample.case["sample"]["ramp_time_s"]
    drained = 1.0 - sample.history["pressure_mean_Pa"].to_numpy(float)[later] * (1.0 + layer.storage * layer.stiffness) / layer.load
    return Consolidation(
        sample, diffusivity * settled.abscissa / layer.height**2, settled.value, drained, terzaghi(files, settled),
        layer.stiffness, permeable.permeability, diffusivity)


@dataclass(frozen=True)
class Undrained:
    """Rise of the mean pressure in a sealed pack. modulus: of the dry twin, Pa; predicted: share of the load, 1 / (1 + storage modulus)."""

    sample: Sample
    modulus: float
    predicted: float

    @property
    def measured(self) -> float:
        """Share of the load at the end."""
        return float(self.sample.history["pressure_mean_Pa"].iloc[-1] / self.sample.rise(self.sample.raised)[-1])

    @property
    def words(self) -> str:
        return "uniaxial, E" if len(self.sample.raised) == 1 else "isotropic, K" if len(self.sample.raised) == 3 else "raised along " + ", ".join(self.sample.raised)


def measure_undrained(sample: Sample, others: Sequence[Sample]) -> Undrained:
    """NotObserved where its dry twin is missing."""
    dry = dry_twin(sample, others)
    strain = sum(float(dry.history[f"strain_{axis}"].iloc[-1]) for axis in "xyz")
    modulus = float(dry.rise(sample.raised)[-1]) / strain
    return Undrained(sample, modulus, 1.0 / (1.0 + sample.storage * modulus))


def darcy_row(sample: Sample) -> dict[str, float | str]:
    """One line of the table of permeabilities; times are those of the paper's Discussion."""
    smallest, largest = sample.case["pack"]["diameter_m"]
    diameter, inside = 0.5 * (smallest + largest), sample.report["pack"]["porosity_bulk"]

    def kozeny_carman(porosity: float, size: float) -> float:
        return porosity**3 * size**2 / (180.0 * (1.0 - porosity) ** 2)

    here = kozeny_carman(inside, diameter)
    return {
        "run": sample.name,
        "porosity": float(sample.history["porosity"].iloc[-1]),
        "porosity_inside": inside,
        "permeability_m2": sample.permeability,
        "kozeny_carman_m2": here,
        # The paper's value, taken to this pack's porosity and diameter by Kozeny and Carman.
        "paper_k0_m2": PAPER_PERMEABILITY * here / kozeny_carman(0.35, 2e-3),
        "t_p_s": sample.report["pore_network_by_rank"][0]["pressure_diffusion_time_s"],
        "t_d_s": 1.0 / PAPER_STRAIN_RATE,
    }
