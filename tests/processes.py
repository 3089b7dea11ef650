"""Processes that tests start: their environment, how long they may take, and what a failed command has to say."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]

Completed = subprocess.CompletedProcess


def environment(**extra: str) -> dict[str, str]:
    """The environment of a process that a test starts: this interpreter's packages, one thread, MPI as the launcher sets it."""
    paths = [str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1", "OMPI_MCA_btl_vader_single_copy_mechanism": "none"} | extra


def run_process(command: Sequence[str | Path], timeout: float, cwd: Path | None = None, env: dict[str, str] | None = None) -> Completed:
    """Run a command with its output captured; one that hangs is ended with all it started, and the test fails with what it wrote."""
    process = subprocess.Popen(
        [str(part) for part in command],
        cwd=cwd,
        env=environment() if env is None else env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            out, err = process.communicate(timeout=5)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
        pytest.fail(f"{' '.join(map(str, command))} hung for {timeout:g} s\n{out[-2000:]}\n{err[-2000:]}")
    return Completed(process.args, process.returncode, out, err)


def the_message(done: Completed, status: int, together: bool = True) -> str:
    """The one message that a failed command printed; checks its exit status, that there is no traceback, and that ranks end together."""
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr, done.stderr
    assert done.stderr.count("poreslip: ") == 1, done.stderr
    assert not together or "MPI_ABORT" not in done.stderr, done.stderr
    return done.stderr.split("poreslip: ", 1)[1]
