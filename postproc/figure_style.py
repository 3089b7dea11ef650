"""One look for all figures: sizes for print, line styles that survive black and white, colours for the colour-blind.

Colours are those of Okabe & Ito (2008), https://jfly.uni-koeln.de/color/, in an order of falling contrast to paper.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import EllipseCollection  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from .scene_geometry import Outline  # noqa: E402

COLUMN = 3.4
PAGE = 7.0
"""Widths of a column and of a page, inches."""

CASE_STYLE: dict[int, dict[str, object]] = {
    1: {"color": "#000000", "linestyle": "-", "linewidth": 1.4},
    2: {"color": "#0072B2", "linestyle": (0, (5, 1.5)), "linewidth": 1.3},
    3: {"color": "#D55E00", "linestyle": (0, (4, 1.2, 1, 1.2)), "linewidth": 1.3},
    4: {"color": "#009E73", "linestyle": (0, (1, 1)), "linewidth": 1.6},
    5: {"color": "#999999", "linestyle": "-", "linewidth": 2.2, "zorder": 1.5},
}
CASE_MARKER = {1: "o", 2: "<", 3: ">", 4: "s", 5: "D"}
CASE_WORDS = {1: "(1) both sides", 2: "(2) left only", 3: "(3) right only", 4: "(4) half on both", 5: "(5) dry"}
PART_COLOUR = {1: "#7fb3d5", 2: "#f2e2b6", 3: "#c8703a"}
"""Left block, gouge, right block: grey values of 0.65, 0.89 and 0.52."""

MEGA = 1e-6


@dataclass(frozen=True)
class Picture:
    """A figure that was written.  name: file name without directory; caption: one or two sentences for the page."""

    name: str
    caption: str


@contextmanager
def print_style() -> Iterator[None]:
    """Fonts of 8 pt, thin axes, ticks inwards."""
    settings = {
        "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 8, "legend.fontsize": 7.5, "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5, "axes.linewidth": 0.6, "xtick.direction": "in", "ytick.direction": "in",
        "xtick.top": True, "ytick.right": True, "legend.frameon": False, "legend.handlelength": 3.2,
        "font.family": "DejaVu Sans", "pdf.fonttype": 42, "mathtext.default": "regular",
    }
    with plt.rc_context(settings):
        yield


def save(figure: Figure, directory: Path, stem: str, caption: str, dpi: int, pdf: bool) -> Picture:
    """Write <stem>.png (and <stem>.pdf) and close the figure."""
    figure.savefig(directory / f"{stem}.png", dpi=dpi)
    if pdf:
        figure.savefig(directory / f"{stem}.pdf")
    plt.close(figure)
    return Picture(f"{stem}.png", caption)


def letter(axes: Iterable[plt.Axes]) -> None:
    """(a), (b), ... in the upper left corner, outside of the axes."""
    for index, one in enumerate(axes):
        one.set_title(f"({chr(97 + index)})", loc="left", fontsize=8)


def draw_grains(axes: plt.Axes, position: np.ndarray, radius: np.ndarray, colours: np.ndarray, edge: float = 0.15,
                **more: object) -> EllipseCollection:
    """Grains in the x-z plane, those further back (larger y) first; lengths in mm.

    position: (N, 3), m; radius: (N,), m; colours: (N, 3 or 4) colours or (N,) numbers for a colour map.
    """
    order = np.argsort(-position[:, 1], kind="stable")
    size = 2e3 * radius[order]
    named = {"array": colours[order]} if colours.ndim == 1 else {"facecolors": colours[order]}
    grains = EllipseCollection(size, size, np.zeros(len(size)), units="xy", offsets=1e3 * position[order][:, [0, 2]],
                               transOffset=axes.transData, edgecolors="black", linewidths=edge, **named, **more)
    axes.add_collection(grains)
    return grains


def box_axes(axes: plt.Axes, outline: Outline, margin: float = 1.0) -> None:
    """Equal scales and limits of the box in the x-z plane, mm."""
    axes.set_aspect("equal")
    axes.set_xlim(outline.lower[0] - margin, outline.upper[0] + margin)
    axes.set_ylim(outline.lower[2] - margin, outline.upper[2] + margin)
