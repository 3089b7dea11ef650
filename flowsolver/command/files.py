"""What the command `poreflow` writes: report, history, forces, pressures. Rank 0 writes; a failure is told on all ranks."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

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


def write(comm: MPI.Comm, path: Path, writer: Callable[[Path], Any], *columns: NDArray) -> None:
    """Have rank 0 write a file; `writer` gets the path and the ranks' parts of each column, put together. Collective."""
    whole = [np.concatenate(parts) if (parts := comm.gather(column)) else None for column in columns]
    fault = ""
    if comm.rank == 0:
        try:
            writer(path, *whole)
        except (OSError, ValueError) as error:
            fault = f"cannot write {path}: {getattr(error, 'strerror', None) or error}"
    if fault := comm.bcast(fault):
        raise InputError(fault)


def report_as_json(report: dict[str, Any]) -> Callable[[Path], Any]:
    return lambda path: path.write_text(json.dumps(report, indent=1) + "\n")


def forces_as_npz(wall_force: NDArray[np.float64]) -> Callable[..., None]:
    def save(path: Path, id: NDArray[np.int64], force: NDArray[np.float64]) -> None:
        order = np.argsort(id)
        # A file object, because numpy adds an ending of its own to a name without one.
        with open(path, "wb") as file:
            np.savez(file, id=id[order], force=force[order], wall_force=wall_force)

    return save


def pressure_as_vtu(path: Path, centre: NDArray[np.float64], pressure: NDArray[np.float64]) -> None:
    """One vertex in each pore's centre."""
    import meshio

    cells = [("vertex", np.arange(len(centre))[:, None])]
    meshio.Mesh(centre, cells, point_data={"pressure": pressure}).write(path, file_format="vtu")


def history_as_csv(rows: list[dict[str, float]]) -> Callable[[Path], Any]:
    def save(path: Path) -> None:
        with open(path, "w", newline="") as file:
            table = csv.DictWriter(file, fieldnames=list(rows[-1]), restval="nan")
            table.writeheader()
            table.writerows(rows)

    return save
