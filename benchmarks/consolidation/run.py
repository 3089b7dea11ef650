"""consolidation: two-way consolidation of a saturated pack, error against CPU time by the steps between two solves. Prints a table.

    .venv/bin/python benchmarks/consolidation/run.py                     # 8000 grains, some minutes
    .venv/bin/python benchmarks/consolidation/run.py --side 0.02         # 1200 grains

The load on top of a pack is raised and drains through the top (cases/consolidation). Errors are of the settlement, as a share of what
drainage settles after the load's rise: rms against Terzaghi's solution, with stiffness and permeability measured on the same pack, and rms
against the first of the intervals. Figures are CPU seconds of the loading: engine (with the fluid's answer to each step), mesh, solves. The
peer, YADE's FlowEngine with a solve in every step, makes 0.21 million grain-steps a second at 8000 grains on this class of machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from postproc.observables import ResultFiles, consolidation  # noqa: E402
from postproc.references import terzaghi  # noqa: E402

#: Million grain-steps a second of the peer, coupled, 8000 grains.
PEER = 0.21
SIDE = 0.038
VISCOSITY, TIME_FRACTION = 5.0, 0.35


def run(case: str, name: str, out: Path, settings: dict[str, object]) -> Path:
    """Carry out one run of a case file; the directory of its results."""
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "coupling", "run", str(ROOT / "cases" / case / f"{case}.toml"), "--only", name, "--out", str(out), *given]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return out / case / name


def cost(directory: Path) -> tuple[dict[str, float], float, int]:
    """CPU seconds by phase of the loading, grains times steps, and steps."""
    report = json.loads((directory / "report.json").read_text())
    spent = {name: phase["cpu_s"] for name, phase in report["cpu_s_by_phase_and_rank"][0].items() if name not in ("stages", "measures", "output")}
    return spent, report["grains"] * report["last"]["step"], report["last"]["step"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=float, default=SIDE, help="of the box, m")
    parser.add_argument("--intervals", type=int, nargs="+", default=[10, 20, 50, 100, 200], help="steps between two solves")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "benchmark-consolidation")
    a = parser.parse_args()
    scale = a.side / SIDE
    # Drainage takes as many times longer than a wave, whatever the size.
    common = {"pack.box_m": [a.side] * 3, "loading.time_step_fraction": TIME_FRACTION, "fluid.viscosity_Pa_s": VISCOSITY / scale}
    load = common | {"sample.ramp_time_s": 3e-5 * scale, "sample.loading_time_s": 4e-4 * scale}
    dry = run("consolidation", "dry", a.out, load)
    darcy = run("darcy", "run", a.out, {"pack.box_m": [a.side] * 3, "sample.loading_time_s": 1e-5 * scale**2})
    spent, work, steps = cost(dry)
    dry_step = sum(spent.values()) / steps
    print(f"{work // steps} grains, {steps} steps; CPU seconds\n")
    print(f"{'interval':>8} {'to Terzaghi':>12} {'to first':>9} {'engine':>7} {'mesh':>6} {'solves':>7} {'total':>7} {'over dry':>9} {'M grain-steps/s':>16} {'over peer':>10}")
    print(f"{'dry':>8} {'':>12} {'':>9} {spent['engine']:7.1f} {'':>6} {'':>7} {spent['engine']:7.1f} {1.0:9.2f} {work / sum(spent.values()) / 1e6:16.2f}")
    first = None
    for interval in a.intervals:
        lines = {"output.history_interval_steps": int(np.lcm.reduce(a.intervals))}
        wet = run("consolidation", "two_way", a.out / str(interval), load | lines | {"flow.interval_steps": interval})
        files = ResultFiles(wet, {"dry": dry, "darcy": darcy})
        settled = consolidation(files)
        first = settled.value if first is None else first
        errors = [np.sqrt(((settled.value - exact) ** 2).mean()) for exact in (terzaghi(files, settled), first)]
        spent, work, steps = cost(wet)
        total = sum(spent.values())
        print(
            f"{interval:8d} {errors[0]:12.4f} {errors[1]:9.4f} {spent['engine']:7.1f} {spent['tessellation']:6.1f} {spent['flow'] + spent['forces']:7.1f} {total:7.1f} "
            f"{total / steps / dry_step:9.2f} {work / total / 1e6:16.2f} {work / total / 1e6 / PEER:10.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
