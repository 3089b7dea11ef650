"""Figure of the scene (the paper's Fig. 3): grains by part, plates and loads, pore pressures of the cases."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgb

from .figure_style import CASE_WORDS, MEGA, PAGE, PART_COLOUR, Picture, box_axes, draw_grains, print_style, save
from .results import MeasuredRun
from .run_files import Run, read_grains
from .scene_geometry import is_upright, outline

PREFERRED = (2, 1, 3, 4, 5)
"""The case whose grains are shown: the first of these that has a snapshot."""


ARROW = {"arrowstyle": "-|>", "linewidth": 0.7, "color": "black"}


def grain_panel(axes: plt.Axes, run: Run) -> None:
    """Grains at the first snapshot seen from the front, walls and plates with their loads."""
    grains = read_grains(run, 0)
    shape = outline(run.case, grains)
    (x_low, _, z_low), (x_high, _, z_high) = shape.lower, shape.upper
    colours = np.array([to_rgb(PART_COLOUR.get(part, "#bbbbbb")) for part in (0, 1, 2, 3)])[np.clip(grains.part, 0, 3)]
    draw_grains(axes, grains.position, grains.radius, colours, edge=0.3)
    box_axes(axes, shape, margin=11.0)
    for x, direction in ((x_low, -1.0), (x_high, 1.0)):
        axes.plot([x, x], [z_low, z_high], color="black", linewidth=2.5, solid_capstyle="butt")
        for z in np.linspace(z_low, z_high, 7)[1:-1]:
            axes.annotate("", (x + direction * 0.8, z), (x + direction * 6.0, z), arrowprops=ARROW)
    if is_upright(run):
        words = "held total stress"
        axes.text(shape.middle[0], z_high + 2.0, "periodic", ha="center", va="bottom")
        for side, x in ((-1.0, x_low - 7.5), (1.0, x_high + 7.5)):
            axes.annotate("", (x, shape.middle[2] + side * 6.0), (x, shape.middle[2] - side * 6.0), arrowprops=ARROW)
    else:
        words = "closing at a constant strain rate"
        for first, last, z in shape.plates():
            axes.plot([first, last], [z, z], color="black", linewidth=2.5, solid_capstyle="butt")
            sign = 1.0 if z > shape.middle[2] else -1.0
            for x in np.linspace(first, last, max(3, int((last - first) / 8.0)))[1:-1]:
                axes.annotate("", (x, z + sign * 0.8), (x, z + sign * 5.0), arrowprops=ARROW)
        stress = run.case.get("loading", {}).get("vertical_stress_Pa")
        if stress:
            axes.text(shape.middle[0], z_high + 6.0, rf"$\sigma_v$ = {stress * MEGA:g} MPa on each block face", ha="center", va="bottom")
    axes.text(x_low - (9.5 if is_upright(run) else 8.0), shape.middle[2], words, rotation=90, ha="right", va="center")
    for text, part in (("left block", 1), ("gouge", 2), ("right block", 3)):
        members = grains.position[grains.part == part]
        if len(members):
            x, z = 1e3 * members.mean(axis=0)[[0, 2]]
            axes.text(x, z, text, ha="center", va="center", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5})
    axes.set_axis_off()


def pressure_panel(axes: plt.Axes, run: Run, title: str, top: float) -> plt.cm.ScalarMappable:
    """The pore pressure at the end of the run: that of the blocks, linear across the gouge; MPa."""
    shape = outline(run.case, None)
    x, z = np.linspace(0, shape.upper[0], 200), np.linspace(0, shape.upper[2], 125)
    share = np.clip(0.5 + shape.across(x[None, :], z[:, None]) / shape.width, 0.0, 1.0)
    left, right = float(run.history["p_left_Pa"].iloc[-1]), float(run.history["p_right_Pa"].iloc[-1])
    shown = axes.imshow(((1.0 - share) * left + share * right) * MEGA, origin="lower", cmap="Blues", vmin=0.0, vmax=top,
                        extent=(0, shape.upper[0], 0, shape.upper[2]))
    for x_line, z_line in shape.interfaces:
        axes.plot(x_line, z_line, color="black", linewidth=0.5)
    box_axes(axes, shape, margin=0.0)
    for value, (u, v) in ((left, (0.16, 0.2)), (right, (0.84, 0.8))):
        axes.text(u, v, f"{value * MEGA:.3g}", transform=axes.transAxes, ha="center", va="center",
                  color="white" if value * MEGA > 0.6 * top else "black")
    axes.set_title(title, fontsize=7.5)
    axes.set_xticks([])
    axes.set_yticks([])
    return shown


def scene(runs: Mapping[int, MeasuredRun], directory: Path, stem: str, dpi: int, pdf: bool) -> Picture | None:
    """Grains with plates and loads above, the pressures of the cases below; None when no run has a snapshot."""
    shown = next((runs[number].run for number in PREFERRED if number in runs and len(runs[number].run.snapshots)), None)
    if shown is None:
        return None
    with print_style():
        figure = plt.figure(figsize=(PAGE, 5.6), layout="constrained")
        above, below = figure.subfigures(2, 1, height_ratios=(3.6, 1.25))
        grain_panel(above.subplots(), shown)
        panels = below.subplots(1, len(PREFERRED))
        for axes in panels[len(runs):]:
            axes.set_axis_off()
        top = max(max(one.run.history["p_left_Pa"].max(), one.run.history["p_right_Pa"].max()) for one in runs.values()) * MEGA
        for axes, (number, one) in zip(panels, runs.items()):
            colours = pressure_panel(axes, one.run, CASE_WORDS[number], max(top, 1e-9))
        below.colorbar(colours, ax=list(panels), shrink=0.7, label="p (MPa)")
        caption = (f"The scene, like Fig. 3 of the paper: grains at the start of the loading ({shown.name}) seen from the front, walls and "
                   "plates with their loads; below, pore pressure (MPa) at the end of each case.")
        return save(figure, directory, stem, caption, dpi, pdf)
