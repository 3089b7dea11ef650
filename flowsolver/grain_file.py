"""Grains from a file: text with x y z r on each line, or a dump of LIGGGHTS or LAMMPS."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsolver.network import InputError


@dataclass(frozen=True)
class Grains:
    """id (n,) int64; position (n, 3) float64, m; radius (n,) float64, m; box (6,) float64, m, x low, x high, ... or None."""

    id: NDArray[np.int64]
    position: NDArray[np.float64]
    radius: NDArray[np.float64]
    box: NDArray[np.float64] | None


def read_grains(path: Path) -> Grains:
    """Read a pack. Of a dump with several steps the last is taken."""
    try:
        with open(path) as file:
            dump = file.readline().startswith("ITEM:")
        return _read_dump(path) if dump else _read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {error}; expected text with x y z r on each line, or a dump") from None


def _read_text(path: Path) -> Grains:
    try:
        with warnings.catch_warnings():
            # That a file holds nothing is said below.
            warnings.simplefilter("ignore", UserWarning)
            rows = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected four numbers x y z r on each line") from None
    if rows.size == 0:
        raise InputError(f"{path} holds no grains: expected x y z r on each line, in m")
    if rows.shape[1] != 4:
        raise InputError(f"{path} has {len(rows)} lines of {rows.shape[1]} numbers: expected four on each line, x y z r, in m")
    return Grains(np.arange(len(rows)), rows[:, :3].copy(), rows[:, 3].copy(), None)


def _read_dump(path: Path) -> Grains:
    box, columns, rows = None, None, None
    with open(path) as file:
        while line := file.readline():
            if line.startswith("ITEM: NUMBER OF ATOMS"):
                count = int(file.readline())
            elif line.startswith("ITEM: BOX BOUNDS"):
                box = np.array([file.readline().split()[:2] for _ in range(3)], float).ravel()
            elif line.startswith("ITEM: ATOMS"):
                columns = line.split()[2:]
                lines = [file.readline() for _ in range(count)]
                try:
                    rows = np.loadtxt(lines, ndmin=2, usecols=[columns.index(c) for c in ("id", "x", "y", "z", "radius")])
                except ValueError as error:
                    raise InputError(f"{path}: {error}; expected a dump custom with id x y z radius, has {' '.join(columns)}") from None
                if len(rows) != count:
                    raise InputError(f"{path} ends after {len(rows)} of {count} grains; dump it anew")
    if rows is None:
        raise InputError(f"{path} is a dump without ITEM: ATOMS")
    return Grains(rows[:, 0].astype(np.int64), rows[:, 1:4].copy(), rows[:, 4].copy(), box)
