"""consolidation: two-way consolidation of a saturated pack, error against CPU time by split and steps between two solves. Prints a table.

    .venv/bin/python benchmarks/consolidation/run.py                     # 8000 grains, some minutes
    .venv/bin/python benchmarks/consolidation/run.py --side 0.02         # 1200 grains
    .venv/bin/python benchmarks/consolidation/run.py --rows undrained:10 predicted:100

The load on top of a pack is raised and drains through the top (cases/consolidation). Errors are of the settlement, as a share of what
drainage settles after the load's rise: rms against Terzaghi's solution, with stiffness and permeability measured on the same pack, and rms
against the first of the intervals. Figures are CPU seconds of the loading: engine (with the fluid's answer to each step), mesh, solves. The
peer is YADE's FlowEngine with a solve in every step: where yade is installed its rate is measured in the same run, by ../flow_update/yade_flow.py on as
many grains; else it is the 0.21 million grain-steps a second of 8000 grains on this class of machine.

Measured on one core of an AMD EPYC (2026-11-23, at 7333126, `--rows predicted:100 predicted:600:0.16`), 8106 grains, 5652 steps, nothing else of ours
at work; figures move by a tenth from run to run, those over dry with the dry run's. YADE made 0.213 million grain-steps a CPU second in the same run.

                     to Terzaghi  to first  engine  forces    mesh   solve   total  over dry  M grain-steps/s  over peer
                dry                            9.8     0.0     0.0     0.0     9.8      1.00             4.66       21.9
      predicted 100       0.0078    0.0000    10.6     2.4     0.3     1.6    14.9      1.52             3.08       14.5
 predicted 600 0.16       0.0118    0.0147     9.2     1.7     0.1     0.7    11.7      1.19             3.90       18.3

Even intervals, before the answer to a step was a product with one matrix (`--rows predicted:10 predicted:50 predicted:100 predicted:150 predicted:200`, YADE
0.228):

                 to Terzaghi  to first  engine  forces    mesh   solve   total  over dry  M grain-steps/s  over peer
            dry                           10.9     0.0     0.0     0.0    10.9      1.00             4.22       18.5
   predicted 10       0.0049    0.0000    10.7    10.0     4.5    12.6    37.8      3.48             1.21        5.3
   predicted 50       0.0057    0.0016    11.1     4.6     1.0     3.7    20.3      1.87             2.25        9.9
  predicted 100       0.0078    0.0040    10.1     3.4     0.5     2.0    16.0      1.47             2.87       12.6
  predicted 150       0.0178    0.0278    10.0     3.1     0.4     1.5    15.0      1.38             3.06       13.4
  predicted 200       0.0176    0.0175     9.2     2.4     0.3     1.1    13.0      1.19             3.53       15.5
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

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from postproc.observables import ResultFiles, consolidation  # noqa: E402
from postproc.references import terzaghi  # noqa: E402

#: Million grain-steps a second of the peer, coupled, 8000 grains, where it cannot be measured.
PEER = 0.21
FLOW_UPDATE, PEER_GRAINS, PEER_STEPS = ROOT / "benchmarks" / "flow_update", 8000, 400
SIDE = 0.038
VISCOSITY, TIME_FRACTION = 5.0, 0.35
ROWS = ("predicted:10", "undrained:10", "undrained:50", "predicted:50", "predicted:100", "predicted:200", "predicted:600:0.16")


def run(case: str, name: str, out: Path, settings: dict[str, object]) -> Path:
    """Carry out one run of a case file; the directory of its results."""
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "coupling", "run", str(ROOT / "cases" / case / f"{case}.toml"), "--only", name, "--out", str(out), *given]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return out / case / name


def peer() -> float:
    """Million grain-steps a CPU second of YADE, DEM and flow together, meshed anew every 200 steps."""
    if not shutil.which("yade"):
        return PEER
    with tempfile.TemporaryDirectory() as directory:
        pack = Path(directory) / "pack.txt"
        subprocess.run([sys.executable, str(FLOW_UPDATE / "pack.py"), str(PEER_GRAINS), str(pack)], check=True)
        done = subprocess.run(["yade", "-j1", "-n", "-x", str(FLOW_UPDATE / "yade_flow.py"), str(pack), str(PEER_STEPS)],
                              env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}, capture_output=True, text=True, cwd=directory)  # fmt: skip
    for line in done.stdout.splitlines():
        if line.startswith("RESULT "):
            return json.loads(line[7:])["grain_steps_per_second"] / 1e6
    sys.exit(f"yade ended with status {done.returncode} and no result:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


#: What is counted: columns, and the phases of a report that each sums up.
COLUMNS = {"engine": ("engine",), "forces": ("forces", "exchange"), "mesh": ("tessellation", "geometry"), "solve": ("assembly", "solve", "flow")}


def cost(directory: Path) -> tuple[list[float], int, int]:
    """CPU seconds of the loading by COLUMNS; grains, and steps."""
    report = json.loads((directory / "report.json").read_text())
    spent = report["cpu_s_by_phase_and_rank"][0]
    return [sum(spent[name]["cpu_s"] for name in names if name in spent) for names in COLUMNS.values()], report["grains"], report["last"]["step"]


def split_and_interval(text: str) -> tuple[str, int, float]:
    split, _, interval = text.partition(":")
    interval, _, allowed = interval.partition(":")
    return split, int(interval), float(allowed or 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=float, default=SIDE, help="of the box, m")
    parser.add_argument("--rows", type=split_and_interval, nargs="+", default=[split_and_interval(row) for row in ROWS], metavar="SPLIT:INTERVAL[:TOLERANCE]")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "benchmark-consolidation")
    a = parser.parse_args()
    scale = a.side / SIDE
    # Drainage takes as many times longer than a wave, whatever the size.
    common = {"pack.box_m": [a.side] * 3, "loading.time_step_fraction": TIME_FRACTION, "fluid.viscosity_Pa_s": VISCOSITY / scale}
    load = common | {"sample.ramp_time_s": 3e-5 * scale, "sample.loading_time_s": 4e-4 * scale}
    dry = run("consolidation", "dry", a.out, load)
    darcy = run("darcy", "run", a.out, {"pack.box_m": [a.side] * 3, "sample.loading_time_s": 1e-5 * scale**2})
    alone, grains, steps = cost(dry)
    yade = peer()
    print(f"{grains} grains, {steps} steps; CPU seconds; the peer makes {yade:.3f} M grain-steps/s\n")
    print(f"{'':>19} {'to Terzaghi':>12} {'to first':>9}" + "".join(f"{name:>8}" for name in COLUMNS) + f"{'total':>8} {'over dry':>9} {'M grain-steps/s':>16} {'over peer':>10}")

    def line(name: str, errors: str, spent: list[float]) -> None:
        total = sum(spent)
        rate = grains * steps / total / 1e6
        print(f"{name:>19} {errors:>22}" + "".join(f"{s:8.1f}" for s in spent) + f"{total:8.1f} {total / sum(alone):9.2f} {rate:16.2f} {rate / yade:10.1f}", flush=True)

    line("dry", "", alone)
    first = None
    for split, interval, tolerance in a.rows:
        lines = {"output.history_interval_steps": interval * max(1, 200 // interval)}
        # What a solve leaves undone adds up over short intervals.
        solver = {"flow.solver_tolerance": 1e-3 if interval >= 50 else 1e-5}
        intervals = solver | {"flow.split": split, "flow.interval_steps": interval, "flow.interval_tolerance": tolerance}
        wet = run("consolidation", "two_way", a.out / f"{split}-{interval}-{tolerance}", load | lines | intervals)
        files = ResultFiles(wet, {"dry": dry, "darcy": darcy})
        settled = consolidation(files)
        first = first or settled
        against = (terzaghi(files, settled), np.interp(settled.abscissa, first.abscissa, first.value))
        errors = [np.sqrt(((settled.value - other) ** 2).mean()) for other in against]
        line(f"{split} {interval}" + (f" {tolerance:g}" if tolerance else ""), f"{errors[0]:12.4f} {errors[1]:9.4f}", cost(wet)[0])


if __name__ == "__main__":
    main()
