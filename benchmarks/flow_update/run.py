"""flow_update: time from grain positions to pressure forces, by size and number of ranks. Prints a table.

    python benchmarks/flow_update/run.py                    # 8e3 and 1e5 grains on 1 and 2 ranks
    python benchmarks/flow_update/run.py --sizes 1000000 --ranks 1

Each row is one update, everything in it: mesh, conductances, solve at rtol 1e-8, forces. "fresh" reuses nothing; "same again"
keeps mesh, preconditioner and start; "moved" moves every grain by 1e-4 of a diameter.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TILES = {8_000: (2, 2, 2), 100_000: (5, 5, 4), 1_000_000: (10, 10, 10)}
MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]
PARTS = ("tessellate", "geometry", "carry", "assemble", "setup", "solve", "forces", "total", "cpu")


def measure(grains: int, ranks: int) -> dict:
    command = [*MPIRUN, "-n", str(ranks), sys.executable, str(HERE / "measure.py"), "--tiles", *map(str, TILES[grains])]
    environment = os.environ | {"PYTHONPATH": str(HERE.parents[1]), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[8_000, 100_000], choices=sorted(TILES))
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    print(f"{'grains':>8} {'ranks':>5} {'update':>15} {'mesh':>9} {'iter':>4}" + "".join(f"{part:>11}" for part in PARTS) + "   B/grain")
    for grains in arguments.sizes:
        for ranks in arguments.ranks:
            result = measure(grains, ranks)
            for row in result["rows"]:
                seconds = "".join(f"{row['seconds'][part]:11.3f}" for part in PARTS)
                memory = f"{result['bytes_per_grain']:10.0f}" if row["case"] == "fresh" else ""
                print(f"{result['grains']:>8} {ranks:>5} {row['case']:>15} {row['mesh']:>9} {row['iterations']:>4}{seconds}{memory}", flush=True)


if __name__ == "__main__":
    main()
