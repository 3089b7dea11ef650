"""Writes the loading deck of a case's run, with its values, as a deck for the stock `liggghts -in`.

    python stock_deck.py CASE.toml RUN DECK.in STEPS [--set KEY=VALUE ...]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from coupling.case.files import load_case, select_runs
from coupling.engine.liggghts import LiggghtsEngine
from coupling.stages import prepared
from coupling.stages.deck_variables import fault_geometry, load_variables


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case")
    parser.add_argument("run")
    parser.add_argument("deck", type=Path)
    parser.add_argument("steps", type=int)
    parser.add_argument("--set", action="append", default=[])
    arguments = parser.parse_args()
    (case,) = select_runs(load_case(arguments.case, arguments.set), [arguments.run]).runs
    comm = MPI.COMM_WORLD
    stage = prepared.prepare(case, comm, LiggghtsEngine, lambda line: None)
    fault = fault_geometry(case, stage.manifest["geometry"], case.pack.box_m[2])
    lines = [f"variable {name} index {value}" for name, value in load_variables(case, stage.restart, fault).items()]
    arguments.deck.write_text("\n".join([*lines, f"include {prepared.load_deck(case)}", f"run {arguments.steps}", ""]))


if __name__ == "__main__":
    main()
