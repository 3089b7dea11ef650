"""table.csv: one line a run with its onsets; scatter.csv: mean and standard deviation over packs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from .onset import QUANTITIES, SIDES, THRESHOLDS, Onset
from .quasi_static import vertical_stress_error, wall_difference
from .results import MeasuredRun, MeasuredVariant


def onset_columns(prefix: str, onset: Onset | None) -> dict[str, float]:
    """<prefix>_<quantity> and its uncertainty; no value where there is no such onset."""
    row = {}
    for name in QUANTITIES:
        stem, _, unit = name.rpartition("_") if name not in ("strain",) else (name, "", "")
        unit = f"_{unit}" if unit else ""
        row[f"{prefix}_{name}"] = onset.at[name].value if onset else np.nan
        row[f"{prefix}_{stem}_uncertainty{unit}"] = onset.at[name].uncertainty if onset else np.nan
    return row


def run_row(variant: str, seed: str, number: int, measured: MeasuredRun) -> dict[str, object]:
    """One line of table.csv."""
    run, onsets = measured.run, measured.onsets
    history = run.history
    row: dict[str, object] = {
        "case": number, "pack_seed": seed, "variant": variant, "run": run.name, "directory": str(run.directory),
        "slips": "yes" if onsets.faster else "no", "faster_interface": onsets.faster or "",
        "threshold_m": THRESHOLDS[1] * onsets.diameter,
        **onset_columns("onset", onsets.onset),
        "cut_short": "yes" if onsets.onset and onsets.onset.cut_short else "no",
    }
    for side in SIDES:
        row |= onset_columns(f"onset_{side}", onsets.slips[side].onset)
        row[f"largest_slip_{side}_m"] = onsets.slips[side].largest
    row |= onset_columns("as_measured", onsets.as_measured)
    row |= onset_columns("peak_stress", onsets.peak_stress)
    row |= onset_columns("strain_rate", onsets.strain_rate)
    off_target = vertical_stress_error(run)
    row |= {
        "end_strain": history["strain"].iloc[-1],
        "peak_sigma_n_Pa": history["sigma_n_Pa"].max(),
        "bonds_broken": int(history[["bonds_broken_tension", "bonds_broken_shear"]].iloc[-1].sum()),
        "porosity_gouge_start": history["porosity_gouge"].iloc[0],
        "largest_unbalanced_force_ratio": history["unbalanced_force_ratio"].max(),
        "largest_wall_difference": float(wall_difference(history)[1:].max()),
        "largest_sigma_v_error": np.nan if off_target is None else float(off_target.max()),
    }
    return row


def run_table(variants: Sequence[MeasuredVariant]) -> pd.DataFrame:
    """table.csv."""
    return pd.DataFrame([run_row(variant.label, pack.seed, number, measured)
                         for variant in variants for pack in variant.packs for number, measured in pack.runs.items()])


def scatter_table(variants: Sequence[MeasuredVariant]) -> pd.DataFrame:
    """scatter.csv: by variant and case, packs, packs that slip, mean and sd (over packs that slip) of each quantity."""
    rows = []
    for variant in variants:
        for number in variant.case_numbers:
            measured = [pack.runs[number] for pack in variant.packs if number in pack.runs]
            onsets = [one.onsets.onset for one in measured if one.onsets.onset]
            row: dict[str, object] = {"variant": variant.label, "case": number, "packs": len(measured), "packs_that_slip": len(onsets)}
            for name in QUANTITIES:
                values = np.array([onset.at[name].value for onset in onsets])
                row[f"{name}_mean"] = values.mean() if len(values) else np.nan
                row[f"{name}_sd"] = values.std(ddof=1) if len(values) > 1 else np.nan
                row[f"{name}_mean_uncertainty"] = (np.mean([onset.at[name].uncertainty for onset in onsets])
                                                   if onsets else np.nan)
            rows.append(row)
    return pd.DataFrame(rows)


def variant_shifts(variants: Sequence[MeasuredVariant]) -> pd.DataFrame:
    """Onset strain of each run against the same case and pack of the first variant of its scene.

    shift_over_uncertainty: the difference over the first variant's stated uncertainty; below 1 it is within.
    """
    rows = []
    for scene in dict.fromkeys(variant.scene for variant in variants):
        first, *others = [variant for variant in variants if variant.scene == scene]
        known = {(pack.seed, number): one for pack in first.packs for number, one in pack.runs.items()}
        for variant in others:
            for pack in variant.packs:
                for number, one in pack.runs.items():
                    same = known.get((pack.seed, number))
                    if same is None or same.run is one.run or not (same.onsets.onset and one.onsets.onset):
                        continue
                    reference, onset = same.onsets.onset, one.onsets.onset
                    row: dict[str, object] = {"variant": variant.label, "against": first.label, "case": number, "pack_seed": pack.seed}
                    for name in ("strain", "sigma_n_Pa"):
                        row[f"{name}_shift"] = onset.at[name].value - reference.at[name].value
                        row[f"{name}_uncertainty"] = reference.at[name].uncertainty
                        row[f"{name}_shift_over_uncertainty"] = abs(row[f"{name}_shift"]) / reference.at[name].uncertainty
                    rows.append(row)
    return pd.DataFrame(rows)
