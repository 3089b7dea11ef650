"""Write the files of a made-up run with a known onset of slip, in the formats of real runs.

The slip of the faster interface is an elastic line plus a smooth ramp which passes 0.005 d exactly at `onset_strain`;
the other interface passes it at `other_onset_strain`.  Stresses and strains follow simple closed forms, so that every
quantity at the onset is known.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pandas as pd

DIAMETER = 2.0e-3
TARGET = 2.5e7
BOX = (0.08, 0.02, 0.05)
PRESSURES = {1: (1.0, 1.0), 2: (1.0, 0.0), 3: (0.0, 1.0), 4: (0.5, 0.5), 5: (0.0, 0.0)}
ONSETS = {1: 1.08e-3, 2: 1.19e-3, 3: 1.20e-3, 4: 1.40e-3, 5: 1.87e-3}
"""Onset strains in the order of the paper's claims, near those of a first prototype."""


@dataclass(frozen=True)
class Synthetic:
    """What is made up; strains are horizontal strains, compression positive."""

    number: int = 1
    seed: int = 1
    onset_strain: float | None = 1.2e-3
    other_onset_strain: float | None = None
    end_strain: float = 3.1e-3
    samples: int = 400
    slip_per_strain: float = 0.35
    ramp_width: float = 4e-5
    elastic_slip: float = 2e-3
    slip_noise: float = 0.0
    stress_noise: float = 0.0
    strain_rate: float = 1.56
    stiffness: float = 2.0e10
    contacts_lost: float = 0.2
    force_growth: float = 10.0
    bonds_broken: int = 0
    grains: int = 0
    scene: str = "two_sides"
    parameter: float = 0.5
    forces: str = "total"


def ramp(strain: np.ndarray, onset: float | None, made: Synthetic) -> np.ndarray:
    """Slip without its elastic part, m: slip_per_strain * w ln(1 + exp((e - e0)/w)), which is 0.005 d at `onset`."""
    if onset is None:
        return np.zeros_like(strain)
    w, v = made.ramp_width, made.slip_per_strain
    start = onset - w * np.log(np.expm1(0.005 * DIAMETER / (v * w)))
    return v * w * np.logaddexp(0.0, (strain - start) / w)


def sigma_h(strain: np.ndarray, made: Synthetic) -> np.ndarray:
    """Horizontal stress, Pa: linear to the onset, then constant."""
    top = made.onset_strain if made.onset_strain is not None else np.inf
    return 1e7 + made.stiffness * np.minimum(strain, top + 2e-4)


def sigma_n(strain: np.ndarray, made: Synthetic) -> np.ndarray:
    """Normal stress on a fault that dips 45 degrees, Pa."""
    return 0.5 * (sigma_h(strain, made) + 1e7)


def history(made: Synthetic) -> pd.DataFrame:
    random = np.random.default_rng(made.seed * 10 + made.number)
    strain = np.linspace(0.0, made.end_strain, made.samples)
    left, right = PRESSURES[made.number]
    faster, slower = ramp(strain, made.onset_strain, made), ramp(strain, made.other_onset_strain, made)
    slips = (slower, faster) if right > left else (faster, slower)
    # Proportional to the shear stress on the fault.
    elastic = made.elastic_slip * (sigma_h(strain, made) - 1e7) / made.stiffness
    sliding = np.zeros_like(strain)
    if made.onset_strain is not None:
        sliding = 0.5 * (1.0 + np.tanh((strain - made.onset_strain) / 5e-5))
    rate = (0.3 + (BOX[0] / BOX[2] - 0.3) * sliding) * made.strain_rate
    vertical = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(strain)))) / made.strain_rate
    grown = strain / made.end_strain
    return pd.DataFrame({
        "step": np.arange(made.samples) * 100,
        "time_s": strain / made.strain_rate,
        "strain": strain,
        "vertical_strain": vertical,
        "sigma_h_left_Pa": sigma_h(strain, made),
        "sigma_h_right_Pa": sigma_h(strain, made) * 1.01,
        "sigma_v_Pa": np.full_like(strain, 1e7),
        "sigma_n_Pa": sigma_n(strain, made) + made.stress_noise * random.standard_normal(made.samples),
        "p_left_Pa": left * TARGET * grown,
        "p_right_Pa": right * TARGET * grown,
        "vertical_strain_rate_per_s": rate,
        "slip_left_m": slips[0] + elastic + made.slip_noise * random.standard_normal(made.samples),
        "slip_right_m": slips[1] + elastic + made.slip_noise * random.standard_normal(made.samples),
        "bonds_intact": 20000 - np.round(made.bonds_broken * grown).astype(int),
        "bonds_broken_tension": np.round(made.bonds_broken * grown).astype(int),
        "bonds_broken_shear": np.zeros(made.samples, int),
        "coordination_gouge": 4.5 * (1.0 - made.contacts_lost * grown),
        "contacts_gouge": np.round(5000 * (1.0 - made.contacts_lost * grown)).astype(int),
        "porosity_gouge": 0.37 + 0.01 * grown,
        "contact_force_mean_N": 20.0 + 20.0 * grown,
        "contact_force_max_N": 100.0 * (1.0 + (made.force_growth - 1.0) * grown),
        "unbalanced_force_ratio": np.full_like(strain, 5e-3),
        "kinetic_energy_J": 1e-6 * grown,
        "mesh_rebuilds": np.zeros(made.samples, int),
    })


def case(made: Synthetic, name: str) -> dict:
    left, right = PRESSURES[made.number]
    return {
        "case": "made_up", "run": name, "group": f"case{made.number}", "title": "a made-up run", "scene": made.scene,
        "engine": "none",
        "pack": {"seed": made.seed, "box_m": list(BOX), "diameter_m": [0.9 * DIAMETER, 1.1 * DIAMETER], "porosity": 0.37},
        "material": {"friction": made.parameter},
        "fault": {"gouge_width_m": 0.012, "dip_degrees": 90.0 if made.scene == "supplement" else 45.0},
        "loading": {"horizontal_strain": 3.1e-3, "strain_rate_per_s": made.strain_rate, "vertical_stress_Pa": 1e7,
                    "stop_vertical_strain": 0.02},
        "pressure": {"mode": "linear", "left_target_Pa": left * TARGET, "right_target_Pa": right * TARGET},
        "flow": {"kind": "prescribed" if left or right else "none", "forces": made.forces},
        "output": {"history_interval_steps": 100},
        "derived": {"loading_steps": 100 * made.samples},
    }


def write_snapshots(directory: Path, made: Synthetic) -> None:
    """Two snapshots of grains on a lattice; at the end the right block has moved up along the fault."""
    (directory / "snapshots").mkdir()
    random = np.random.default_rng(made.seed)
    spacing = (np.prod(BOX) / made.grains) ** (1 / 3)
    axes = [np.arange(0.5 * spacing, length, spacing) for length in BOX]
    position = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    position += 0.05 * spacing * random.standard_normal(position.shape)
    layer = ((position[:, 0] - BOX[0] / 2) + (position[:, 2] - BOX[2] / 2)) / np.sqrt(2.0)
    part = np.where(layer < -0.006, 1, np.where(layer > 0.006, 3, 2)).astype(np.int32)
    share = np.clip((layer + 0.006) / 0.012, 0.0, 1.0)[:, None]
    moved = 4e-4 * share * np.array([[-1.0, 0.0, 1.0]]) / np.sqrt(2.0)
    shape = tuple(len(axis) for axis in axes)
    number = np.arange(len(position)).reshape(shape)
    pairs = np.concatenate([np.stack([number[:-1].ravel(), number[1:].ravel()], 1),
                            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], 1),
                            np.stack([number[:, :, :-1].ravel(), number[:, :, 1:].ravel()], 1)])
    rows = []
    for step, grown in ((0, 0.0), (100 * made.samples, 1.0)):
        keep = pairs[random.random(len(pairs)) > made.contacts_lost * grown]
        here = position + grown * moved
        force = random.exponential(20.0 * (1.0 + 3.0 * grown), len(keep))
        meshio.write(directory / "snapshots" / f"grains_{step}.vtu", meshio.Mesh(here, [("vertex", np.arange(len(here))[:, None])], point_data={
            "id": np.arange(1, len(here) + 1), "type": part, "radius": np.full(len(here), 0.5 * spacing),
            "displacement": grown * moved, "velocity": np.zeros_like(here),
            "pressure_force": grown * random.standard_normal(here.shape),
            "coordination": np.bincount(keep.ravel(), minlength=len(here)).astype(np.int32)}))
        ends = here[keep].reshape(-1, 3)
        meshio.write(directory / "snapshots" / f"contacts_{step}.vtu", meshio.Mesh(
            ends, [("line", np.arange(len(ends)).reshape(-1, 2))], cell_data={
                "force_normal_N": [force], "force_shear_N": [0.3 * force], "bonded": [(part[keep] != 2).all(1).astype(np.int8)],
                "type_i": [part[keep[:, 0]]], "type_j": [part[keep[:, 1]]]}))
        rows.append(f"{step},{made.end_strain * grown:g},grains_{step}.vtu,contacts_{step}.vtu\n")
    (directory / "snapshots" / "index.csv").write_text("step,strain,grains,contacts\n" + "".join(rows))


def write_run(parent: Path, made: Synthetic, name: str | None = None) -> Path:
    """Write the run below `parent` and give back its directory."""
    directory = parent / (name or f"case{made.number}-seed{made.seed}")
    directory.mkdir(parents=True)
    (directory / "case.json").write_text(json.dumps(case(made, directory.name)))
    history(made).to_csv(directory / "history.csv", index=False)
    broken = made.bonds_broken
    random = np.random.default_rng(made.seed)
    strain = np.linspace(0.0, made.end_strain, broken + 1)[1:]
    pd.DataFrame({"step": np.round(strain / made.end_strain * 100 * made.samples).astype(int), "strain": strain,
                  "id_i": np.arange(broken) + 1, "id_j": np.arange(broken) + 2,
                  "mode": ["tension" if i % 3 else "shear" for i in range(broken)],
                  "x_m": random.uniform(0, BOX[0], broken), "y_m": random.uniform(0, BOX[1], broken),
                  "z_m": random.uniform(0, BOX[2], broken), "force_normal_N": np.full(broken, -3e3),
                  "force_shear_N": np.full(broken, 1e2), "energy_J": np.full(broken, 1e-3),
                  }).to_csv(directory / "bonds.csv", index=False)
    if made.grains:
        write_snapshots(directory, made)
    (directory / "report.json").write_text(json.dumps({"stopped": "strain reached"}))
    return directory


def write_case(parent: Path, seeds: tuple[int, ...] = (1,), numbers: tuple[int, ...] = (1, 2, 3, 4, 5),
               scatter: float = 0.0, **changes: object) -> Path:
    """A case directory: the five cases with the onsets of ONSETS, shifted from pack to pack by `scatter` (relative)."""
    names = []
    for seed in seeds:
        for number in numbers:
            onset = ONSETS[number] * (1.0 + scatter * (seed - np.mean(seeds)))
            other = onset if PRESSURES[number][0] == PRESSURES[number][1] else onset + 6e-4
            made = dataclasses.replace(Synthetic(number=number, seed=seed, onset_strain=onset, other_onset_strain=other),
                                       **changes)
            names.append(write_run(parent, made).name)
    (parent / "runs.json").write_text(json.dumps({"case": parent.name, "runs": names, "seed": list(seeds)}))
    return parent
