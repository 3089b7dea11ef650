"""Processes of a study: each run on its own, what it took, how it ended; a finished one is not repeated."""

from __future__ import annotations

import ctypes
import dataclasses
import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from coupling.native import REPOSITORY
from coupling.results.output import write_atomically
from coupling.study.plan import Job
from coupling.study.revision import revision

FINISHED = "finished.json"
#: A process that was told to stop gets this long to write what it has, s.
PATIENCE_S = 30.0
#: prctl(2), known before a process is forked that calls it.
_LIBC, PR_SET_PDEATHSIG = ctypes.CDLL(None), 1
MPIRUN = ("mpirun", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1")


def on_ranks(ranks: int) -> list[str]:
    """What begins a command on so many ranks."""
    if ranks == 1:
        return []
    # Who runs poreslip as root has decided so.
    return [*MPIRUN, *(["--allow-run-as-root"] if os.geteuid() == 0 else []), "-n", str(ranks)]


@dataclass(frozen=True)
class Outcome:
    """How a run ended. status: of its process, None where it was refused beforehand or took too long. reason: empty when it was done.

    wall_s, cpu_s, peak_bytes: of the whole process with what it started. revision: name of that of the code which made it.
    """

    directory: Path
    status: int | None
    reason: str
    wall_s: float
    cpu_s: float
    peak_bytes: int
    revision: str

    @property
    def done(self) -> bool:
        return self.status == 0


class Runner:
    """Carries out jobs below `pool`, one directory for each by the digest of its inputs."""

    def __init__(self, pool: Path, limit_s: float, keep: bool = False):
        """keep: take runs that another revision of the code made too."""
        self._pool, self._limit_s, self._keep = pool, limit_s, keep

    def kept(self, job: Job) -> Outcome | None:
        """The outcome of a job that was finished before, by the same sources unless all are kept."""
        outcome, sources = self._found(job)
        return outcome if self._keep or sources == revision().digest else None

    def of_other_sources(self, job: Job) -> str:
        """Name of the revision that finished a job before, where that is another one; else empty."""
        outcome, sources = self._found(job)
        return outcome.revision if outcome and sources != revision().digest else ""

    def _found(self, job: Job) -> tuple[Outcome | None, str]:
        """What is left of a job from before, and the digest of the sources that made it."""
        directory = self._pool / job.digest[:16]
        try:
            content = json.loads((directory / FINISHED).read_text())
        except (OSError, ValueError):
            return None, ""
        # Those of former versions named no revision.
        digest, limit_s, sources = content.pop("digest"), content.pop("limit_s", 0.0), content.pop("sources", "")
        # One that took too long may come to its end in more time.
        if digest != job.digest or (content["status"] is None and limit_s < self._limit_s):
            return None, ""
        return Outcome(directory=directory / job.results, **{"revision": "unknown"} | content), sources

    def carry_out(self, job: Job) -> Outcome:
        """Run a job to its end, or take what is there; an interrupt ends its process and leaves nothing that looks finished."""
        if job.refused:
            return Outcome(self._pool / job.digest[:16], None, f"refused: {job.refused}", 0.0, 0.0, 0, revision().name)
        with self._alone(job):
            return self.kept(job) or self._carried_out(job)

    @contextmanager
    def _alone(self, job: Job) -> Iterator[None]:
        """A block that no other study with the same runs enters for this job meanwhile; it would remove what is being written."""
        self._pool.mkdir(parents=True, exist_ok=True)
        with open(self._pool / f"{job.digest[:16]}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _carried_out(self, job: Job) -> Outcome:
        directory = self._pool / job.digest[:16]
        shutil.rmtree(directory, ignore_errors=True)
        directory.mkdir(parents=True)
        outcome = self._measured(job, directory)
        content = {key: value for key, value in dataclasses.asdict(outcome).items() if key != "directory"}
        write_atomically(directory / FINISHED, json.dumps(content | {"digest": job.digest, "limit_s": self._limit_s, "sources": revision().digest}, indent=1) + "\n")
        return outcome

    def _measured(self, job: Job, directory: Path) -> Outcome:
        paths = [str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
        start, late = time.monotonic(), False
        with open(directory / "screen.txt", "w") as screen, open(directory / "errors.txt", "w") as errors:
            # A session of its own: Ctrl-C reaches this process alone, which then ends the other.
            process = subprocess.Popen([*on_ranks(job.ranks), sys.executable, *job.arguments], cwd=directory, env=environment, stdin=subprocess.DEVNULL,
                                       stdout=screen, stderr=errors, start_new_session=True, preexec_fn=_end_with_parent)  # fmt: skip
            try:
                usage, code = self._wait(process, start)
                if usage is None:
                    late = True
                    usage, code = _end(process)
            except BaseException:
                _end(process)
                raise
        wall = time.monotonic() - start
        reason = f"took longer than {self._limit_s:g} s" if late else _reason(code, (directory / "errors.txt").read_text(errors="replace"))
        return Outcome(directory / job.results, None if late else code, reason, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024,
                       revision().name)

    def _wait(self, process: subprocess.Popen, start: float):
        """Resources and exit status of the process; (None, None) when its time is over."""
        pause = 0.005
        while time.monotonic() - start < self._limit_s:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            if ended:
                process.returncode = os.waitstatus_to_exitcode(status)
                return usage, process.returncode
            time.sleep(pause)
            pause = min(2.0 * pause, 0.2)
        return None, None


def _end_with_parent() -> None:
    """In the new process: have it end where this one is killed and can no longer end it (Linux)."""
    _LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _end(process: subprocess.Popen):
    """End a process and all it started; its resources and exit status."""
    if process.returncode is not None:
        return None, process.returncode
    os.killpg(process.pid, signal.SIGTERM)
    end = time.monotonic() + PATIENCE_S
    while True:
        ended, status, usage = os.wait4(process.pid, os.WNOHANG if time.monotonic() < end else 0)
        if ended:
            process.returncode = os.waitstatus_to_exitcode(status)
            return usage, process.returncode
        time.sleep(0.05)
        if time.monotonic() > end:
            os.killpg(process.pid, signal.SIGKILL)


def _reason(code: int, errors: str) -> str:
    """Why a process did not do what it was asked for, in its own words; empty for one that did."""
    if code == 0:
        return ""
    said = [line.strip() for line in errors.splitlines() if line.startswith(("poreslip: ", "poreflow: "))]
    words = said[-1].split(": ", 1)[1] if said else (errors.strip().splitlines() or ["it said nothing"])[-1]
    kind = {2: "refused", 3: "failed"}.get(code, f"ended by signal {-code}" if code < 0 else f"exit status {code}")
    return f"{kind}: {words}"
