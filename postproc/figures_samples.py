"""Figures of the scene "sample": consolidation over Terzaghi's curve, undrained pressure against stress, flow towards the steady state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from .figure_style import CASE_STYLE, COLUMN, MEGA, PAGE, Picture, letter, print_style, save
from .samples import Consolidation, Sample, Undrained

STYLES = (CASE_STYLE[2], CASE_STYLE[3], CASE_STYLE[4], CASE_STYLE[1])
ANALYTIC = {"color": "0.55", "linewidth": 2.4, "zorder": 1.5}
#: Faces in pairs; flow out of both tells how far the flow is from the steady one.
PAIRS = (("xmin", "xmax"), ("ymin", "ymax"), ("zmin", "zmax"))


def consolidation_curves(measured: Sequence[Consolidation], directory: Path, dpi: int, pdf: bool) -> Picture:
    """Degree of consolidation over the time factor, from the settlement and from the pressure, over Terzaghi's; and what is left between."""
    with print_style():
        figure, panels = plt.subplots(2, 2, figsize=(PAGE, 3.9), sharex=True, sharey="row", layout="constrained", height_ratios=(2.2, 1.0))
        for column, (words, name) in enumerate((("from the settlement", "settled"), ("from the mean pressure", "drained"))):
            above, below = panels[:, column]
            for one, style in zip(measured, _styles(len(measured))):
                values = getattr(one, name)
                above.plot(one.time_factor, one.analytic, label="Terzaghi" if one is measured[0] else None, **ANALYTIC)
                above.plot(one.time_factor, values, label=one.sample.name, **style)
                below.plot(one.time_factor, values - one.analytic, **style)
            above.set_ylim(1.0, 0.0)
            below.axhline(0.0, color="0.55", linewidth=0.8)
            below.set_xlabel(r"time factor $c_v t / H^2$")
            above.text(0.97, 0.93, words, transform=above.transAxes, ha="right", va="top")
        panels[0, 0].set_ylabel("degree of consolidation")
        panels[1, 0].set_ylabel("difference")
        panels[0, 0].legend(loc="lower left")
        letter(panels.ravel())
        caption = "Degree of consolidation of a layer that drains through its top (a) from the settlement of the top, (b) from the mean pressure, over Terzaghi's; (c), (d) " \
                  "the difference. c_v from the stiffness of the dry pack and the permeability, both measured on the same pack; none of the curves is fitted. " + " ".join(
                      f"{one.sample.name}: rms {one.error(one.settled)[0]:.3f} and {one.error(one.drained)[0]:.3f}." for one in measured)
        return save(figure, directory, "consolidation", caption, dpi, pdf)


def undrained_paths(measured: Sequence[Undrained], directory: Path, dpi: int, pdf: bool) -> Picture:
    """Mean pressure against the rise of the mean raised stress, over the predicted slope."""
    with print_style():
        figure, panels = plt.subplots(1, 2, figsize=(PAGE, 2.9), layout="constrained")
        for one, style in zip(measured, _styles(len(measured))):
            history, rise = one.sample.history, one.sample.rise(one.sample.raised) * MEGA
            pressure = history["pressure_mean_Pa"].to_numpy(float) * MEGA
            ends = np.array([0.0, rise.max()])
            panels[0].plot(ends, one.predicted * ends, **ANALYTIC)
            panels[0].plot(rise, pressure, label=one.words, **style)
            loaded = rise > 0.2 * rise.max()
            panels[1].axhline(one.predicted, **ANALYTIC)
            panels[1].plot(history["time_s"].to_numpy(float)[loaded] * 1e6, (pressure / np.where(loaded, rise, 1.0))[loaded], **style)
        panels[0].set_xlabel("rise of the total stress (MPa)")
        panels[0].set_ylabel("mean pore pressure (MPa)")
        panels[0].legend(loc="upper left")
        panels[1].set_xlabel(r"time ($\mu$s)")
        panels[1].set_ylabel("pressure over stress")
        letter(panels)
        caption = "Undrained loading of a sealed pack: (a) mean pore pressure against the rise of the total stress, (b) their ratio over time. Grey: 1 / (1 + porosity beta M) " \
                  "with the modulus M of the dry twin (for isotropic stress, Skempton's B). " + " ".join(
                      f"{one.words}: {one.measured:.4f}, predicted {one.predicted:.4f}." for one in measured)
        return save(figure, directory, "undrained", caption, dpi, pdf)


def towards_steady(samples: Sequence[Sample], directory: Path, dpi: int, pdf: bool) -> Picture:
    """Flow in and out over time."""
    with print_style():
        figure, axes = plt.subplots(figsize=(COLUMN, 2.5), layout="constrained")
        for sample, style in zip(samples, _styles(len(samples))):
            low, high = next(pair for pair in PAIRS if set(pair) <= set(sample.faces))
            sign = 1.0 if sample.faces[low] > sample.faces[high] else -1.0
            history = sample.history.iloc[1:]
            time = history["time_s"].to_numpy(float) * 1e6
            into, out = -sign * history[f"outflow_{low}_m3_per_s"], sign * history[f"outflow_{high}_m3_per_s"]
            axes.plot(time, into * 1e6, label=f"{sample.name}, in", **style)
            axes.plot(time, out * 1e6, label="out", **style | {"linestyle": ":", "color": "#D55E00"})
            # What first fills the pores is far above the steady flow.
            axes.set_ylim(0.0, 2.0 * float(out.iloc[-1]) * 1e6)
        axes.set_xlabel(r"time ($\mu$s)")
        axes.set_ylabel(r"flow (10$^{-6}$ m$^3$/s)")
        axes.legend(loc="upper right")
        return save(figure, directory, "darcy", "Flow into the pack and out of it, until it is steady; the permeability is read at the end.", dpi, pdf)


def loading_paths(samples: Sequence[Sample], directory: Path, dpi: int, pdf: bool) -> Picture:
    """Strains, total stresses and mean pore pressure over time."""
    with print_style():
        figure, panels = plt.subplots(1, 3, figsize=(PAGE, 2.7), layout="constrained")
        for sample, style in zip(samples, _styles(len(samples))):
            time = sample.history["time_s"].to_numpy(float) * 1e6
            for axis, dash in zip("xyz", (":", "--", "-")):
                line = style | {"linestyle": dash}
                panels[0].plot(time, sample.history[f"strain_{axis}"], label=f"{sample.name}, {axis}", **line)
                panels[1].plot(time, sample.history[f"sigma_{axis}_Pa"] * MEGA, **line)
            panels[2].plot(time, sample.history["pressure_mean_Pa"] * MEGA, **style | {"linestyle": "-"})
        for axes, words in zip(panels, ("strain", "total stress (MPa)", "mean pore pressure (MPa)")):
            axes.set_xlabel(r"time ($\mu$s)")
            axes.set_ylabel(words)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        letter(panels)
        return save(figure, directory, "loading", "(a) Strains, positive in compression, (b) total stresses, (c) mean pore pressure over time.", dpi, pdf)


def _styles(count: int) -> list[dict[str, object]]:
    return [STYLES[k % len(STYLES)] for k in range(count)]
