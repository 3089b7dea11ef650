"""flow_update: from grain positions to pressure forces, by size and number of ranks, and YADE beside it. Prints a table.

    python benchmarks/flow_update/run.py                    # 8e3 and 1e5 grains on 1 and 2 ranks, and YADE where it is installed
    python benchmarks/flow_update/run.py --sizes 1000000 --ranks 1 --no-yade

Each row is one update, everything in it: mesh, conductances, solve at rtol 1e-8, forces. "fresh" reuses nothing; "same again" keeps
mesh, preconditioner and start; "moved" moves every grain by 1e-4 of a diameter. Seconds are CPU seconds of the slowest rank but for
"wall" and the last three columns (parts of "flow"), which are wall time. YADE's rows are its own script's, on the same pack
(yade_flow.py): "kept" has the factor at hand; "coupled" is DEM and flow together, meshed anew every 200 steps.

How many times as fast several ranks are as one stands below the table, wall time, beside the most that the machine leaves room for: as many
times as there are ranks, by the wall time of one alone over that of as many runs of one rank at once, each with a whole pack to itself
(measure.py --apart). All of them are run in turn, --repeats times, and each row is that of the repeat in which it took least.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SIZES = (8_000, 100_000, 1_000_000)
MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]
PARTS = ("tessellate", "geometry", "carry", "flow", "forces", "cpu", "wall", "assemble", "setup", "solve")
COUPLED_STEPS = 400
YADE_MOST = 100_000
"""Above this YADE's corrupts its heap."""


def measure(grains: int, ranks: int, apart: bool = False) -> dict:
    command = [*MPIRUN, "-n", str(ranks), sys.executable, str(HERE / "measure.py"), "--grains", str(grains), *["--apart"] * apart]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(HERE.parents[1])}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def best(before: dict, result: dict) -> dict:
    """Of two measurements of the same, each row of the one in which it took less, and each kernel's greater rate."""
    rows = [min(pair, key=lambda row: row["seconds"]["wall"]) for pair in zip(before["rows"], result["rows"], strict=True)]
    return result | {"rows": rows, "rates": {kernel: max(rate, before["rates"][kernel]) for kernel, rate in result["rates"].items()}}


def measure_in_turn(grains: int, ranks: list[int], repeats: int) -> tuple[dict[int, dict], dict[int, dict]]:
    """By number of ranks: what they do together, and, beside one rank, what as many do at once, each by itself."""
    together: dict[int, dict] = {}
    apart: dict[int, dict] = {}
    for _ in range(repeats):
        for number in ranks:
            result = measure(grains, number)
            together[number] = best(together.get(number, result), result)
            if number > 1 and 1 in ranks:
                result = measure(grains, number, apart=True)
                apart[number] = best(apart.get(number, result), result)
    return together, apart


def speeds(one: list[dict], several: list[dict], factor: int = 1) -> str:
    """How many times as fast, by update."""
    return ", ".join(f"{a['update'].split()[0]} {factor * a['seconds']['wall'] / b['seconds']['wall']:.2f}" for a, b in zip(one, several, strict=True))


def yade(grains: int, steps: int) -> dict:
    with tempfile.TemporaryDirectory() as directory:
        pack = Path(directory) / "pack.txt"
        subprocess.run([sys.executable, str(HERE / "pack.py"), str(grains), str(pack)], check=True)
        command = ["yade", "-j1", "-n", "-x", str(HERE / "yade_flow.py"), str(pack), str(steps)]
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=directory)
    for line in done.stdout.splitlines():
        if line.startswith("RESULT "):
            return json.loads(line[7:])
    sys.exit(f"yade ended with status {done.returncode} and no result:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[8_000, 100_000], choices=SIZES)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-yade", dest="yade", action="store_false", help="leave YADE out, although it is installed")
    arguments = parser.parse_args()
    print(f"{'grains':>8} {'ranks':>5} {'update':>13} {'mesh':>8} {'iter':>4}" + "".join(f"{part:>11}" for part in PARTS) + f"{'grains/s':>10}{'B/grain':>8}")
    for grains in arguments.sizes:
        fresh, notes = 0.0, []
        together, apart = measure_in_turn(grains, arguments.ranks, arguments.repeats)
        for ranks, result in together.items():
            for row in result["rows"]:
                seconds = "".join(f"{row['seconds'][part]:11.3f}" for part in PARTS)
                memory = f"{result['bytes_per_grain']:8.0f}" if row["update"] == "fresh" else ""
                speed = f"{grains / row['seconds']['wall']:10.3g}"
                print(f"{grains:>8} {ranks:>5} {row['update']:>13} {row['mesh']:>8} {row['iterations']:>4}{seconds}{speed}{memory}", flush=True)
            if ranks == 1:
                fresh = result["rows"][0]["seconds"]["cpu"]
            rates = ", ".join(f"{name} {rate / 1e6:.0f} M/s" for name, rate in result["rates"].items())
            notes.append(f"{ranks} rank(s): peak {result['peak'] / 2**30:.2f} GiB; each rank's kernels: {rates}")
        for ranks in apart:
            one = together[1]["rows"]
            notes.append(f"{ranks} ranks over one: {speeds(one, together[ranks]['rows'])}")
            notes.append(f"{ranks} ranks over one, the most of this machine: {speeds(one, apart[ranks]['rows'], ranks)}")
        if arguments.yade and grains <= YADE_MOST and shutil.which("yade"):
            peer = yade(grains, COUPLED_STEPS if grains <= 10_000 else 0)
            print(f"{grains:>8} {'YADE':>5} {'fresh':>13} {'':>13}{'':55}{peer['fresh']:11.3f}{'':44}{grains / peer['fresh']:10.3g}{peer['bytes_per_grain']:8.0f}")
            print(f"{grains:>8} {'YADE':>5} {'kept':>13} {'':>13}{'':55}{peer['kept']:11.3f}{'':44}{grains / peer['kept']:10.3g}")
            if peer["grain_steps_per_second"]:
                notes.append(f"YADE coupled: {peer['grain_steps_per_second']:.3g} grain-steps a CPU second")
            if fresh:
                notes.append(f"YADE fresh / poreslip fresh, CPU seconds on one core: {peer['fresh'] / fresh:.1f}")
        for note in notes:
            print(f"{grains:>8} {note}", flush=True)


if __name__ == "__main__":
    main()
