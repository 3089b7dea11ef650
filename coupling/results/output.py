"""Everything that a run writes into its directory goes through here."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coupling.errors import InputError, of_file
from coupling.results import checkpoint

BOND_COLUMNS = ("step", "strain", "id_i", "id_j", "mode", "x_m", "y_m", "z_m", "force_normal_N", "force_shear_N", "energy_J")
BREAK_MODES = {1: "tension", 2: "shear"}


def write_atomically(path: Path, text: str) -> None:
    """Replace a file in one step, so that it is never seen half written, not after a kill either."""
    partial = path.with_name(path.name + ".partial")
    with of_file(path), open(partial, "w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(partial, path)


class RunOutput:
    """The files of one run. Only rank 0 writes; calls are made on all ranks.

    columns: those of history.csv. bonded: whether there are bonds to break, and so a table of them.
    resume: byte lengths of the tables at the checkpoint that the run continues from; lines past them are cut off.
    """

    def __init__(self, directory: Path, comm, columns: tuple[str, ...], bonded: bool, resume: dict[str, int] | None = None):
        self.directory, self._columns = directory, columns
        self._writes = comm.rank == 0
        self._tables: dict[str, io.TextIOWrapper] = {}
        if not self._writes:
            return
        directory.mkdir(parents=True, exist_ok=True)
        checkpoint.remove_partial(directory)
        if resume is None:
            self._remove_former_run()
        for name, length in (resume or {}).items():
            path = directory / name
            if not path.is_file() or path.stat().st_size < length:
                raise InputError(
                    f"{path} is shorter than when the checkpoint was written ({length} bytes); put the file back, or run the case from its start")
        for name, columns in (("history.csv", columns), *([("bonds.csv", BOND_COLUMNS)] if bonded else [])):
            path = directory / name
            if resume is not None:
                os.truncate(path, resume[name])
            file = open(path, "a" if resume is not None else "w", newline="")
            self._tables[name] = file
            if resume is None:
                self._append(name, [columns])

    def _remove_former_run(self) -> None:
        """Remove what an earlier run into the same directory wrote and this one may not write over."""
        for former in checkpoint.all_in(self.directory):
            shutil.rmtree(former)
        for pattern in ("bonds.csv", "report.json", "report.md", "log-from-*.liggghts", "snapshots/grains_*.vtu", "snapshots/contacts_*.vtu", "snapshots/index.csv"):
            for former in self.directory.glob(pattern):
                former.unlink()
        if (self.directory / "snapshots").is_dir() and not any((self.directory / "snapshots").iterdir()):
            (self.directory / "snapshots").rmdir()

    def history(self, row: dict[str, float]) -> None:
        """Append a line to history.csv."""
        if self._writes:
            self._append("history.csv", [[_number(row[name]) for name in self._columns]])

    def breaks(self, rows: np.ndarray, strain: float) -> None:
        """Append broken bonds, (n, 10) float64: step, id_i, id_j, mode, x, y, z, F_n, F_s, energy."""
        if self._writes and len(rows):
            self._append("bonds.csv", [[int(r[0]), _number(strain), int(r[1]), int(r[2]), BREAK_MODES[int(r[3])], *(_number(v) for v in r[4:])] for r in rows])

    def json(self, name: str, content: dict) -> None:
        """Write one JSON file."""
        if self._writes:
            write_atomically(self.directory / name, json.dumps(content, indent=2) + "\n")

    def text(self, name: str, content: str) -> None:
        """Write one text file."""
        if self._writes:
            write_atomically(self.directory / name, content)

    def lengths(self) -> dict[str, int]:
        """Byte lengths of the tables, all of it on disk; empty on ranks that do not write."""
        for file in self._tables.values():
            file.flush()
            os.fsync(file.fileno())
        return {name: os.fstat(file.fileno()).st_size for name, file in self._tables.items()}

    def close(self) -> None:
        for file in self._tables.values():
            file.close()

    def _append(self, name: str, rows: Sequence[Sequence]) -> None:
        file = self._tables[name]
        with of_file(self.directory / name):
            csv.writer(file, lineterminator="\n").writerows(rows)
            file.flush()


def _number(value: float) -> str | int:
    return int(value) if isinstance(value, (int, np.integer)) else f"{value:.10g}"
