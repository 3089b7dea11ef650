"""Finds and imports the native modules where the build has put them."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType


def library_directory() -> Path:
    """Directory of the native modules: PORESLIP_BUILD/lib, or build/lib beside this package."""
    build = os.environ.get("PORESLIP_BUILD")
    return (Path(build) if build else Path(__file__).resolve().parent.parent / "build") / "lib"


def load(name: str) -> ModuleType:
    """Import the native module `name`, which the CMake build makes."""
    directory = library_directory()
    if str(directory) not in sys.path:
        sys.path.insert(0, str(directory))
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise ModuleNotFoundError(
            f"the native module {name} is not in {directory}; build it (cmake -B build && cmake --build build), "
            "or set PORESLIP_BUILD to the build directory",
            name=name,
        ) from None
