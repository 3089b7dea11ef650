"""Where the compiled parts of poreslip are found."""

from __future__ import annotations

import os
from pathlib import Path

from coupling.errors import InputError

REPOSITORY = Path(__file__).resolve().parent.parent


def build_directory() -> Path:
    """Directory of the native build: the environment's PORESLIP_BUILD, else `build` in the repository."""
    chosen = os.environ.get("PORESLIP_BUILD")
    return Path(chosen).resolve() if chosen else REPOSITORY / "build"


def library_directory() -> Path:
    """Directory that holds everything compiled that is loaded at run time."""
    return build_directory() / "lib"


def library_path(name: str) -> Path:
    """Path of a compiled part.

    `name` is a file name without its ending: `libporeslip_liggghts` for a plain shared object,
    `poreslip_network` for a Python module, whose file name carries the interpreter's tag.
    """
    directory = library_directory()
    found = [path for path in (directory / f"{name}.so", *sorted(directory.glob(f"{name}.*.so"))) if path.is_file()]
    if not found:
        raise InputError(
            f"the compiled part {name} is not in {directory}. Build it with `./poreslip info` (which builds whatever is "
            "missing) or with `cmake -B build && cmake --build build`; a build kept elsewhere is named by the "
            "environment variable PORESLIP_BUILD."
        )
    return found[0]
