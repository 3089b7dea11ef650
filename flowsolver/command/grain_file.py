"""Grains from a file: text with x y z r on each line, or a dump of LIGGGHTS or LAMMPS. Each rank reads its share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver.command.lines_of_file import Table, places_of, read_rows, size_and_start
from flowsolver.network import InputError

_COLUMNS = ("id", "x", "y", "z", "radius")


@dataclass(frozen=True)
class Grains:
    """One rank's share of a pack.

    id : (n,) int64; of a text, numbered from 0 in the file's order
    position : (n, 3) float64, m
    radius : (n,) float64, m
    box : (6,) float64, m, x low, x high, ... of a dump; else None
    boundary : LAMMPS' letters for the box's faces of a dump, such as ("ff", "ff", "pp"), None where it has none
    """

    id: NDArray[np.int64]
    position: NDArray[np.float64]
    radius: NDArray[np.float64]
    box: NDArray[np.float64] | None = None
    boundary: tuple[str, ...] | None = None


def read_grains(comm: MPI.Comm, path: Path) -> Grains:
    """Read a pack; of a dump with several steps the last. Collective: the ranks' shares are in slabs of about equal numbers along the
    pack's longest side, and no rank holds more than its own."""
    size, start = size_and_start(comm, path)
    grains = _read_dump(comm, path, size, start) if start.startswith(b"ITEM:") else _read_text(comm, path, size)
    return _in_slabs(comm, grains)


def _read_text(comm: MPI.Comm, path: Path, size: int) -> Grains:
    rows = read_rows(comm, path, 0, size, Table((0, 1, 2, 3), 4, "four numbers on each line, x y z r, in m"))
    counts = comm.allgather(len(rows))
    if not any(counts):
        raise InputError(f"{path} holds no grains: expected x y z r on each line, in m")
    first = sum(counts[: comm.rank])
    return Grains(np.arange(first, first + len(rows)), rows[:, :3], rows[:, 3])


@dataclass(frozen=True)
class _Header:
    """Of one step of a dump; `body` is the byte after it."""

    count: int
    box: NDArray[np.float64]
    boundary: tuple[str, ...] | None
    columns: list[str]
    body: int


def _read_dump(comm: MPI.Comm, path: Path, size: int, start: bytes) -> Grains:
    steps = places_of(comm, path, size, b"ITEM: TIMESTEP")
    header, fault = None, None
    if comm.rank == 0:
        try:
            header = _header(path, steps[-1] if steps else 0)
        except InputError as error:  # which is a ValueError too
            fault = str(error)
        except (ValueError, IndexError) as error:
            fault = f"{path}: its last step begins wrongly ({error}); expected what dump custom writes"
    header, fault = comm.bcast((header, fault))
    if fault:
        raise InputError(fault)
    columns = tuple(header.columns.index(name) for name in _COLUMNS)
    rows = read_rows(comm, path, header.body, size, Table(columns, None, f"a dump's {' '.join(header.columns)}"))
    found = comm.allreduce(len(rows))
    if found != header.count:
        said = f"ends after {found} of {header.count} grains" if found < header.count else f"has {found} lines for {header.count} grains in its last step"
        raise InputError(f"{path} {said}; dump it anew")
    wrong = rows[:, 0][~(np.abs(rows[:, 0]) < 2.0**53) | (rows[:, 0] % 1 != 0)]
    for number in comm.allgather(float(wrong[0]) if len(wrong) else None):
        if number is not None:
            raise InputError(f"{path}: a grain has id {number:g}: expected whole numbers below 2^53")
    return Grains(rows[:, 0].astype(np.int64), rows[:, 1:4], rows[:, 4], header.box, header.boundary)


def _header(path: Path, at: int) -> _Header:
    count, box, boundary = None, None, None
    with open(path, "rb") as file:
        file.seek(at)
        while line := file.readline().decode("latin-1"):
            if "ITEM: NUMBER OF ATOMS" in line:
                count = int(file.readline())
            elif "ITEM: BOX BOUNDS" in line:
                letters = line.split()[3:]
                if "xy" in letters or "abc" in letters:
                    raise InputError(f"{path}: its box is tilted (BOX BOUNDS {' '.join(letters)}), which is not supported")
                boundary = tuple(letters) if len(letters) == 3 else None
                box = np.array([file.readline().split()[:2] for _ in range(3)], float).ravel()
            elif "ITEM: ATOMS" in line:
                columns = line.split()[2:]
                if missing := [name for name in _COLUMNS if name not in columns]:
                    raise InputError(f"{path} has no column {missing[0]}: expected a dump custom with {' '.join(_COLUMNS)}, has {' '.join(columns)}")
                if count is None or box is None:
                    raise InputError(f"{path}: its last step has no {'BOX BOUNDS' if box is None else 'NUMBER OF ATOMS'}; expected what dump custom writes")
                return _Header(count, box, boundary, columns, file.tell())
    raise InputError(f"{path} is a dump whose last step has no ITEM: ATOMS; dump it anew")


def _in_slabs(comm: MPI.Comm, grains: Grains) -> Grains:
    if comm.size == 1:
        return grains
    x = np.where(np.isfinite(grains.position), grains.position, 0.0)
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
    axis = int(np.argmax(high - low))
    # Slabs begin and end between layers of a thousandth of what a rank gets.
    layers = 1000 * comm.size
    extent = high[axis] - low[axis]
    layer = np.minimum((layers / extent * (x[:, axis] - low[axis])).astype(int), layers - 1) if extent > 0.0 else np.zeros(len(x), int)
    filled = np.bincount(layer, minlength=layers)
    comm.Allreduce(MPI.IN_PLACE, filled)
    middle = np.cumsum(filled) - filled / 2
    to = np.minimum(comm.size * middle / filled.sum(), comm.size - 1).astype(int)[layer]
    parts = comm.alltoall([(grains.id[k], grains.position[k], grains.radius[k]) for k in (np.flatnonzero(to == rank) for rank in range(comm.size))])
    id, position, radius = (np.concatenate(columns) for columns in zip(*parts))
    return Grains(id, position, radius, grains.box, grains.boundary)
