"""Read the files of one run: case, history, broken bonds, snapshots, report.

Units are SI, compression is positive.  A history or bond list whose last line is torn (the run was killed while it
wrote) stays readable: the torn line is left out and a warning is kept with the run.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pandas as pd

from .errors import ForeignFile, MissingFile, TruncatedFile

HISTORY_COLUMNS = (
    "step", "time_s", "strain", "vertical_strain", "sigma_h_left_Pa", "sigma_h_right_Pa", "sigma_v_Pa", "sigma_n_Pa",
    "p_left_Pa", "p_right_Pa", "vertical_strain_rate_per_s", "slip_left_m", "slip_right_m", "bonds_intact",
    "bonds_broken_tension", "bonds_broken_shear", "coordination_gouge", "contacts_gouge", "porosity_gouge",
    "contact_force_mean_N", "contact_force_max_N", "unbalanced_force_ratio", "kinetic_energy_J", "mesh_rebuilds",
)
"""Columns every history has; a run may add more."""

ESSENTIAL_COLUMNS = HISTORY_COLUMNS[:10] + ("slip_left_m", "slip_right_m")
"""Columns which have to be finite in every line: stresses, strains, pressures and slips."""

BOND_COLUMNS = ("step", "strain", "id_i", "id_j", "mode", "x_m", "y_m", "z_m",
                "force_normal_N", "force_shear_N", "energy_J")
SNAPSHOT_COLUMNS = ("step", "strain", "grains", "contacts")
RERUN = "run the case again (poreslip run) or name another directory"


@dataclass(frozen=True)
class Run:
    """One run as it was read.

    history: one line a sample, columns HISTORY_COLUMNS and more.  bonds: one line a broken bond, columns BOND_COLUMNS.
    snapshots: one line a snapshot, columns SNAPSHOT_COLUMNS, file names relative to <directory>/snapshots.
    report: what the run wrote at its end, or None when it did not get that far.
    """

    directory: Path
    name: str
    case: dict[str, Any]
    history: pd.DataFrame
    bonds: pd.DataFrame
    snapshots: pd.DataFrame
    report: dict[str, Any] | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Grains:
    """Grains of one snapshot, N of them.

    position, displacement, pressure_force: (N, 3) float64, m, m, N (displacement is since the start of the loading);
    radius: (N,) float64, m; part: (N,) int, 1 left block, 2 gouge, 3 right block; coordination: (N,) int; id: (N,) int;
    pressure: (N,) float64, Pa, of the fluid around each grain, None where the run wrote none.
    """

    position: np.ndarray
    radius: np.ndarray
    part: np.ndarray
    displacement: np.ndarray
    pressure_force: np.ndarray
    coordination: np.ndarray
    id: np.ndarray
    pressure: np.ndarray | None


@dataclass(frozen=True)
class Contacts:
    """Contacts of one snapshot, M of them.

    ends: (M, 2, 3) float64, m; force_normal (compression positive), force_shear: (M,) float64, N;
    bonded: (M,) bool; part: (M, 2) int, the parts that the two grains belong to.
    """

    ends: np.ndarray
    force_normal: np.ndarray
    force_shear: np.ndarray
    bonded: np.ndarray
    part: np.ndarray

    @property
    def of_gouge(self) -> np.ndarray:
        """(M,) bool: contacts of gouge grains with each other or with a block, as the history counts them."""
        return np.any(self.part == 2, axis=1)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object from `path`."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFile(path, "there is no such file", RERUN) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ForeignFile(path, f"it cannot be read as text ({error})", RERUN) from None
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        kind = ForeignFile if text.rstrip().endswith("}") else TruncatedFile
        raise kind(path, f"it is not whole JSON ({error.msg}, line {error.lineno})", RERUN) from None
    if not isinstance(content, dict):
        raise ForeignFile(path, f"it holds a {type(content).__name__}, not a JSON object", RERUN)
    return content


def read_table(path: Path, columns: tuple[str, ...], warnings: list[str],
               text_columns: tuple[str, ...] = ()) -> pd.DataFrame:
    """A CSV file with one header line that holds at least `columns`; all but `text_columns` are numbers.

    The last line is left out, with a warning, when it has no line end or too few fields.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFile(path, "there is no such file", RERUN) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ForeignFile(path, f"it cannot be read as text ({error})", RERUN) from None
    lines = text.splitlines()
    if not lines or (len(lines) == 1 and not text.endswith("\n")):
        raise TruncatedFile(path, "it ends within its header line", RERUN)
    header = [name.strip() for name in lines[0].split(",")]
    missing = [name for name in columns if name not in header]
    if missing:
        named = ", ".join(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
        raise ForeignFile(path, f"its header has no column {named}", "is it the file of another program or of an older "
                          "poreslip? " + RERUN)
    body = lines[1:]
    if body and (not text.endswith("\n") or body[-1].count(",") < len(header) - 1):
        warnings.append(f"{path}: its last line is torn (the run was stopped while writing it); that line is left out")
        body = body[:-1]
    for number, line in enumerate(body, start=2):
        if line.count(",") != len(header) - 1:
            raise ForeignFile(path, f"line {number} has {line.count(',') + 1} fields, the header {len(header)}", RERUN)
    table = pd.read_csv(io.StringIO("\n".join([",".join(header), *body])), skip_blank_lines=False)
    for name in columns:
        if name in text_columns:
            continue
        values = pd.to_numeric(table[name], errors="coerce")
        wrong = values.isna() & table[name].notna() & ~table[name].astype(str).str.strip().str.lower().eq("nan")
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise ForeignFile(path, f"line {row + 2}: {name} is {table[name].iloc[row]!r}, not a number", RERUN)
        table[name] = values
    return table


def read_history(path: Path, warnings: list[str]) -> pd.DataFrame:
    """history.csv: at least three samples, essential columns finite, step and time growing from line to line."""
    table = read_table(path, HISTORY_COLUMNS, warnings)
    if len(table) < 3:
        raise TruncatedFile(path, f"it has {len(table)} whole samples, at least 3 are needed",
                            "let the run go on (poreslip run --restart)")
    for name in ESSENTIAL_COLUMNS:
        infinite = ~np.isfinite(table[name].to_numpy(float))
        if infinite.any():
            raise ForeignFile(path, f"line {int(np.flatnonzero(infinite)[0]) + 2}: {name} is not a finite number",
                              "the computation broke down there; " + RERUN)
    for name in ("step", "time_s"):
        back = np.flatnonzero(np.diff(table[name].to_numpy(float)) <= 0.0)
        if back.size:
            raise ForeignFile(path, f"line {int(back[0]) + 3}: {name} does not grow",
                              "were two runs written into one directory? " + RERUN)
    return table


def mean_diameter(case: dict[str, Any], path: Path) -> float:
    """Mean grain diameter d (m) from case["pack"]["diameter_m"] = [smallest, largest]; `path` is named in the error."""
    smallest, largest = numbers(case, path, "pack", "diameter_m", 2)
    return 0.5 * (smallest + largest)


def numbers(case: dict[str, Any], path: Path, section: str, key: str, count: int) -> list[float]:
    """`count` positive numbers from case[section][key]."""
    try:
        value = case[section][key]
        found = [float(one) for one in (value if isinstance(value, list) else [value])]
    except (KeyError, TypeError, ValueError):
        raise ForeignFile(path, f"it has no {section}.{key}", "it is not the case.json of a run of poreslip; " + RERUN) from None
    if len(found) != count or not all(0.0 < one < np.inf for one in found):
        raise ForeignFile(path, f"{section}.{key} = {value} should be {count} positive number{'s' * (count > 1)}", RERUN)
    return found


def check_case(case: dict[str, Any], path: Path) -> None:
    """The entries of case.json that plots are made from: box, diameters, fault."""
    for section, key, count in (("pack", "box_m", 3), ("pack", "diameter_m", 2), ("fault", "dip_degrees", 1), ("fault", "gouge_width_m", 1)):
        numbers(case, path, section, key, count)


def read_run(directory: Path) -> Run:
    """The run in `directory`: case.json and history.csv are needed, the other files are read when they are there."""
    if not directory.is_dir():
        raise MissingFile(directory, "there is no such directory", "name the directory of a run or of a case, as "
                          "printed by poreslip run")
    warnings: list[str] = []
    case = read_json(directory / "case.json")
    check_case(case, directory / "case.json")
    history = read_history(directory / "history.csv", warnings)
    bonds = pd.DataFrame(columns=list(BOND_COLUMNS))
    if (directory / "bonds.csv").exists():
        bonds = read_table(directory / "bonds.csv", BOND_COLUMNS, warnings, text_columns=("mode",))
    snapshots = pd.DataFrame(columns=list(SNAPSHOT_COLUMNS))
    if (directory / "snapshots" / "index.csv").exists():
        snapshots = read_table(directory / "snapshots" / "index.csv", SNAPSHOT_COLUMNS, warnings,
                               text_columns=("grains", "contacts"))
    report = read_json(directory / "report.json") if (directory / "report.json").exists() else None
    if report is None:
        warnings.append(f"{directory}: there is no report.json, the run did not reach its end")
    return Run(directory, directory.name, case, history, bonds, snapshots, report, tuple(warnings))


def _read_mesh(path: Path) -> meshio.Mesh:
    if not path.exists():
        raise MissingFile(path, "the snapshot is in index.csv, but its file is not there", "run the case again, or plot with "
                          "--no-snapshots")
    try:
        return meshio.vtu.read(path)
    except Exception as error:  # meshio has no exception of its own for every kind of damage
        problem = str(error) or type(error).__name__
        raise TruncatedFile(path, f"it is not a whole VTU file ({problem})", "run the case again, or plot "
                            "with --no-snapshots") from None


def _field(data: dict[str, Any], name: str, path: Path) -> np.ndarray:
    if name not in data:
        raise ForeignFile(path, f"it has no field {name}", RERUN)
    return np.asarray(data[name])


def read_grains(run: Run, row: int) -> Grains:
    """The grains of the snapshot in line `row` of the index (0 the first, -1 the last)."""
    path = run.directory / "snapshots" / str(run.snapshots["grains"].iloc[row]).strip()
    mesh = _read_mesh(path)
    data = mesh.point_data
    return Grains(np.asarray(mesh.points, float), _field(data, "radius", path).astype(float).ravel(),
                  _field(data, "type", path).astype(int).ravel(), _field(data, "displacement", path).astype(float),
                  _field(data, "pressure_force", path).astype(float),
                  _field(data, "coordination", path).astype(int).ravel(), _field(data, "id", path).astype(int).ravel(),
                  np.asarray(data["pressure"], float).ravel() if "pressure" in data else None)


def read_contacts(run: Run, row: int) -> Contacts:
    """The contacts of the snapshot in line `row` of the index (0 the first, -1 the last)."""
    path = run.directory / "snapshots" / str(run.snapshots["contacts"].iloc[row]).strip()
    mesh = _read_mesh(path)
    lines = mesh.cells_dict.get("line", np.empty((0, 2), int))
    data = {name: np.concatenate([np.asarray(block) for block in blocks]) for name, blocks in mesh.cell_data.items()}
    part = np.stack([_field(data, "type_i", path).astype(int).ravel(),
                     _field(data, "type_j", path).astype(int).ravel()], axis=1)
    return Contacts(np.asarray(mesh.points, float)[lines], _field(data, "force_normal_N", path).astype(float).ravel(),
                    _field(data, "force_shear_N", path).astype(float).ravel(),
                    _field(data, "bonded", path).astype(bool).ravel(), part)
