"""Versions of poreslip and of what it stands on, found without loading any of it but the MPI library."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from importlib import metadata

from coupling import __version__
from coupling.errors import InputError
from coupling.native import REPOSITORY, build_directory, library_path

_DEBIAN_PACKAGES = {"LIGGGHTS": "libliggghts3", "LAMMPS": "liblammps0", "PETSc": "libpetsc-real3.18", "CGAL": "libcgal-dev"}
_NATIVE_PARTS = ("libporeslip_engine_guard", "libporeslip_liggghts", "poreslip_network", "poreslip_flow")


def information() -> list[tuple[str, str]]:
    """Names and values, in the order to print."""
    facts = [("poreslip", f"{__version__}{_revision()}"), ("directory", str(REPOSITORY))]
    facts += [("Python", f"{platform.python_version()} ({sys.executable})")]
    facts += [(name, _python_package(name)) for name in ("numpy", "cattrs", "numexpr", "nanobind", "mpi4py")]
    facts += [("MPI library", _mpi_library())]
    facts += [(name, _debian_package(package)) for name, package in _DEBIAN_PACKAGES.items()]
    facts += [("native build", str(build_directory()))]
    facts += [(f"  {part}", _part(part)) for part in _NATIVE_PARTS]
    facts += [("machine", f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores, {_memory_GB():.1f} GB of memory")]
    return facts


def _revision() -> str:
    if not shutil.which("git") or not (REPOSITORY / ".git").exists():
        return ""
    described = subprocess.run(
        ["git", "-C", str(REPOSITORY), "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    )
    return f", revision {described.stdout.strip()}" if described.returncode == 0 else ""


def _python_package(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _mpi_library() -> str:
    try:
        import mpi4py

        mpi4py.rc.initialize = False
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        return f"cannot be loaded ({error})"
    return MPI.Get_library_version().split(",")[0].strip("\0\n ")


def _debian_package(package: str) -> str:
    if not shutil.which("dpkg-query"):
        return "unknown: this is not a Debian system"
    asked = subprocess.run(["dpkg-query", "-W", "-f=${db:Status-Status} ${Version}", package], capture_output=True, text=True, check=False)
    state, _, version = asked.stdout.partition(" ")
    return f"{version} ({package})" if state == "installed" else f"not installed ({package})"


def _part(name: str) -> str:
    try:
        return f"built ({library_path(name).name})"
    except InputError:
        return "not built"


def _memory_GB() -> float:
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
