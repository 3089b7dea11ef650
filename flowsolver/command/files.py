"""What the command `poreflow` writes: report, history, forces, pressures. Rank 0 writes; a failure is told on all ranks."""

from __future__ import annotations

import csv
import json
import tempfile
import zipfile
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver.command.sorted_over_ranks import sorted_over_ranks
from flowsolver.network import InputError


def check_places(comm: MPI.Comm, pack: Path, outputs: dict[str, Path | None]) -> None:
    """Before anything is computed: whether the files of these options can be written, and overwrite neither the pack nor each other. Collective."""
    fault, seen = "", {}
    if comm.rank == 0:
        for option, path in outputs.items():
            if path is None:
                continue
            try:
                where = path.resolve()
                if where.is_dir() or not where.parent.is_dir():
                    fault = f"{option} {path}: {'it is a directory' if where.is_dir() else f'there is no directory {path.parent}'}; give a file in one that exists"
                elif where == pack.resolve():
                    fault = f"{option} {path} would overwrite the pack"
                elif where in seen:
                    fault = f"{option} {path} would overwrite what {seen[where]} writes"
                seen[where] = option
            except (OSError, RuntimeError) as error:
                fault = f"{option} {path}: {error}"
            if fault:
                break
    if fault := comm.bcast(fault):
        raise InputError(fault)


class Column:
    """On rank 0: the ranks' parts of an array, one after another as they are asked for, in the ranks' order."""

    def __init__(self, comm: MPI.Comm, own: NDArray, lengths: list[int]) -> None:
        self.shape, self.dtype = (sum(lengths), *own.shape[1:]), own.dtype
        self._comm, self._own, self._lengths, self._next = comm, own, lengths, 0

    def __iter__(self) -> Iterator[NDArray]:
        while self._next < self._comm.size:
            rank, self._next = self._next, self._next + 1
            part = self._own
            if rank > 0:
                part = np.empty((self._lengths[rank], *self.shape[1:]), self.dtype)
                self._comm.Recv(part, rank)
            yield part


def write(comm: MPI.Comm, path: Path, writer: Callable[..., Any], *columns: NDArray) -> None:
    """Have rank 0 write a file; `writer` gets the path and a `Column` for each array, to be read in this order. No rank holds more than
    its own parts and one of another rank's. Collective."""
    columns = [np.ascontiguousarray(column) for column in columns]
    lengths = [comm.allgather(len(column)) for column in columns]
    fault = ""
    if comm.rank == 0:
        parts = [Column(comm, *each) for each in zip(columns, lengths)]
        try:
            writer(path, *parts)
        except (OSError, ValueError) as error:
            fault = _fault(path, error)
        # After a fault the other ranks still have theirs to send.
        for column in parts:
            deque(column, maxlen=0)
    else:
        for column in columns:
            comm.Send(column, 0)
    _agree(comm, fault)


def _agree(comm: MPI.Comm, fault: str) -> None:
    for text in comm.allgather(fault):
        if text:
            raise InputError(text)


def _fault(path: Path, error: Exception) -> str:
    return f"cannot write {path}: {getattr(error, 'strerror', None) or error}"


def report_as_json(report: dict[str, Any]) -> Callable[[Path], Any]:
    return lambda path: path.write_text(json.dumps(report, indent=1) + "\n")


def write_forces(comm: MPI.Comm, path: Path, id: NDArray[np.int64], force: NDArray[np.float64], wall_force: NDArray[np.float64]) -> None:
    """npz with all ranks' id (n,) and force (n, 3), in the order of the ids, and wall_force (6,), the same on all ranks. Collective."""

    def save(path: Path, *columns: Column) -> None:
        # numpy's own writer wants whole arrays.
        with zipfile.ZipFile(path, "w") as archive:
            for name, column in zip(("id", "force"), columns):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    header = {"descr": np.lib.format.dtype_to_descr(column.dtype), "fortran_order": False, "shape": column.shape}
                    np.lib.format.write_array_header_1_0(file, header)
                    for part in column:
                        file.write(part)
            with archive.open("wall_force.npy", "w") as file:
                np.lib.format.write_array(file, wall_force)

    write(comm, path, save, *sorted_over_ranks(comm, id, force))


def write_pressures(comm: MPI.Comm, path: Path, centre: NDArray[np.float64], pressure: NDArray[np.float64]) -> None:
    """vtu with a vertex in each pore's centre, (m, 3) m, and its pressure, (m,) Pa; one piece for each rank that has pores. Collective."""
    picture, fault = b"", ""
    try:
        picture = _as_vtu(centre, pressure)
    except OSError as error:
        fault = _fault(path, error)
    _agree(comm, fault)
    begins, ends = picture.index(b"<Piece"), picture.rindex(b"</UnstructuredGrid>")

    def save(path: Path, pieces: Column) -> None:
        with open(path, "wb") as file:
            file.write(picture[:begins])
            for piece in pieces:
                file.write(piece)
            file.write(picture[ends:])

    write(comm, path, save, np.frombuffer(picture[begins:ends] if len(centre) else b"", np.uint8))


def _as_vtu(centre: NDArray[np.float64], pressure: NDArray[np.float64]) -> bytes:
    import meshio

    cells = [("vertex", np.arange(len(centre))[:, None])]
    with tempfile.NamedTemporaryFile() as file:  # meshio writes vtu by name only
        meshio.Mesh(centre, cells, point_data={"pressure": pressure}).write(file.name, file_format="vtu")
        return file.read()


def history_as_csv(rows: list[dict[str, float]]) -> Callable[[Path], Any]:
    def save(path: Path) -> None:
        with open(path, "w", newline="") as file:
            table = csv.DictWriter(file, fieldnames=list(rows[-1]), restval="nan")
            table.writeheader()
            table.writerows(rows)

    return save
