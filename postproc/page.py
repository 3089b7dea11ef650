"""The readable page: claims, onsets, quasi-static check and figures in one static HTML file with relative links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from string import Template

import numpy as np
import pandas as pd

from . import onset as onset_module
from .claims import NOT_GIVEN, NOT_REPRODUCED, REPRODUCED, Finding, chief
from .figure_style import CASE_WORDS, MEGA, Picture
from .onset import Onset, Quantity
from .quasi_static import vertical_stress_error, wall_difference
from .results import MeasuredRun, MeasuredVariant

PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<style>
body { font-family: Georgia, "DejaVu Serif", serif; max-width: 62em; margin: 1.5em auto; padding: 0 1em; line-height: 1.4; color: #111; }
h1 { font-size: 1.5em; } h2 { font-size: 1.2em; border-bottom: 1px solid #999; margin-top: 1.8em; } h3 { font-size: 1.05em; }
table { border-collapse: collapse; font: 0.82em/1.35 "DejaVu Sans", Arial, sans-serif; margin: 0.6em 0; }
th, td { padding: 0.25em 0.6em; vertical-align: top; border-bottom: 1px solid #ccc; text-align: left; }
th { border-bottom: 1.5px solid #333; } td.number { text-align: right; white-space: nowrap; }
.reproduced { font-weight: bold; color: #00563a; } .not-reproduced { font-weight: bold; color: #9c2f00; } .not-tested { color: #555; font-style: italic; }
figure { margin: 1em 0; page-break-inside: avoid; } figure img { max-width: 100%; } figcaption { font-size: 0.88em; }
pre { background: #f3f3f3; padding: 0.6em; overflow-x: auto; font-size: 0.85em; white-space: pre-wrap; } .warning { color: #9c2f00; }
details { margin: 0.5em 0; } summary { cursor: pointer; }
</style></head><body>
<h1>$title</h1>
$intro
$body
</body></html>
""")


@dataclass(frozen=True)
class VariantFigures:
    """Figures of one variant; seed: the pack they were drawn for."""

    variant: MeasuredVariant
    seed: str
    pictures: tuple[Picture, ...]


def html_table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: bool = True) -> str:
    """A table; cells are HTML already.  numbers: all but the first column are set right."""
    head = "".join(f"<th>{cell}</th>" for cell in header)
    mark = ' class="number"' if numbers else ""
    body = "".join("<tr>" + "".join(f"<td{mark if index else ''}>{cell}</td>" for index, cell in enumerate(row)) + "</tr>\n" for row in rows)
    return f"<table><tr>{head}</tr>\n{body}</table>"


def plus_minus(quantity: Quantity, factor: float) -> str:
    """Value and uncertainty, rounded to two digits of the uncertainty."""
    value, uncertainty = quantity.value * factor, quantity.uncertainty * factor
    digits = 2 if not uncertainty > 0.0 else int(np.clip(1 - np.floor(np.log10(uncertainty)), 0, 5))
    return f"{value:.{digits}f} ± {uncertainty:.{digits}f}"


def onset_cells(onset: Onset | None, names: Sequence[tuple[str, float]], without: str) -> list[str]:
    return [plus_minus(onset.at[name], factor) for name, factor in names] if onset else [without] + ["–"] * (len(names) - 1)


IN_THE_TABLE = (("strain", 1e3), ("sigma_n_Pa", MEGA), ("sigma_n_minus_max_p_Pa", MEGA), ("sigma_n_minus_mean_p_Pa", MEGA), ("time_s", 1e3))


def run_label(number: int, seed: str, several: bool) -> str:
    return escape(CASE_WORDS[number]) + (f", pack {escape(seed)}" if several else "")


def measured_runs(variant: MeasuredVariant) -> Iterable[tuple[str, MeasuredRun]]:
    """Label and run, case after case, the packs of a case next to each other."""
    several = len(variant.packs) > 1
    for number in variant.case_numbers:
        for pack in variant.packs:
            if number in pack.runs:
                yield run_label(number, pack.seed, several), pack.runs[number]


def onset_table(variant: MeasuredVariant) -> str:
    rows = []
    for label, measured in measured_runs(variant):
        onsets = measured.onsets
        largest = max(slip.largest for slip in onsets.slips.values())
        without = f"no slip (largest {largest * 1e6:.2g} µm of the {1e6 * onset_module.THRESHOLD * onsets.diameter:.2g} µm)"
        note = f" (run ends before {onset_module.THRESHOLDS[-1]:g} d)" if onsets.onset and onsets.onset.cut_short else ""
        rows.append([label, (onsets.faster or "none") + note, *onset_cells(onsets.onset, IN_THE_TABLE, without)])
    return html_table(["case", "faster interface", "strain, 10<sup>-3</sup>", "σ<sub>n</sub>, MPa", "σ<sub>n</sub> − max p, MPa",
                       "σ<sub>n</sub> − mean p, MPa", "time, ms"], rows)


def definition_table(variant: MeasuredVariant) -> str:
    """Each interface and each definition of the onset next to each other: strain and sigma_n."""
    rows = []
    names = IN_THE_TABLE[:2]
    for label, measured in measured_runs(variant):
        cells = [label]
        for onset in (measured.onsets.slips["left"].onset, measured.onsets.slips["right"].onset):
            cells += onset_cells(onset, names, "no slip")
        cells += onset_cells(measured.onsets.as_measured, names, "not reached")
        cells += onset_cells(measured.onsets.peak_stress, names, "no peak")
        cells += onset_cells(measured.onsets.strain_rate, names, "not reached")
        rows.append(cells)
    unit = ["strain, 10<sup>-3</sup>", "σ<sub>n</sub>, MPa"]
    kinds = ("left interface", "right interface", "elastic part left in", "peak σ<sub>n</sub>", "strain rate")
    return html_table(["case", *[f"{kind}: {what}" for kind in kinds for what in unit]], rows)


def scatter_rows(scatter: pd.DataFrame, label: str) -> str:
    rows = []
    for _, row in scatter[scatter["variant"] == label].iterrows():
        cells = [escape(CASE_WORDS[int(row["case"])]), f"{row['packs_that_slip']} of {row['packs']}"]
        for name, factor in IN_THE_TABLE[:4]:
            mean, sd, own = (row[f"{name}_{kind}"] for kind in ("mean", "sd", "mean_uncertainty"))
            scatter_words = "one pack" if np.isnan(sd) else f"{sd * factor:.2f}"
            cells.append("–" if np.isnan(mean) else f"{mean * factor:.2f}, {scatter_words}, {own * factor:.2f}")
        rows.append(cells)
    return html_table(["case", "packs that slip", "strain, 10<sup>-3</sup>", "σ<sub>n</sub>, MPa", "σ<sub>n</sub> − max p, MPa",
                       "σ<sub>n</sub> − mean p, MPa"], rows)


def quasi_static_table(variant: MeasuredVariant) -> str:
    """Left against right wall, sigma_v against the stress to be held, unbalanced-force ratio: to the onset, and over the run."""
    rows = []
    for label, measured in measured_runs(variant):
        history = measured.run.history
        onset = measured.onsets.onset
        before = history["time_s"].to_numpy(float) <= (onset.at["time_s"].value if onset else np.inf)
        before[0] = False
        cells = [label]
        for values in (wall_difference(history), vertical_stress_error(measured.run), history["unbalanced_force_ratio"].to_numpy(float)):
            if values is None:
                cells += ["–", "–"]
            else:
                cells += [f"{np.nanmax(values[before]):.2g}" if before.any() else "–", f"{np.nanmax(values[1:]):.2g}"]
        cells += [f"{history['porosity_gouge'].iloc[0]:.4f}", f"{history['strain'].iloc[-1] * 1e3:.2f}",
                  f"{history['vertical_strain'].iloc[-1] * 1e3:.2f}"]
        rows.append(cells)
    return html_table(["case", "walls differ by, to onset", "all", "σ<sub>v</sub> off its target by, to onset", "all",
                       "unbalanced-force ratio, to onset", "all",
                       "gouge porosity at start", "last strain, 10<sup>-3</sup>", "last vertical strain, 10<sup>-3</sup>"], rows)


def claim_rows(findings: Sequence[Finding], with_scope: bool) -> str:
    rows = []
    for finding in findings:
        mark = finding.verdict.replace(" ", "-")
        cells = [f"({escape(finding.claim)})", escape(finding.statement) + f" <small>[{escape(finding.source)}]</small>", escape(finding.figure),
                 escape(finding.criterion), f'<span class="{mark}">{escape(finding.verdict)}</span>']
        if with_scope:
            cells = [cells[0], escape(finding.scope), cells[2], cells[4]]
        rows.append(cells)
    header = ["", "scope", "measured", "verdict"] if with_scope else ["", "the paper's claim", "measured", "criterion", "verdict"]
    return html_table(header, rows, numbers=False)


def claims_section(findings: Sequence[Finding]) -> str:
    """For every variant the claims over all packs (or on the only one), then pack by pack."""
    parts = []
    for label, mine in chief(findings).items():
        held, tested = (sum(finding.verdict in verdicts for finding in mine) for verdicts in ((REPRODUCED,), (REPRODUCED, NOT_REPRODUCED)))
        scopes = ", ".join(dict.fromkeys(finding.scope for finding in mine if finding.scope != NOT_GIVEN))
        parts.append((f"<h3>{escape(label)}</h3>" if label else "") + f"<p>{held} of {tested} tested claims reproduced, {len(mine) - tested} not tested"
                     + (f" ({escape(scopes)})" if scopes else "") + f".</p>{claim_rows(mine, False)}")
        single = [finding for finding in findings if finding.variant == label and finding not in mine]
        if single:
            parts.append(f"<details><summary>Pack by pack</summary>{claim_rows(single, True)}</details>")
    return "".join(parts)


def shifts_section(shifts: pd.DataFrame) -> str:
    if shifts.empty:
        return ""
    rows = [[escape(str(row["variant"])), f"({row['case']}), pack {escape(str(row['pack_seed']))}", f"{row['strain_shift'] * 1e3:+.3f}",
             f"{row['strain_uncertainty'] * 1e3:.3f}", f"{row['sigma_n_Pa_shift'] * MEGA:+.2f}", f"{row['sigma_n_Pa_uncertainty'] * MEGA:.2f}",
             "yes" if row["strain_shift_over_uncertainty"] < 1.0 else "no"] for _, row in shifts.iterrows()]
    return ("<h2>Onsets against the first variant</h2>" + f"<p>Differences from: {escape(str(shifts['against'].iloc[0]))}.</p>"
            + html_table(["variant", "case", "onset strain moves by, 10<sup>-3</sup>", "stated uncertainty", "σ<sub>n</sub> moves by, MPa",
                          "stated uncertainty",
                          "strain within its uncertainty"], rows))


def figure_section(figures: Sequence[VariantFigures]) -> str:
    parts = []
    for group in figures:
        parts.append(f"<h3>{escape(group.variant.label)}</h3>" if group.variant.label else "")
        parts.append(f"<p>Drawn for pack {escape(group.seed)}, unless said otherwise.</p>" if len(group.variant.packs) > 1 else "")
        parts.append(pictures_section(group.pictures))
    return "".join(parts)


def pictures_section(pictures: Iterable[Picture]) -> str:
    return "".join(f'<figure><img src="{escape(picture.name)}" alt="{escape(picture.caption)}"><figcaption>{escape(picture.caption)}</figcaption></figure>'
                   for picture in pictures)


def onset_sections(figures: Sequence[VariantFigures], scatter: pd.DataFrame, shifts: pd.DataFrame) -> list[str]:
    """All that follows from the onsets of slip, and the figures."""
    body = []
    for heading, content in (("Onset of slip on the faster interface", onset_table), ("Where the onset is read", definition_table),
                             ("Quasi-static check", quasi_static_table)):
        body.append(f"<h2>{heading}</h2>")
        for group in figures:
            body.append((f"<h3>{escape(group.variant.label)}</h3>" if group.variant.label else "") + content(group.variant))
            if content is onset_table and len(group.variant.packs) > 1:
                body.append("<p>Over packs: mean, standard deviation, mean stated uncertainty.</p>" + scatter_rows(scatter, group.variant.label))
        if content is onset_table:
            body.append(f"<details><summary>How the onset is defined</summary><pre>{escape((onset_module.__doc__ or '').strip())}</pre></details>")
    return body + [shifts_section(shifts), "<h2>Figures</h2>", figure_section(figures)]


def write(title: str, command: str, versions: str, warnings: Sequence[str], figures: Sequence[VariantFigures], couplings: Sequence[Picture],
          findings: Sequence[Finding], scatter: pd.DataFrame, shifts: pd.DataFrame) -> str:
    """The page as text. couplings: figures of pairs of runs, one-way and two-way."""
    tables = ["table.csv", "scatter.csv"] * bool(figures) + ["claims.csv"] + ["shifts.csv"] * bool(len(shifts))
    intro = f"<p>Made by</p><pre>{escape(command)}</pre><p>{escape(versions)}. Numbers of this page: {', '.join(tables)}; units in the names of their columns.</p>"
    if warnings:
        intro += "<p class=\"warning\">Mind:</p><ul>" + "".join(f"<li>{escape(one)}</li>" for one in warnings) + "</ul>"
    body = ["<h2>Claims of the paper against these runs</h2>", claims_section(findings)]
    if couplings:
        body.append(f"<h2>One-way and two-way coupling</h2>{pictures_section(couplings)}")
    if figures:
        body += onset_sections(figures, scatter, shifts)
    return PAGE.substitute(title=escape(title), intro=intro, body="\n".join(body))
