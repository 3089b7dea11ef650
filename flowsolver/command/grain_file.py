"""Grains from a file: text with x y z r on each line, or a dump of LIGGGHTS or LAMMPS. Each rank reads its share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver.command.lines_of_file import Table, places_of, read_rows, size_and_start
from flowsolver.network import InputError

# What dump custom calls places, as they are, unwrapped, or scaled by the box, and sizes, with their shares of a diameter.
_PLACES = (("x", "y", "z"), ("xu", "yu", "zu"), ("xs", "ys", "zs"), ("xsu", "ysu", "zsu"))
_SIZES = {"radius": 1.0, "diameter": 0.5}


@dataclass(frozen=True)
class Grains:
    """One rank's share of a pack.

    id : (n,) int64; of a text, or a dump without ids, numbered from 0 in the file's order
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
    dump = start.startswith(b"ITEM:") or b"\nITEM: TIMESTEP" in start
    grains = _read_dump(comm, path, size, start) if dump else _read_text(comm, path, size)
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
    """Of one step of a dump; `used` are the columns that are read, of an id where there is one, the place, the size; `body` is the byte after it."""

    count: int
    box: NDArray[np.float64]
    boundary: tuple[str, ...] | None
    columns: list[str]
    used: list[str]
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
    if header.count == 0:
        raise InputError(f"there are no grains in the last step of {path}: a pore network needs at least one")
    columns = tuple(header.columns.index(name) for name in header.used)
    rows = read_rows(comm, path, header.body, size, Table(columns, None, f"a dump's {' '.join(header.columns)}"))
    found = comm.allreduce(len(rows))
    if found != header.count:
        said = f"ends after {found} of {header.count} grains" if found < header.count else f"has {found} lines for {header.count} grains in its last step"
        raise InputError(f"{path} {said}; dump it anew")
    first, (*place, size_name) = int("id" in header.used), header.used[-4:]
    position, radius = rows[:, first : first + 3], _SIZES[size_name] * rows[:, -1]
    if place[0].startswith("xs"):
        position = header.box[::2] + position * (header.box[1::2] - header.box[::2])
    if not first:
        before = sum(comm.allgather(len(rows))[: comm.rank])
        return Grains(np.arange(before, before + len(rows)), position, radius, header.box, header.boundary)
    wrong = rows[:, 0][~(np.abs(rows[:, 0]) < 2.0**53) | (rows[:, 0] % 1 != 0)]
    for number in comm.allgather(float(wrong[0]) if len(wrong) else None):
        if number is not None:
            raise InputError(f"{path}: a grain has id {number:g}: expected whole numbers below 2^53")
    return Grains(rows[:, 0].astype(np.int64), position, radius, header.box, header.boundary)


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
                place = next((names for names in _PLACES if set(names) <= set(columns)), None)
                size = next((name for name in _SIZES if name in columns), None)
                if missing := "x y z" if place is None else "radius" if size is None else "":
                    kinds = f"{', '.join(' '.join(names) for names in _PLACES)}, and {' or '.join(_SIZES)}"
                    raise InputError(f"{path} has no column {missing}: expected a dump custom with {kinds}; it has {' '.join(columns)}")
                if count is None or box is None:
                    raise InputError(f"{path}: its last step has no {'BOX BOUNDS' if box is None else 'NUMBER OF ATOMS'}; expected what dump custom writes")
                used = [*(["id"] if "id" in columns else []), *place, size]
                return _Header(count, box, boundary, columns, used, file.tell())
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
