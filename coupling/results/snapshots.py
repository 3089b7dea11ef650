"""Snapshots for ParaView and for the figures: grains and contacts as .vtu files. Imported only by a run that asks for them."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import meshio
import numpy as np

from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.errors import of_file


class Snapshots:
    """Writes `snapshots/grains_<step>.vtu`, `snapshots/contacts_<step>.vtu` and their index.

    steps: steps after the start of loading at which one is written.
    """

    def __init__(self, directory: Path, comm, steps: set[int], resume_step: int | None = None):
        self._directory = directory / "snapshots"
        self._comm = comm
        self.steps = steps
        if comm.rank == 0:
            self._directory.mkdir(parents=True, exist_ok=True)
            rows = []
            if resume_step is not None and self._index.is_file():
                with open(self._index, newline="") as file:
                    listed = list(csv.DictReader(file))
                rows = [row for row in listed if int(row["step"]) <= resume_step]
                for row in listed[len(rows) :]:
                    for kind in ("grains", "contacts"):
                        (self._directory / row[kind]).unlink(missing_ok=True)
            self._rows = rows

    @property
    def _index(self) -> Path:
        return self._directory / "index.csv"

    def write(self, engine: Engine, strain: float, pressure: tuple[np.ndarray, np.ndarray]) -> None:
        """Write the grains and contacts of all ranks as they are now; collective.

        pressure: ids (n,) of this rank's grains when the fluid was last asked, and the pressure around each (n,), Pa; none without a fluid.
        """
        position = engine.atom("x").copy()
        grains = {
            "id": engine.atom("id").astype(np.int64),
            "type": engine.atom("type").copy(),
            "radius": engine.atom("radius").copy(),
            "displacement": engine.unwrapped_position() - engine.property_atom("reference_position"),
            "velocity": engine.atom("v").copy(),
            "pressure_force": engine.property_atom("pore_force").copy() if engine.has_property_atom("pore_force") else np.zeros_like(position),
        }
        contacts = engine.contacts()
        parts = self._comm.gather((position, grains, contacts, pressure), root=0)
        with raised_together(self._comm):
            if parts is not None:
                self._write(engine.step, strain, parts)

    def _write(self, step: int, strain: float, parts: list) -> None:
        """Write what all ranks hold; on rank 0."""
        position = np.concatenate([part[0] for part in parts])
        grains = {name: np.concatenate([part[1][name] for part in parts]) for name in parts[0][1]}
        order = np.argsort(grains["id"])
        position, grains = position[order], {name: values[order] for name, values in grains.items()}
        pressure_id, pressure = (np.concatenate([part[3][column] for part in parts]) for column in (0, 1))
        if len(pressure):
            grains["pressure"] = pressure[np.argsort(pressure_id)]

        def joined(name: str) -> np.ndarray:
            return np.concatenate([getattr(part[2], name) for part in parts])

        ends = np.searchsorted(grains["id"], joined("id"))
        grains["coordination"] = np.bincount(ends.ravel(), minlength=len(position)).astype(np.int32)
        names = f"grains_{step}.vtu", f"contacts_{step}.vtu"
        self._save(names[0], position, [("vertex", np.arange(len(position))[:, None])], point_data=grains)
        start, point = position[ends[:, 0]], joined("point")
        # Both ends on the contact's own side of a periodic boundary.
        end = start + 2.0 * (point - start)
        kinds = joined("type")
        lines = np.arange(2 * len(ends)).reshape(-1, 2)
        self._save(
            names[1], np.stack([start, end], axis=1).reshape(-1, 3), [("line", lines)],
            cell_data={
                "force_normal_N": [joined("normal_force")], "force_shear_N": [np.linalg.norm(joined("shear_force"), axis=1)],
                "bonded": [joined("bonded").astype(np.int8)], "type_i": [kinds[:, 0].copy()], "type_j": [kinds[:, 1].copy()],
            })  # fmt: skip
        self._rows.append({"step": step, "strain": f"{strain:.10g}", "grains": names[0], "contacts": names[1]})
        self._save_index()

    def _save(self, name: str, points: np.ndarray, cells, **data) -> None:
        partial = self._directory / f"partial_{name}"
        with of_file(self._directory / name):
            meshio.Mesh(points, cells, **data).write(partial)
        os.replace(partial, self._directory / name)

    def _save_index(self) -> None:
        partial = self._index.with_suffix(".partial")
        with of_file(self._index), open(partial, "w", newline="") as file:
            table = csv.DictWriter(file, ["step", "strain", "grains", "contacts"], lineterminator="\n")
            table.writeheader()
            table.writerows(self._rows)
        os.replace(partial, self._index)
