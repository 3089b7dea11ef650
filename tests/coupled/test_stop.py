"""Runs that are stopped: by a signal cleanly after the current interval, by kill -9 with nothing lost but what came after the last checkpoint."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import MPIRUN, environment
from tiny_fault import LONG, last_grains, settings

SEVERAL = pytest.param(2, marks=pytest.mark.parallel)


def children(pid: int) -> list[int]:
    """Processes that a process started."""
    return [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()]


class LongRun:
    """The tiny fault in a run of minutes, in the background."""

    def __init__(self, case: Path, out: Path, cache: Path, ranks: int, *options: str):
        command = [sys.executable, "-m", "coupling", "run", case, "--only", "wet", "--out", out, *settings(*LONG), *options]
        if ranks > 1:
            command = [*MPIRUN, "-n", str(ranks), *command]
        self.directory = out / "tiny" / "wet"
        self._process = subprocess.Popen(
            [str(part) for part in command], env=environment(PORESLIP_CACHE=str(cache)), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, start_new_session=True)  # fmt: skip
        self.ranks = ranks

    @property
    def pid(self) -> int:
        return self._process.pid

    def rank_pids(self) -> list[int]:
        return [self.pid] if self.ranks == 1 else children(self.pid)

    def wait_for(self, condition) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert self._process.poll() is None, self._process.communicate()
            assert time.monotonic() < end, "the run does not get on"
            time.sleep(0.02)

    def wait_for_lines(self, count: int) -> None:
        table = self.directory / "history.csv"
        self.wait_for(lambda: table.is_file() and table.read_bytes().count(b"\n") >= count)

    def ended(self) -> tuple[int, str]:
        """Exit status and what was written to stderr."""
        _, errors = self._process.communicate(timeout=30)
        return self._process.returncode, errors

    def end(self) -> None:
        if self._process.poll() is None:
            os.killpg(self.pid, signal.SIGKILL)
            self._process.communicate()


@pytest.fixture
def long_run(run_fault, tiny_case, tmp_path, stage_cache):
    """`long_run(ranks, *options)`: a run of minutes, begun; it is ended with the test."""
    run_fault(out="makes-the-stages")
    started: list[LongRun] = []

    def start(ranks: int, *options: str) -> LongRun:
        started.append(LongRun(tiny_case, tmp_path / "out", stage_cache, ranks, *options))
        return started[-1]

    yield start
    for run in started:
        run.end()


def assert_whole(run: Path, number: int) -> None:
    """Tables end with a whole line, and the report tells of the signal at the step of the last one."""
    report = json.loads((run / "report.json").read_text())
    for table in ("history.csv", "bonds.csv"):
        lines = (run / table).read_text().split("\n")
        assert lines[-1] == ""
        assert len({line.count(",") for line in lines[:-1]}) == 1
    last = (run / "history.csv").read_text().split("\n")[-2]
    step = int(last.split(",")[0])
    assert report["ended"] == f"stopped by signal {number} at step {step}"
    assert report["complete"] is False
    assert (run / "report.md").is_file()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_clean_stop(long_run, ranks, number):
    run = long_run(ranks)
    run.wait_for_lines(5)
    for pid in run.rank_pids():
        os.kill(pid, number)
    status, errors = run.ended()
    assert status == 128 + number, errors
    assert "Traceback" not in errors
    assert_whole(run.directory, number)


@pytest.mark.parallel
def test_signal_to_one_rank_stops_all(long_run):
    run = long_run(2)
    run.wait_for_lines(5)
    os.kill(run.rank_pids()[-1], signal.SIGTERM)
    status, _ = run.ended()
    assert status == 128 + signal.SIGTERM
    assert_whole(run.directory, signal.SIGTERM)


@pytest.mark.parallel
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_to_mpirun(long_run, number):
    """mpirun passes either on as SIGTERM, and ends with a status of its own."""
    run = long_run(2)
    run.wait_for_lines(5)
    os.kill(run.pid, number)
    status, _ = run.ended()
    assert status != 0
    assert_whole(run.directory, signal.SIGTERM)


def test_no_further_run_begins_after_a_signal(tiny_case, run_fault, tmp_path, stage_cache, long_run):
    tiny_case.write_text(tiny_case.read_text() + '[[run]]\nname = "wetter"\npressure.left_target_Pa = 3e7\n')
    run = long_run(1, "--only", "wetter")
    run.wait_for_lines(5)
    os.kill(run.pid, signal.SIGTERM)
    assert run.ended()[0] == 143
    assert not (run.directory.parent / "wetter").exists()


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_interrupted_while_packing(tiny_case, tmp_path, poreslip, ranks):
    """Nothing is kept of a stage that was not finished, and the next run makes it."""
    cache = tmp_path / "cache"
    run = LongRun(tiny_case, tmp_path / "out", cache, ranks)
    try:
        run.wait_for(lambda: list(cache.glob("pack-*.partial/log.liggghts")))
        for pid in run.rank_pids():
            os.kill(pid, signal.SIGINT)
        status, errors = run.ended()
    finally:
        run.end()
    assert status == 130 and "Traceback" not in errors, errors
    assert list(cache.iterdir()) == []
    assert poreslip("run", tiny_case, "--only", "dry", "--out", tmp_path / "out", env={"PORESLIP_CACHE": str(cache)}).returncode == 0


@pytest.mark.parametrize(
    "ranks, number",
    [(1, signal.SIGKILL), pytest.param(2, signal.SIGKILL, marks=pytest.mark.parallel), (1, signal.SIGTERM)],
)
def test_stopped_and_continued(long_run, run_fault, poreslip, ranks, number):
    """From the last checkpoint on, as if nothing had been: rows past it are cut, a torn one and that of the stop itself included."""
    inputs = ("loading.horizontal_strain=1e-3", "output.snapshots=2")
    every = ("--checkpoint-every", "100")
    run = long_run(ranks, *settings(*inputs), *every)
    run.wait_for(lambda: len(list(run.directory.glob("checkpoint-*"))) == 2)
    os.kill(run.rank_pids()[0], number)
    status, _ = run.ended()
    assert status != 0
    assert (run.directory / "report.json").exists() == (number == signal.SIGTERM)
    with open(run.directory / "history.csv", "a") as table:
        table.write("99999,1.0")

    done = poreslip("run", "--restart", run.directory, ranks=ranks)
    assert done.returncode == 0, done.stderr
    never_stopped = run_fault(*inputs, out="never-stopped", ranks=ranks, options=every)
    for table in ("history.csv", "bonds.csv", "snapshots/index.csv"):
        assert (run.directory / table).read_bytes() == (never_stopped / table).read_bytes()
    files = [sorted(path.name for path in (directory / "snapshots").iterdir()) for directory in (run.directory, never_stopped)]
    assert files[0] == files[1]
    stopped, other = last_grains(run.directory), last_grains(never_stopped)
    for name in other:
        assert stopped[name].tobytes() == other[name].tobytes(), name
