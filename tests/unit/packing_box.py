"""Make one pack and print what was reached as JSON: `packing_box.py CASE_FILE DIRECTORY [section.key=value ...]`."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from coupling.case.files import load_case
from coupling.case.schema import DECKS
from coupling.engine.liggghts import LiggghtsEngine
from coupling.stages.pack import write_grains
from coupling.stages.packing import Packing


def main(case_file: str, directory: Path, *overrides: str) -> None:
    comm = MPI.COMM_WORLD
    case = load_case(case_file, overrides).runs[0]
    count = comm.bcast(write_grains(case.pack, directory / "grains.data", case.periodic_z) if comm.rank == 0 else None)
    engine = LiggghtsEngine(comm, directory / "log.liggghts")
    made = Packing(case, engine, comm, DECKS / "in.pack").make(directory / "grains.data", count)
    parts = comm.gather((engine.atom("id").copy(), engine.atom("x").copy(), engine.atom("radius").copy(), engine.atom("rmass").copy()))
    if comm.rank == 0:
        ids, position, radius, mass = (np.concatenate(part) for part in zip(*parts))
        order = np.argsort(ids)
        made["grains_started"] = count
        made["state"] = hashlib.sha256(position[order].tobytes() + radius[order].tobytes()).hexdigest()
        made["radii"] = sorted(radius)
        made["densities"] = [float((mass / radius**3).min() / (4 / 3 * np.pi)), float((mass / radius**3).max() / (4 / 3 * np.pi))]
        print(json.dumps(made))
    engine.close()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *sys.argv[3:])
