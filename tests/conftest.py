"""Fixtures of all tests. A test that needs several processes starts them with `mpirun`, naming its number of ranks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
_MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1"]

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


@pytest.fixture(scope="session")
def mpirun() -> Callable[..., Completed]:
    """`mpirun(ranks, arguments, timeout=120, cwd=None, env=None)`: run Python with these arguments on that many ranks.

    `arguments` is what follows `python`, such as `[script, "x"]` or `["-m", "coupling", "run", ...]`; `env` adds variables.
    """

    def run(ranks: int, arguments: Sequence[str | Path], timeout: float = 120.0, cwd: Path | None = None, env: dict[str, str] | None = None) -> Completed:
        return run_process([*_MPIRUN, "-n", str(ranks), sys.executable, *arguments], timeout, cwd, environment(**(env or {})))

    return run


@pytest.fixture(scope="session")
def poreslip(mpirun: Callable[..., Completed]) -> Callable[..., Completed]:
    """`poreslip(*arguments, ranks=1, timeout=120, cwd=None, env=None)`: run the command; one rank is started without mpirun."""

    def run(*arguments: str | Path, ranks: int = 1, timeout: float = 120.0, cwd: Path | None = None, env: dict[str, str] | None = None) -> Completed:
        if ranks > 1:
            return mpirun(ranks, ["-m", "coupling", *arguments], timeout, cwd, env)
        return run_process([sys.executable, "-m", "coupling", *arguments], timeout, cwd, environment(**(env or {})))

    return run
