"""Figure of a pair of runs, one-way and two-way (the paper's Fig. 7): displacements side by side, their difference, the pressure change."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from .coupling_pairs import Pair, root_mean_square
from .figure_style import PAGE, Picture, box_axes, draw_grains, letter, print_style, save
from .figures_forces import displacement_panel, slice_of
from .run_files import mean_diameter, read_grains
from .scene_geometry import outline

SHARE_IN_RANGE = 0.99
"""The colours of a map end at this quantile of what it shows."""


def one_way_and_two_way(pair: Pair, directory: Path, stem: str, dpi: int, pdf: bool) -> Picture:
    """Maps at the last snapshot of both, and how differences grow with the strain."""
    last, run = pair.last, pair.one_way
    diameter, shape = mean_diameter(run.case, run.directory / "case.json"), outline(run.case, read_grains(run, 0))
    inside = slice_of(last.one_way.position, shape, 1.5 * diameter)
    position, radius = last.one_way.position[inside], last.one_way.radius[inside]
    top = float(np.quantile(1e6 * np.linalg.norm(last.one_way.displacement, axis=1), SHARE_IN_RANGE))
    differs = 1e6 * np.linalg.norm(last.displacement, axis=1)
    furthest = max(1e-3 * last.largest_pressure, 1e-12)
    with print_style():
        height = 0.5 * PAGE * 0.92 * shape.size[2] / shape.size[0]
        figure, panels = plt.subplots(3, 2, figsize=(PAGE, 2 * height + 3.1), layout="constrained", height_ratios=(height, height, 1.5))
        for axes, grains, words in ((panels[0, 0], last.one_way, "one-way"), (panels[0, 1], last.two_way, "two-way")):
            shown = displacement_panel(axes, grains, shape, diameter, max(top, 1e-9))
            axes.set_title(words)
        figure.colorbar(shown, ax=panels[0, :], shrink=0.5, aspect=40, location="bottom", label=r"displacement ($\mu$m)")
        ends = (0.0, max(float(np.quantile(differs, SHARE_IN_RANGE)), 1e-12))
        for axes, values, words, colours in (
            (panels[1, 0], differs[inside], r"size of the difference ($\mu$m)", {"cmap": "cividis", "clim": ends}),
            (panels[1, 1], 1e-3 * last.pressure[inside], "pressure change (kPa)", {"cmap": "RdBu_r", "clim": (-furthest, furthest)}),
        ):
            figure.colorbar(draw_grains(axes, position, radius, values, edge=0.0, **colours), ax=axes, shrink=0.9, location="bottom", label=words)
        for axes in panels[:2].ravel():
            box_axes(axes, shape)
            axes.set_xticks([])
            axes.set_yticks([])
            for x, z in shape.interfaces:
                axes.plot(x, z, color="black" if axes is panels[1, 1] else "white", linewidth=0.8, linestyle=(0, (4, 2)))
        _over_strain(pair, *panels[2])
        letter(panels.ravel())
        caption = (
            f"One-way against two-way coupling at strain {last.strain * 1e3:.3g}e-3, like Fig. 7 of the paper. (a), (b): displacement since the start of the "
            "loading (slice through the middle, arrows as the square root of its size). (c): size of the difference of both, (d): pressure around each grain, "
            f"two-way less one-way. (e): root mean square of displacement and of difference, (f): pressure change. Largest difference {differs.max():.3g} µm, "
            f"rms {100 * last.displacement_share:.2g} % of the displacement; largest pressure change "
            f"{last.largest_pressure / 1e3:.3g} kPa at a horizontal stress of {pair.horizontal_stress / 1e6:.3g} MPa. Dashed: interfaces at the start.")
        return save(figure, directory, stem, caption + (f" {pair.label}." if pair.label else ""), dpi, pdf)


def _over_strain(pair: Pair, displacements: plt.Axes, pressures: plt.Axes) -> None:
    strain = 1e3 * np.array([one.strain for one in pair.differences])
    moved = [1e6 * root_mean_square(one.one_way.displacement) for one in pair.differences]
    differs = [1e6 * root_mean_square(one.displacement) for one in pair.differences]
    displacements.semilogy(strain, moved, "k-", label="displacement, one-way")
    displacements.semilogy(strain, differs, color="#D55E00", linestyle=(0, (4, 1.2, 1, 1.2)), marker=".", label="difference")
    displacements.set_ylabel(r"rms ($\mu$m)")
    pressures.semilogy(strain, [one.largest_pressure for one in pair.differences], "k-", marker=".", label="largest around a grain")
    pressures.semilogy(strain, [one.rms_pressure for one in pair.differences], color="#D55E00", linestyle=(0, (4, 1.2, 1, 1.2)), marker=".", label="rms")
    pressures.set_ylabel("pressure change (Pa)")
    for axes in (displacements, pressures):
        axes.set_xlabel(r"horizontal strain ($10^{-3}$)")
        axes.legend()
