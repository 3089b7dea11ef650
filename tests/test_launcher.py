"""The launcher, on a small stand-in for the repository: set-up happens once, from anywhere, and its failures say what to do."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from conftest import REPOSITORY, Completed, run_process

from coupling import __version__

CMAKE = """
cmake_minimum_required(VERSION 3.25)
project(stand_in NONE)
add_custom_command(OUTPUT product DEPENDS ${CMAKE_SOURCE_DIR}/source COMMAND ${CMAKE_COMMAND} -E copy ${CMAKE_SOURCE_DIR}/source product)
add_custom_target(all_products ALL DEPENDS product)
"""
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PORESLIP_", "PYTHONPATH"))} | {"PORESLIP_PACKAGES": "present"}


@pytest.fixture
def stand_in(tmp_path: Path) -> Path:
    """A directory, with a space in its name, that holds what the launcher needs and no more."""
    directory = tmp_path / "pore slip"
    (directory / "coupling").mkdir(parents=True)
    shutil.copy(REPOSITORY / "poreslip", directory)
    for name in ("__init__", "__main__", "command_line", "errors", "info", "native"):
        shutil.copy(REPOSITORY / "coupling" / f"{name}.py", directory / "coupling")
    (directory / "pyproject.toml").write_text("dependencies = [\n]\n")
    (directory / "CMakeLists.txt").write_text(CMAKE)
    (directory / "source").write_text("first")
    return directory


def launch(launcher: Path, *arguments: str, cwd: Path, **environment: str) -> Completed:
    return run_process([launcher, *arguments], timeout=120, cwd=cwd, env=ENVIRONMENT | environment)


def test_set_up_is_done_once_and_followed_by_rebuilds(stand_in: Path, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(stand_in / "poreslip")
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "coupling").mkdir(parents=True)
    (elsewhere / "coupling" / "__init__.py").write_text("raise SystemExit('a stranger of the same name')")

    told = launch(link, "--version", cwd=elsewhere)
    assert (told.returncode, told.stdout, told.stderr) == (0, f"poreslip {__version__}\n", "")
    assert not (stand_in / ".venv").exists()

    first = launch(link, "info", cwd=elsewhere)
    assert first.returncode == 0
    assert "making a Python environment" in first.stderr and "building the compiled parts" in first.stderr
    assert str(stand_in) in first.stdout
    assert (stand_in / "build" / "product").read_text() == "first"

    start = time.monotonic()
    second = launch(link, "--version", cwd=elsewhere)
    took = time.monotonic() - start
    assert (second.returncode, second.stderr) == (0, "")
    assert took < 2.0  # 0.1 s on an idle machine

    command = tmp_path / "poreslip-link"
    command.symlink_to(stand_in / ".venv" / "bin" / "poreslip")
    assert launch(command, "--version", cwd=elsewhere).stdout == f"poreslip {__version__}\n"
    flow = launch(stand_in / ".venv" / "bin" / "poreflow", cwd=elsewhere)
    # The stand-in holds no flow solver.
    assert flow.returncode == 1 and "No module named flowsolver" in flow.stderr

    (stand_in / "source").write_text("second")
    third = launch(link, "info", cwd=elsewhere)
    assert "building the compiled parts" in third.stderr and "environment" not in third.stderr
    assert (stand_in / "build" / "product").read_text() == "second"

    moved = stand_in.rename(tmp_path / "moved")
    fourth = launch(moved / "poreslip", "info", cwd=elsewhere)
    assert fourth.returncode == 0
    assert str(moved) in fourth.stdout and "was made for another directory" in fourth.stderr

    (moved / "CMakeLists.txt").write_text('project(stand_in NONE)\nmessage(FATAL_ERROR "no compiler at all")')
    shutil.rmtree(moved / "build")
    failed = launch(moved / "poreslip", "info", cwd=elsewhere)
    assert failed.returncode == 1
    assert "no compiler at all" in failed.stderr and "could not configure the build" in failed.stderr
    (moved / "CMakeLists.txt").write_text(CMAKE)
    assert launch(moved / "poreslip", "info", cwd=elsewhere).returncode == 0
    assert (moved / "build" / "product").read_text() == "second"


def test_two_that_start_together_set_up_once(stand_in: Path) -> None:
    launcher = [str(stand_in / "poreslip"), "info"]
    both = [subprocess.Popen(launcher, env=ENVIRONMENT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    ended = [(*process.communicate(timeout=120), process.returncode) for process in both]
    assert [status for *_, status in ended] == [0, 0]
    told = "".join(err for _, err, _ in ended)
    assert told.count("making a Python environment") == told.count("building the compiled parts") == 1
    assert told.count("waiting for another poreslip") == 1


def test_a_package_that_cannot_be_installed(stand_in: Path) -> None:
    (stand_in / "pyproject.toml").write_text('dependencies = [\n    "numpy==0.0.0",\n]\n')
    failed = launch(stand_in / "poreslip", "info", cwd=stand_in, PIP_NO_INDEX="1", PIP_FIND_LINKS="")
    assert failed.returncode == 1
    assert "numpy==0.0.0" in failed.stderr and "check the network" in failed.stderr
    assert "Traceback" not in failed.stderr


def fake_command(directory: Path, name: str, script: str) -> None:
    directory.mkdir(exist_ok=True)
    (directory / name).write_text(f"#!/bin/sh\n{script}\n")
    (directory / name).chmod(0o755)


@pytest.mark.skipif(os.geteuid() != 0, reason="plays both root and another user")
def test_missing_debian_packages(stand_in: Path, tmp_path: Path) -> None:
    fakes = tmp_path / "fakes"
    fake_command(fakes, "dpkg-query", "echo installed cmake")
    fake_command(fakes, "sudo", "exit 1")
    fake_command(fakes, "apt-get", 'echo "E: no route to the archive"; exit 100')
    environment = ENVIRONMENT | {"PATH": f"{fakes}:{os.environ['PATH']}", "PORESLIP_PACKAGES": ""}

    failed = run_process([stand_in / "poreslip", "info"], timeout=60, env=environment)
    assert failed.returncode == 1
    assert "E: no route to the archive" in failed.stderr and "apt-get update failed" in failed.stderr

    # The same as a user who may not install anything, in a directory of their own.
    for directory in (tmp_path, *tmp_path.parents[:2]):
        directory.chmod(0o755)
    for path in (stand_in, *stand_in.rglob("*")):
        os.chown(path, 65534, 65534)
    command = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", stand_in / "poreslip", "info"]
    refused = run_process(command, timeout=60, env=environment)
    assert refused.returncode == 1
    assert "only root may install them" in refused.stderr
    assert "apt-get install g++ ninja-build" in refused.stderr
