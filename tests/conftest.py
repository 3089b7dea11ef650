"""Fixtures of all tests. A test that needs several processes starts them with `mpirun`, naming its number of ranks."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from processes import MPIRUN, REPOSITORY, Completed, environment, run_process, the_message
from tiny_fault import TINY, UPRIGHT, settings


@pytest.fixture(scope="session")
def mpirun() -> Callable[..., Completed]:
    """`mpirun(ranks, arguments, timeout=120, cwd=None, env=None)`: run Python with these arguments on that many ranks.

    `arguments` is what follows `python`, such as `[script, "x"]` or `["-m", "coupling", "run", ...]`; `env` adds variables.
    """

    def run(ranks: int, arguments: Sequence[str | Path], timeout: float = 120.0, cwd: Path | None = None, env: dict[str, str] | None = None) -> Completed:
        return run_process([*MPIRUN, "-n", str(ranks), sys.executable, *arguments], timeout, cwd, environment(**(env or {})))

    return run


@pytest.fixture(scope="session")
def poreslip(mpirun: Callable[..., Completed]) -> Callable[..., Completed]:
    """`poreslip(*arguments, ranks=1, timeout=120, cwd=None, env=None)`: run the command; one rank is started without mpirun."""

    def run(*arguments: str | Path, ranks: int = 1, timeout: float = 120.0, cwd: Path | None = None, env: dict[str, str] | None = None) -> Completed:
        if ranks > 1:
            return mpirun(ranks, ["-m", "coupling", *arguments], timeout, cwd, env)
        return run_process([sys.executable, "-m", "coupling", *arguments], timeout, cwd, environment(**(env or {})))

    return run


@pytest.fixture(scope="session")
def stage_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of the stages that the tests prepare: each pack is made once a session, and none of the user's is touched."""
    return tmp_path_factory.mktemp("stages")


@pytest.fixture
def tiny_case(tmp_path: Path) -> Path:
    """Case file of the tiny fault, with the runs `wet` and `dry`."""
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return path


@pytest.fixture
def upright_case(tmp_path: Path) -> Path:
    """Case file of the tiny upright fault, with the runs `wet` and `dry`."""
    path = tmp_path / "upright.toml"
    path.write_text(UPRIGHT)
    return path


@pytest.fixture
def run_fault(poreslip: Callable[..., Completed], stage_cache: Path, tiny_case: Path, tmp_path: Path) -> Callable[..., Path]:
    """`run_fault(*overrides, run="wet", out="out", ranks=1, options=(), case=None)`: run the tiny fault, or another case; the directory of its results."""

    def run(*overrides: str, run: str = "wet", out: str = "out", ranks: int = 1, options: Sequence[str] = (), case: Path | None = None) -> Path:
        case = case or tiny_case
        command = ["run", case, "--only", run, "--out", tmp_path / out, *settings(*overrides), *options]
        done = poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})
        assert done.returncode == 0, done.stderr
        return tmp_path / out / case.stem / run

    return run


@pytest.fixture
def failing_fault(poreslip: Callable[..., Completed], stage_cache: Path, tiny_case: Path, tmp_path: Path) -> Callable[..., str]:
    """`failing_fault(*overrides, status=2, run="dry", ranks=1, together=True)`: run the tiny fault, which must end with that exit status and one
    message; the message.
    """

    def run(*overrides: str, status: int = 2, run: str = "dry", ranks: int = 1, together: bool = True) -> str:
        command = ["run", tiny_case, "--only", run, "--out", tmp_path / "out", *settings(*overrides)]
        return the_message(poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)}), status, together)

    return run


@pytest.fixture
def own_decks(tmp_path: Path) -> Path:
    """A copy of the decks, to be changed; the tiny fault takes them with `decks_directory=...`."""
    copy = tmp_path / "my-decks"
    shutil.copytree(REPOSITORY / "liggghts-inputs", copy, ignore=shutil.ignore_patterns("styles"))
    return copy
