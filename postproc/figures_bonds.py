"""Figure of the bonds broken, in space and in time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from .figure_style import CASE_STYLE, CASE_WORDS, PAGE, Picture, box_axes, print_style, save
from .figures_curves import abscissa
from .results import MeasuredRun
from .run_files import Run, read_grains
from .scene_geometry import outline

MODE_MARKER = {"tension": ("o", "#0072B2"), "shear": ("x", "#D55E00")}


def place_panel(axes: plt.Axes, run: Run, title: str) -> None:
    """Where the bonds of one run broke, in the x-z plane, by mode."""
    shape = outline(run.case, read_grains(run, 0) if len(run.snapshots) else None)
    box_axes(axes, shape)
    for x, z in shape.interfaces:
        axes.plot(x, z, color="0.3", linewidth=0.7, linestyle=(0, (4, 2)))
    modes = run.bonds["mode"].astype(str).str.strip()
    for mode, (marker, colour) in MODE_MARKER.items():
        chosen = run.bonds[modes == mode]
        axes.plot(1e3 * chosen["x_m"].astype(float), 1e3 * chosen["z_m"].astype(float), marker, linestyle="none", color=colour,
                  markersize=3.0 if len(run.bonds) < 300 else 1.5, markeredgewidth=0.7, fillstyle="none", label=mode)
    if run.bonds.empty:
        axes.text(*shape.middle[[0, 2]], "none", ha="center", va="center", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
    axes.set_title(title, fontsize=7.5)
    axes.set_xticks([])
    axes.set_yticks([])


def broken_bonds(runs: Mapping[int, MeasuredRun], directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """Where bonds broke, a panel a case, and below how many; says so when none did."""
    total = sum(len(one.run.bonds) for one in runs.values())
    start = max(int(one.run.history["bonds_intact"].iloc[0]) for one in runs.values())
    with print_style():
        figure = plt.figure(figsize=(PAGE, 3.9 if total else 1.7), layout="constrained")
        below = figure
        if total:
            above, below = figure.subfigures(2, 1, height_ratios=(1.0, 1.7))
            panels = np.atleast_1d(above.subplots(1, len(runs)))
            for axes, (number, one) in zip(panels, runs.items()):
                place_panel(axes, one.run, CASE_WORDS[number])
            above.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, handlelength=1.0)
        count = below.subplots()
        for number, one in runs.items():
            history = one.run.history
            against, factor, words = abscissa(one)
            count.plot(factor * history[against], history["bonds_broken_tension"] + history["bonds_broken_shear"],
                       label=CASE_WORDS[number], **CASE_STYLE[number])
        count.set_xlabel(words)
        count.set_ylabel("bonds broken")
        count.set_ylim(0, max(1.05 * count.get_ylim()[1], 1.0))
        below.legend(*count.get_legend_handles_labels(), loc="outside right center")
        if not total:
            count.text(0.5, 0.5, "no bond broke in any case", transform=count.transAxes, ha="center", va="center")
        words = (f"{total} bonds broke in all of {start} in each case. Above: where, by mode; below: how many." if total
                 else f"No bond broke; there were {start} in each case.")
        return save(figure, directory, stem, words, dpi, pdf)
