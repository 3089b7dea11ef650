"""Figures of snapshots: displacement and force chains (the paper's Fig. 4), contact force histograms (Fig. 5)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

from .figure_style import CASE_WORDS, PAGE, Picture, box_axes, draw_grains, print_style, save
from .results import MeasuredRun
from .run_files import Contacts, Grains, mean_diameter, read_contacts, read_grains
from .scene_geometry import Outline, is_upright, outline

WIDEST_LINE = 2.2
"""Points; the width of a contact at the reference force."""

REFERENCE_SHARE = 0.998
"""The reference force is this quantile of all contact forces drawn, so that a single contact does not thin all others."""

BINS = 36

SMALLEST_FORCE = 1e-3
"""Share of the largest force at which the histograms begin."""


def slice_of(position: np.ndarray, outline: Outline, thickness: float) -> np.ndarray:
    """(N,) bool: y (position in m) within half of `thickness` (m) of the middle of the box."""
    return np.abs(position[..., 1] - 1e-3 * outline.middle[1]) <= 0.5 * thickness


def displacement_panel(axes: plt.Axes, grains: Grains, outline: Outline, diameter: float, top: float) -> plt.cm.ScalarMappable:
    """Grains of the middle slice coloured by the size of their displacement (micrometres), arrows for its direction."""
    inside = slice_of(grains.position, outline, 1.5 * diameter)
    position, moved = grains.position[inside], grains.displacement[inside]
    size = 1e6 * np.linalg.norm(moved, axis=1)
    drawn = draw_grains(axes, position, grains.radius[inside], size, edge=0.0, cmap="cividis", clim=(0.0, top))
    if len(position):
        chosen = np.random.default_rng(0).permutation(len(position))[:140]
        length = np.maximum(np.linalg.norm(moved[chosen][:, [0, 2]], axis=1), 1e-300)[:, None]
        arrows = moved[chosen][:, [0, 2]] / length * np.minimum(length * 1e6 / top, 1.0) ** 0.5 * 5.0
        axes.quiver(*(1e3 * position[chosen][:, [0, 2]]).T, *arrows.T, angles="xy", scale_units="xy", scale=1.0,
                    width=0.004, headwidth=4, color="white", edgecolor="black", linewidth=0.25)
    return drawn


def chain_panel(axes: plt.Axes, contacts: Contacts, outline: Outline, diameter: float, reference: float) -> None:
    """Contacts of the middle slice; the width of a line is proportional to the normal force, tension is dashed grey."""
    middle = contacts.ends.mean(axis=1)
    inside = slice_of(middle, outline, 2.5 * diameter)
    force = contacts.force_normal
    for chosen, colour in ((inside & (force > 0.0), "black"), (inside & (force < 0.0), "#D55E00")):
        order = np.flatnonzero(chosen)[np.argsort(np.abs(force[chosen]))]
        width = np.minimum(np.abs(force[order]) / reference, 1.0) * WIDEST_LINE
        kept = width > 0.02
        axes.add_collection(LineCollection(1e3 * contacts.ends[order[kept]][:, :, [0, 2]], linewidths=width[kept], colors=colour,
                                           capstyle="round"))


def displacement_and_chains(runs: Mapping[int, MeasuredRun], directory: Path, stem: str, dpi: int, pdf: bool) -> Picture | None:
    """Like Fig. 4: a row a case, displacement left and force chains right, at the last snapshot."""
    shown = {number: one.run for number, one in runs.items() if len(one.run.snapshots)}
    if not shown:
        return None
    grains = {number: read_grains(run, -1) for number, run in shown.items()}
    contacts = {number: read_contacts(run, -1) for number, run in shown.items()}
    top = max(float(np.quantile(1e6 * np.linalg.norm(one.displacement, axis=1), 0.99)) for one in grains.values())
    forces = np.concatenate([np.abs(one.force_normal) for one in contacts.values()])
    reference = float(np.quantile(forces, REFERENCE_SHARE)) if len(forces) else 1.0
    with print_style():
        outlines = {number: outline(run.case, read_grains(run, 0)) for number, run in shown.items()}
        size = next(iter(outlines.values())).size
        height = 0.5 * PAGE * 0.92 * size[2] / size[0]
        figure, panels = plt.subplots(len(shown), 2, figsize=(PAGE, (height + 0.06) * len(shown) + 0.7), squeeze=False, layout="constrained")
        for row, (number, run) in enumerate(shown.items()):
            diameter = mean_diameter(run.case, run.directory / "case.json")
            colours = displacement_panel(panels[row, 0], grains[number], outlines[number], diameter, max(top, 1e-9))
            chain_panel(panels[row, 1], contacts[number], outlines[number], diameter, max(reference, 1e-300))
            strain = float(run.snapshots["strain"].iloc[-1])
            for axes in panels[row]:
                box_axes(axes, outlines[number])
                axes.set_xticks([])
                axes.set_yticks([])
                for x, z in outlines[number].interfaces:
                    axes.plot(x, z, color="white" if axes is panels[row, 0] else "#0072B2", linewidth=0.8, linestyle=(0, (4, 2)))
            reached = "" if is_upright(run) else f"\nstrain {strain * 1e3:.2f}" + r"$\times 10^{-3}$"
            panels[row, 0].set_ylabel(CASE_WORDS[number] + reached)
        figure.colorbar(colours, ax=panels[:, 0], location="bottom", shrink=0.7, pad=0.01, aspect=40, label=r"displacement ($\mu$m)")
        handles = [plt.Line2D([], [], color="black", linewidth=WIDEST_LINE * share) for share in (1.0, 0.5, 0.1)]
        panels[-1, 1].legend(handles, [f"{reference * share:.0f} N" for share in (1.0, 0.5, 0.1)], loc="upper center",
                             bbox_to_anchor=(0.5, -0.02), ncols=3, title="normal force", title_fontsize=7.5, borderpad=0.1)
        caption = ("Displacement since the start of the loading (left; slice through the middle, arrows as the square root of its size) and "
                   "force chains (right; width proportional to the normal force, orange: tension) at the last snapshot, like Fig. 4 of the paper. "
                   "Dashed: interfaces at the start.")
        return save(figure, directory, stem, caption, dpi, pdf)


def force_histograms(runs: Mapping[int, MeasuredRun], directory: Path, stem: str, dpi: int, pdf: bool) -> Picture | None:
    """Like Fig. 5: normal force of the contacts of gouge grains at the first and the last snapshot."""
    shown = {number: one.run for number, one in runs.items() if len(one.run.snapshots) > 1}
    if not shown:
        return None
    forces = {}
    for number, run in shown.items():
        found = [read_contacts(run, row) for row in (0, -1)]
        forces[number] = [one.force_normal[one.of_gouge] for one in found]
    largest = max((float(one.max()) for pair in forces.values() for one in pair if len(one)), default=1.0)
    edges = np.geomspace(SMALLEST_FORCE * largest, largest * (1.0 + 1e-9), BINS + 1)
    tallest = max(float(np.histogram(one, edges)[0].max()) for pair in forces.values() for one in pair)
    room = 60.0  # above the tallest bar, for the words
    with print_style():
        columns = min(len(shown), 3)
        rows = -(-len(shown) // columns)
        figure, panels = plt.subplots(rows, columns, figsize=(PAGE if columns > 1 else 3.4, 2.1 * rows + 0.3), sharex=True, sharey=True,
                                      squeeze=False, layout="constrained")
        for axes in panels.ravel()[len(shown):]:
            axes.set_axis_off()
        for axes, (number, (first, last)) in zip(panels.ravel(), forces.items()):
            axes.hist(first, edges, color="#56B4E9", alpha=0.75, label=f"start: {len(first)} contacts,\nlargest {first.max(initial=0.0):.0f} N")
            axes.hist(last, edges, histtype="step", color="black", linewidth=1.2, hatch="////",
                      label=f"end: {len(last)} contacts,\nlargest {last.max(initial=0.0):.0f} N")
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_ylim(0.7, room * max(tallest, 1.0))
            axes.set_title(CASE_WORDS[number], loc="left")
            axes.legend(loc="upper left", handlelength=1.6)
        for axes in panels[:, 0]:
            axes.set_ylabel("contacts")
        for axes in panels.ravel()[max(0, len(shown) - columns):len(shown)]:
            axes.set_xlabel("normal force (N)")
            axes.tick_params(labelbottom=True)
        caption = ("Normal forces of the contacts of gouge grains at the first and the last snapshot, like Fig. 5 of the paper. "
                   f"Bins of equal ratio; forces below {edges[0]:.2g} N are counted but not drawn.")
        return save(figure, directory, stem, caption, dpi, pdf)
