"""A run of the program for the stability map: `poreslip run` in a process of its own, and whether what it left is sound."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from coupling.native import REPOSITORY
from coupling.stability.scene import FAILED, REFUSED, STABLE, STOPPED, WARNED, Outcome
from coupling.study.runner import on_ranks

#: A run that takes longer hangs, s: the scenes take seconds.
PATIENCE_S = 240.0
#: Ranks on which a scene's process makes its runs, for that process.
RANKS = "PORESLIP_STABILITY_RANKS"
#: Figures of a report that must stay below these in a sound run, whatever the scene.
SOUND = {"energy_gain": 1e-3, "momentum_residual": 1e-10, "mass_residual": 1e-8, "work_residual": 1e-10}


@dataclass(frozen=True)
class Ran:
    """status: of the process, negative for a signal, None where it hung. said: its last words. directory: of the results."""

    status: int | None
    said: str
    directory: Path
    ranks: int = 1

    @property
    def history(self) -> dict[str, list[float]]:
        with open(self.directory / "history.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        return {name: [float(row[name]) for row in rows] for name in rows[0]}

    @property
    def report(self) -> dict:
        return json.loads((self.directory / "report.json").read_text())

    @property
    def figures(self) -> dict[str, float]:
        return self.report["quasi_static_checks"]


def run(directory: Path, case: str, *settings: str, decks: dict[str, str] | None = None, unrefused: bool = False) -> Ran:
    """Run a case (TOML, with one run) with `--set` values. decks: lines to add to decks, by name, for what the checks of a case would refuse.
    unrefused: past the limits of time steps and servos that are known beforehand, to find out where they are."""
    directory.mkdir(parents=True, exist_ok=True)
    if decks:
        copy = directory / "decks"
        shutil.copytree(REPOSITORY / "liggghts-inputs", copy, ignore=shutil.ignore_patterns("styles"), dirs_exist_ok=True)
        for name, lines in decks.items():
            (copy / name).write_text((REPOSITORY / "liggghts-inputs" / name).read_text() + lines + "\n")
        case = 'decks_directory = "decks"\n' + case
    (directory / "case.toml").write_text(case)
    ranks = int(os.environ.get(RANKS, "1"))
    command = [*on_ranks(ranks), sys.executable, "-m", "coupling", "run", str(directory / "case.toml"), "--out", str(directory)]
    command += ["--unrefused"] if unrefused else []
    command += [part for setting in settings for part in ("--set", setting)]
    status, said = in_time(command, PATIENCE_S)
    return Ran(status, " ".join(said.split("\n-----")[0].split()), directory / "case" / "run", ranks)


def in_time(command: list[str], patience_s: float, extra: dict[str, str] | None = None) -> tuple[int | None, str]:
    """Exit status, None if the command had to be ended, and what it wrote to stderr. extra: variables of its environment."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])]), "OMP_NUM_THREADS": "1"}
    # What the MPI of this process left there would make the other take itself for a part of it.
    environment = {name: value for name, value in environment.items() if not name.startswith(("OMPI_COMM", "PMIX_", "ORTE_", "PMI_"))} | (extra or {})
    process = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        _, errors = process.communicate(timeout=patience_s)
        return process.returncode, errors
    except subprocess.TimeoutExpired:
        return None, f"no end after {patience_s:g} s"
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def judged(ran: Ran, figure: Callable[[Ran], tuple[bool, str]]) -> Outcome:
    """How a run ended; `figure` tells of one that came to its end whether it is sound, and by what."""
    return dataclasses.replace(_ended(ran, figure), ranks=ran.ranks)


def _ended(ran: Ran, figure: Callable[[Ran], tuple[bool, str]]) -> Outcome:
    if ran.status in (2, 3) and "Traceback" not in ran.said and ran.said.count("poreslip: ") == 1:
        return Outcome(REFUSED if ran.status == 2 else STOPPED, ran.said.split("poreslip: ", 1)[1])
    if ran.status != 0:
        how = "hung" if ran.status is None else f"signal {-ran.status}" if ran.status < 0 else f"exit status {ran.status}"
        return Outcome(FAILED, f"{how}: {ran.said[-300:]}")
    unsound = [warning for warning in ran.report["warnings"] if warning.split()[0] in SOUND]
    if unsound:
        return Outcome(WARNED, "warning: " + "; ".join(unsound))
    bad = [f"{name} {ran.figures[name]:.3g}" for name, most in SOUND.items() if not ran.figures.get(name, 0.0) <= most]
    bad += [f"{name} not finite" for name, values in ran.history.items() if not all(map(math.isfinite, values))]
    sound, words = figure(ran)
    return Outcome(STABLE, words) if sound and not bad else Outcome(FAILED, "; ".join(["ended without a word", *bad, words]))
