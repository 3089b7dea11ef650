"""overhead: CPU time of a step under the driver, over that of the same deck in the stock `liggghts`, and what each kind of flow adds.

    python benchmarks/overhead/run.py                     # the table
    python benchmarks/overhead/run.py --repeats 5 --scene sample

Each figure is the median over the repeats, and a step's time is the difference of a long and a short run over their difference of
steps, so that start and end count for nothing. The repeats of the kinds follow each other in turn. The last column is of the long
run alone: what the flow's own phases took of it, over all its other phases. The stock program runs the
deck of the loading stage with the same values; it gets our styles by preloading (preload_styles.cpp), for LIGGGHTS has no walls and bonds of that
kind, and writes neither history nor report.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
BUILD = Path(os.environ.get("PORESLIP_BUILD", REPOSITORY / "build"))
sys.path.insert(0, str(REPOSITORY))

from coupling.case.files import load_case  # noqa: E402  (needs the path above)

FAULT, SAMPLE = "cases/two_sides/quick.toml", "cases/consolidation/consolidation.toml"
#: A sample of about 8000 grains, with the load and the drainage of cases/studies/coupling_interval_8000.toml; and the longest interval between two
#: solves with the tolerance that this study recommends, beside even intervals.
SAMPLE_8000 = ("pack.box_m=[0.038, 0.038, 0.038]", "fluid.viscosity_Pa_s=5.26", "sample.ramp_time_s=2.85e-5")
LONGEST, TOLERANCE, EVEN = 600, 0.16, 200
#: Phases of a report that a dry run has, too.
OF_DRY = {"stages", "engine", "measures", "output"}
#: Those are asked for, not overhead.
NO_SNAPSHOTS = "output.snapshots=0"
#: So small pressures change no trajectory. They differ, for facets between even pressures cost next to nothing.
FAINT = ("pressure.left_target_Pa=1.0", "pressure.right_target_Pa=0.5")


def cpu_seconds(command: list[str], **environment: str) -> float:
    """User and system seconds of a command and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


class Case:
    """One run of a case with inputs of its own, by steps."""

    def __init__(self, file: str, run: str, length: str, *overrides: str):
        self.file, self.run, self.overrides = str(REPOSITORY / file), run, overrides
        (case,) = [run_ for run_ in load_case(self.file, overrides).runs if run_.name == run]
        key, value = length, case
        for part in key.split("."):
            value = getattr(value, part)
        self._key, self._per_step, self._case = key, value / case.loading_steps, case

    def inputs(self, steps: int) -> list[str]:
        length = self._per_step * (steps - 0.5)
        given = [f"{self._key}={length:.17g}", f"output.history_interval_steps={min(steps, self._case.output.history_interval_steps)}"]
        if self._case.scene == "sample":
            # A short run counts for its start and end: in a long one the whole rise of the load, with its short intervals, is what is timed.
            given.append(f"sample.ramp_time_s={min(length, self._case.sample.ramp_time_s):.17g}")
        return [part for override in (*self.overrides, *given) for part in ("--set", override)]

    def driver(self, steps: int, work: Path) -> tuple[float, float]:
        """CPU seconds, and the flow's phases over all others."""
        command = [str(REPOSITORY / "poreslip"), "run", self.file, "--only", self.run, "--out", str(work / "out"), *self.inputs(steps)]
        spent = cpu_seconds(command)
        (report,) = (work / "out").glob(f"*/{self.run}/report.json")
        phases = [phase for of_rank in json.loads(report.read_text())["cpu_s_by_phase_and_rank"] for phase in of_rank.items()]
        dry = sum(phase["cpu_s"] for name, phase in phases if name in OF_DRY)
        return spent, sum(phase["cpu_s"] for _, phase in phases) / dry - 1.0

    def stock(self, steps: int, work: Path) -> tuple[float, None]:
        deck, preload = work / "deck.in", work / "preload.so"
        if not preload.exists():
            include = "/usr/include/liggghts"
            mpi = subprocess.run(["mpicxx", "--showme:compile"], capture_output=True, text=True, check=True).stdout.split()
            subprocess.run(["g++", "-std=c++20", "-O2", "-shared", "-fPIC", "-DOMPI_SKIP_MPICXX", f"-I{include}", *mpi,
                            str(HERE / "preload_styles.cpp"), "-o", str(preload), "-ldl"], check=True)  # fmt: skip
        subprocess.run([sys.executable, str(HERE / "stock_deck.py"), self.file, self.run, str(deck), str(steps), *self.inputs(steps)],
                       env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, check=True)  # fmt: skip
        command = ["liggghts", "-in", str(deck), "-log", str(work / "log"), "-screen", str(work / "screen")]
        return cpu_seconds(command, LD_PRELOAD=f"{BUILD / 'lib' / 'libporeslip_liggghts.so'}:{preload}"), None


def rows() -> list[tuple[str, str | None, Callable, tuple[int, int]]]:
    """Name, the name of the row that it is compared with, the timed run, and its numbers of steps."""
    strain, time = "loading.horizontal_strain", "sample.loading_time_s"
    dry = Case(FAULT, "case5", strain, NO_SNAPSHOTS)
    prescribed = Case(FAULT, "case1", strain, NO_SNAPSHOTS, *FAINT)

    def of_sample(run: str, interval: int, tolerance: float = 0.0) -> Case:
        intervals = (f"flow.interval_steps={interval}", f"flow.interval_tolerance={tolerance}")
        return Case(SAMPLE, run, time, *SAMPLE_8000, "sample.loading_time_s=3e-4", *intervals, f"output.history_interval_steps={LONGEST}")

    quiet = of_sample("dry", EVEN)
    fault, sample = (1000, 5000), (200, 6000)
    return [
        ("fault, stock liggghts", None, dry.stock, fault),
        ("fault, dry", "fault, stock liggghts", dry.driver, fault),
        ("fault, prescribed pressure", "fault, dry", prescribed.driver, fault),
        ("sample, stock liggghts", None, quiet.stock, sample),
        ("sample, dry", "sample, stock liggghts", quiet.driver, sample),
        (f"sample, two-way, every {EVEN}", "sample, dry", of_sample("two_way", EVEN).driver, sample),
        (f"sample, two-way, {TOLERANCE}", "sample, dry", of_sample("two_way", LONGEST, TOLERANCE).driver, sample),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--scene", choices=["fault", "sample"], help="rows of this scene alone")
    arguments = parser.parse_args()
    work = Path(tempfile.mkdtemp(prefix="overhead-"))
    table = [row for row in rows() if row[0].startswith(arguments.scene or "")]
    seconds: dict[str, list[float]] = {name: [] for name, *_ in table}
    shares: dict[str, list[float | None]] = {name: [] for name, *_ in table}
    try:
        for name, _, timed, (short, _) in table:
            timed(short, work)  # prepares the stages
        for _ in range(arguments.repeats):
            for name, _, timed, (short, long) in table:
                (of_long, share), (of_short, _) = timed(long, work), timed(short, work)
                seconds[name].append((of_long - of_short) / (long - short))
                shares[name].append(share)
    finally:
        shutil.rmtree(work)
    print(f"{'':28}{'CPU ms a step':>14}{'over':>28}{'median of ratios - 1':>22}{'flow over the rest':>20}")
    for name, base, *_ in table:
        ratio = share = ""
        if base:
            ratio = f"{base:>28}{100.0 * (statistics.median(a / b for a, b in zip(seconds[name], seconds[base])) - 1.0):21.1f}%"
        if any(shares[name]):
            share = f"{100.0 * statistics.median(shares[name]):19.1f}%"
        print(f"{name:28}{1e3 * statistics.median(seconds[name]):14.3f}{ratio:50}{share}", flush=True)


if __name__ == "__main__":
    main()
