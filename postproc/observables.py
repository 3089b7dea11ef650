"""What a study takes from a finished run: a number, or a curve, read from its files.

Every function takes the run's files and the arguments of the study's [observable], and gives an Observed. What a run does not show (a
fault that did not slip) is a NotObserved, with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

#: Strains between which the stiffness of the blocks is read: past the first waves of the loading, and before the fault yields.
STIFFNESS_STRAINS = (1e-4, 5e-4)


class NotObserved(Exception):
    """The run does not show what is asked for; the message says why."""


@dataclass(frozen=True)
class Observed:
    """value: (n,) float64; abscissa: (n,) float64 of a curve, None for a number (n = 1)."""

    value: np.ndarray
    abscissa: np.ndarray | None = None

    @staticmethod
    def number(value: float) -> Observed:
        return Observed(np.array([float(value)]))


@dataclass(frozen=True)
class ResultFiles:
    """Directory of the measured run, those of its companions by name, and the setting: parameter to value."""

    directory: Path
    companions: Mapping[str, Path] = field(default_factory=dict)
    setting: Mapping[str, Any] = field(default_factory=dict)

    def companion(self, name: str) -> Path:
        if name not in self.companions:
            raise NotObserved(f"this needs [companion.{name}] in the study, a run that gives its part")
        return self.companions[name]


def history(directory: Path, *columns: str) -> pd.DataFrame:
    """history.csv of a run, which has to have these columns."""
    path = directory / "history.csv"
    if not path.is_file():
        raise NotObserved("there is no history.csv")
    table = pd.read_csv(path)
    for name in columns:
        if name not in table:
            raise NotObserved(f"history.csv has no column {name}; its columns: {', '.join(table.columns)}")
    return table


def report(directory: Path) -> dict[str, Any]:
    """report.json of a run of a case, or that of poreflow."""
    for name in ("report.json", "out.json"):
        if (directory / name).is_file():
            return json.loads((directory / name).read_text(encoding="utf-8"))
    raise NotObserved("there is no report")


def case(directory: Path) -> dict[str, Any]:
    """case.json of a run: every input."""
    path = directory / "case.json"
    if not path.is_file():
        raise NotObserved("there is no case.json: this is read from the run of a case")
    return json.loads(path.read_text(encoding="utf-8"))


def of_history(files: ResultFiles, column: str, at: Mapping[str, float], over: str) -> Observed:
    """A column of history.csv: at the end, interpolated where another column has a value, or as a curve over another."""
    return of_table(history(files.directory, column, *at, *filter(None, [over])), column, at, over)


def of_table(table: pd.DataFrame, column: str, at: Mapping[str, float], over: str) -> Observed:
    """The same of any table."""
    values = table[column].to_numpy(float)
    if over:
        return Observed(values, table[over].to_numpy(float))
    if not at:
        return Observed.number(values[-1])
    (name, place), = at.items()
    return Observed.number(interpolated(table[name].to_numpy(float), values, place, name))


def interpolated(abscissa: np.ndarray, value: np.ndarray, place: float, name: str) -> float:
    """`value` (n,) where `abscissa` (n,) first comes to `place`, growing or falling; a rounding of 1e-9 past its ends is let pass."""
    rounding = 1e-9 * abs(place)
    falling = abscissa[0] > place + rounding
    reached = np.flatnonzero(abscissa <= place + rounding if falling else abscissa >= place - rounding)
    if not reached.size:
        beyond = f"begins with {abscissa[0]:.6g} and goes down to {abscissa.min():.6g}" if falling else f"goes to {abscissa.max():.6g}"
        raise NotObserved(f"{name} {beyond} only, not to {place:.6g}")
    k = int(reached[0])
    if k == 0 or abscissa[k] == abscissa[k - 1]:
        return float(value[k])
    share = min((place - abscissa[k - 1]) / (abscissa[k] - abscissa[k - 1]), 1.0)
    return float(value[k - 1] + share * (value[k] - value[k - 1]))


def of_report(files: ResultFiles, key: str) -> Observed:
    """A number of the report, by its dotted key; entries of lists by their number."""
    value: Any = report(files.directory)
    for part in key.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, ValueError, TypeError):
            raise NotObserved(f"the report has no {key}") from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise NotObserved(f"{key} of the report is {value!r}, not a number")
    return Observed.number(value)


def permeability(files: ResultFiles) -> Observed:
    """Permeability along the driven axis, m^2."""
    return Observed.number(permeability_of(files.directory))


def permeability_of(directory: Path) -> float:
    found = report(directory)
    value = found.get("permeability") or (found.get("pore_network_by_rank") or [{}])[0].get("permeability_m2")
    if value is None:
        raise NotObserved("the report has no permeability: give two opposite faces different pressures")
    return float(value)


def onset(files: ResultFiles, quantity: str = "sigma_n_Pa") -> Observed:
    """Onset of slip at the faster interface, in `quantity`: strain, time_s, sigma_n_Pa, sigma_n_minus_max_p_Pa."""
    from postproc.onset import QUANTITIES, find_onsets
    from postproc.run_files import read_run

    if quantity not in QUANTITIES:
        raise NotObserved(f"an onset has no {quantity}; it has {', '.join(QUANTITIES)}")
    found = find_onsets(read_run(files.directory)).onset
    if found is None:
        raise NotObserved("the fault did not slip")
    return Observed.number(found.at[quantity].value)


def slip(files: ResultFiles, side: str = "both", at: Mapping[str, float] | None = None) -> Observed:
    """Slip of an interface, "left" or "right", or the larger of both, m: at the end, or where a column has a value."""
    sides = ("left", "right") if side == "both" else (side,)
    values = [of_history(files, f"slip_{one}_m", at or {}, "").value[0] for one in sides]
    return Observed.number(max(values, key=abs))


def block_stiffness(files: ResultFiles) -> Observed:
    """d sigma_h / d strain of the whole box before the fault yields, Pa: least squares between STIFFNESS_STRAINS."""
    table = history(files.directory, "strain", "sigma_h_left_Pa", "sigma_h_right_Pa")
    strain = table["strain"].to_numpy(float)
    stress = 0.5 * (table["sigma_h_left_Pa"] + table["sigma_h_right_Pa"]).to_numpy(float)
    lower, upper = STIFFNESS_STRAINS
    within = (strain >= lower) & (strain <= upper)
    if within.sum() < 3:
        raise NotObserved(f"fewer than three lines of history.csv have a strain between {lower:g} and {upper:g}")
    return Observed.number(np.polyfit(strain[within], stress[within], 1)[0])


def consolidation(files: ResultFiles) -> Observed:
    """Degree of consolidation, settlement of the drained top from its value at once (0) to its final one (1), over the time after the
    load was raised, s. The skeleton's stiffness comes from [companion.dry]: the same load on the dry pack."""
    layer = Layer(files)
    table, inputs = history(files.directory), layer.inputs
    time = table["time_s"].to_numpy(float)
    borne = layer.mean_over_ramp(time, lambda since: (since > 0).astype(float))
    at_once, finally_ = layer.load / (layer.stiffness + 1.0 / layer.storage), layer.load / layer.stiffness
    later = time > inputs["sample"]["ramp_time_s"]
    return Observed(((table["strain_z"].to_numpy(float) - at_once * borne) / (finally_ - at_once))[later], time[later])


class Layer:
    """A saturated layer under a raised load: what the observable "consolidation" and Terzaghi's solution have in common.

    load: Pa. stiffness: oedometric modulus of the skeleton, Pa. storage: porosity times compressibility, 1/Pa. height: m.
    """

    def __init__(self, files: ResultFiles):
        self.inputs = case(files.directory)
        kind, *raised = str(self.inputs.get("sample", {}).get("walls", {}).get("z_top", "fixed")).split()
        if self.inputs["scene"] != "sample" or kind != "stress":
            raise NotObserved('this needs a box of grains, scene = "sample", with a stress on top: sample.walls = { z_top = "stress S" }')
        self.load = float(raised[0]) - self.inputs["sample"]["initial_stress_Pa"]
        if self.load == 0.0:
            raise NotObserved("the stress on top, sample.walls, is the initial one, sample.initial_stress_Pa: there is no load to consolidate under")
        dry, first = report(files.companion("dry")).get("last", {}), history(files.directory, "strain_z", "porosity").iloc[0]
        if "strain_z" not in dry:
            raise NotObserved("[companion.dry] is no run of a box of grains")
        self.stiffness = self.load / dry["strain_z"]
        self.storage = float(first["porosity"]) * self.inputs["fluid"]["compressibility_per_Pa"]
        self.height = float(report(files.directory)["reference"]["height"])

    def mean_over_ramp(self, time: np.ndarray, of_sudden_load: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(n,): answer to a load that rises linearly, the mean of those to sudden loads at all times of the rise."""
        rise = self.inputs["sample"]["ramp_time_s"] * (np.arange(40) + 0.5) / 40
        return np.mean([of_sudden_load(time - start) for start in rise], axis=0)


def pores(files: ResultFiles, file: str) -> tuple[np.ndarray, np.ndarray]:
    """Centres (m, 3) m and pressures (m,) Pa of all pores at the end of poreflow, as --vtu wrote them."""
    import meshio

    if not (files.directory / file).is_file():
        raise NotObserved(f"there is no {file}: give poreflow --vtu {file}")
    mesh = meshio.read(files.directory / file)
    return np.asarray(mesh.points, float), np.asarray(mesh.point_data["pressure"], float)


def pressures(files: ResultFiles, file: str = "pores.vtu") -> Observed:
    """Pressures of all pores at the end of poreflow, Pa."""
    return Observed(pores(files, file)[1])


def amplitude(files: ResultFiles, wave_length_m: float, file: str = "pores.vtu") -> Observed:
    """How much of a wave cos(2 pi z / wave length) the pressures hold at the end of poreflow, Pa."""
    centre, pressure = pores(files, file)
    wave = np.cos(2.0 * np.pi * centre[:, 2] / wave_length_m)
    return Observed.number(pressure @ wave / (wave @ wave))


#: Name of an observable in a study to its function; "history" and "report" take arguments of their own.
OBSERVABLES: dict[str, Callable[..., Observed]] = {
    "history": of_history,
    "report": of_report,
    "permeability": permeability,
    "onset": onset,
    "slip": slip,
    "block_stiffness": block_stiffness,
    "consolidation": consolidation,
    "pressures": pressures,
    "amplitude": amplitude,
}
#: Companions of the measured run that an observable reads.
COMPANIONS_OF_OBSERVABLE: dict[str, tuple[str, ...]] = {"consolidation": ("dry",)}
#: Columns of history.csv that an observable reads whatever its arguments; "history" reads those that it is given.
COLUMNS_READ: dict[str, tuple[str, ...]] = {
    "history": (),
    "onset": ("strain", "sigma_n_Pa", "slip_left_m", "slip_right_m"),
    "slip": ("slip_left_m", "slip_right_m"),
    "block_stiffness": ("strain", "sigma_h_left_Pa", "sigma_h_right_Pa"),
    "consolidation": ("time_s", "strain_z", "porosity"),
}
