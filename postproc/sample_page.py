"""`poreslip plot` for runs of the scene "sample": what they measure against what is known, as figures, tables and a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

import pandas as pd

from .figure_style import Picture
from .figures_samples import consolidation_curves, loading_paths, towards_steady, undrained_paths
from .observables import NotObserved
from .page import PAGE, html_table
from .samples import Sample, darcy_row, measure_consolidation, measure_undrained, read_sample, with_neighbours

BALANCES = ("mass_residual", "work_residual", "momentum_residual", "remesh_mass_residual")


def consolidation_section(samples: Sequence[Sample], others: Sequence[Sample], how, notes: list[str]) -> tuple[pd.DataFrame, list[Picture]]:
    measured = _measured(measure_consolidation, samples, others, notes)
    rows = [{
        "run": one.sample.name, "split": one.sample.case["flow"]["split"], "interval_steps": one.sample.case["flow"]["interval_steps"],
        "oedometric_modulus_Pa": one.stiffness, "permeability_m2": one.permeability, "c_v_m2_per_s": one.diffusivity,
        "settlement_rms": one.error(one.settled)[0], "settlement_largest": one.error(one.settled)[1],
        "pressure_rms": one.error(one.drained)[0], "pressure_largest": one.error(one.drained)[1]} for one in measured]  # fmt: skip
    return pd.DataFrame(rows), [consolidation_curves(measured, *how)] if measured else []


def undrained_section(samples: Sequence[Sample], others: Sequence[Sample], how, notes: list[str]) -> tuple[pd.DataFrame, list[Picture]]:
    measured = _measured(measure_undrained, samples, others, notes)
    rows = [{"run": one.sample.name, "load": one.words, "modulus_Pa": one.modulus, "storage_per_Pa": one.sample.storage, "share": one.measured,
             "predicted": one.predicted, "difference": one.measured / one.predicted - 1.0} for one in measured]
    return pd.DataFrame(rows), [undrained_paths(measured, *how)] if measured else []


def darcy_section(samples: Sequence[Sample], others: Sequence[Sample], how, notes: list[str]) -> tuple[pd.DataFrame, list[Picture]]:
    return pd.DataFrame([darcy_row(sample) for sample in samples]), [towards_steady(samples, *how)] if samples else []


def loading_section(samples: Sequence[Sample], others: Sequence[Sample], how, notes: list[str]) -> tuple[pd.DataFrame, list[Picture]]:
    columns = ("time_s", "strain_x", "strain_y", "strain_z", "sigma_x_Pa", "sigma_y_Pa", "sigma_z_Pa", "pressure_mean_Pa", "porosity")
    rows = [{"run": sample.name} | {name: float(sample.history[name].iloc[-1]) for name in columns} for sample in samples]
    return pd.DataFrame(rows), [loading_paths(samples, *how)]


def _measured(measure: Callable, samples: Sequence[Sample], others: Sequence[Sample], notes: list[str]) -> list:
    """What is measured of each sample; why one cannot be measured goes to the notes."""
    found = []
    for sample in samples:
        try:
            found.append(measure(sample, others))
        except NotObserved as error:
            notes.append(f"{sample.name}: {error}")
    return found


def driven(sample: Sample) -> bool:
    return sample.permeability is not None


def consolidating(sample: Sample) -> bool:
    return bool(sample.faces) and not driven(sample) and sample.raised == ("z",) and "zmax" in sample.faces


def sealed(sample: Sample) -> bool:
    return not sample.dry and not sample.faces and bool(sample.raised)


#: Heading, file, which runs, and how they are measured and drawn.
SECTIONS = (
    ("Permeability", "darcy", driven, darcy_section),
    ("Consolidation against Terzaghi", "consolidation", consolidating, consolidation_section),
    ("Undrained loading", "undrained", sealed, undrained_section),
)
#: Of samples that are none of these.
LOADING = ("Loading", "loading", lambda sample: True, loading_section)
EXPLAINED = {
    "darcy": "Permeability of the whole box between its walls, whose pores are wider; Kozeny-Carman at the porosity away from them, phi^3 d^2 / (180 (1 - phi)^2); k0: "
             "the paper's 1e-9 m^2, taken to this porosity. t_p: time in which pressure diffuses through the box, L^2 viscosity phi beta / k; t_d: that of the paper's loading, "
             "one over its strain rate. Far apart, the pressure is always that of a steady flow.",
    "consolidation": "Errors are differences in the degree of consolidation after the load's rise.",
    "loading": "At the end of each run. What is measured against theory: a flow between two faces, a load that drains through zmax, and one on a sealed pack, each with "
               "its dry twin.",
    "undrained": "Share of the load that the pore pressure bears at the end, against 1 / (1 + porosity beta modulus).",
}  # fmt: skip


def make(directories: Sequence[Path], directory: Path, dpi: int, pdf: bool, command: str, versions: str) -> tuple[Path, list[str], list[str]]:
    """Read, measure, draw, write; gives the page's path, warnings, and lines to print."""
    warnings: list[str] = []
    given = [read_sample(path, warnings) for path in directories]
    others = with_neighbours(given, warnings)
    body, told = [], []
    for heading, name, belongs, section in (*SECTIONS, LOADING):
        if name == "loading" and body:
            break
        mine = [sample for sample in given if belongs(sample)]
        if not mine:
            continue
        notes: list[str] = []
        table, pictures = section(mine, others, (directory, dpi, pdf), notes)
        warnings += notes
        if table.empty:
            continue
        table.to_csv(directory / f"{name}.csv", index=False)
        told += [f"{row['run']}: " + ", ".join(f"{key} {value:.4g}" for key, value in row.items() if isinstance(value, float)) for row in table.to_dict("records")]
        body += [f"<h2>{heading}</h2>", f"<p>{escape(EXPLAINED[name])}</p>", _as_html(table)]
        body += [f'<figure><img src="{one.name}" alt="{escape(one.caption)}"><figcaption>{escape(one.caption)}</figcaption></figure>' for one in pictures]
    body += ["<h2>Balances</h2>", "<p>Largest residuals of each run, relative.</p>", _as_html(pd.DataFrame([
        {"run": sample.name} | {name: sample.report[name] for name in BALANCES if name in sample.report} for sample in given if sample.report and not sample.dry]))]
    intro = f"<p>Made by</p><pre>{escape(command)}</pre><p>{escape(versions)}.</p>" + (
        "<p class=\"warning\">Mind:</p><ul>" + "".join(f"<li>{escape(one)}</li>" for one in warnings) + "</ul>" if warnings else "")
    titles = list(dict.fromkeys(str(sample.case.get("title") or sample.name) for sample in given))
    path = directory / "page.html"
    path.write_text(PAGE.substitute(title=escape(", ".join(titles)), intro=intro, body="\n".join(body)), encoding="utf-8")
    return path, warnings, told


def _as_html(table: pd.DataFrame) -> str:
    return html_table([escape(name) for name in table.columns],
                      [[f"{value:.4g}" if isinstance(value, float) else escape(str(value)) for value in row] for row in table.itertuples(index=False)])
