"""Which code made a run: a digest of the sources that decide its result, and the name of their revision."""

from __future__ import annotations

import hashlib
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from coupling import __version__
from coupling.native import REPOSITORY

#: Below the repository: what a run is carried out by. The decks are inputs of a run, and so part of its own digest.
SOURCES = ("coupling", "flowsolver", "liggghts-inputs/styles")
#: What only starts runs and looks at their results.
APART = ("coupling/study", "coupling/stability")
SUFFIXES = {".py", ".cpp", ".h", ".hpp", ".txt"}


@dataclass(frozen=True)
class Revision:
    """name: for people; of git, "+" behind it where sources were changed since, else the version. digest: of all sources."""

    name: str
    digest: str

    def __str__(self) -> str:
        return self.name


@cache
def revision(root: Path = REPOSITORY) -> Revision:
    """That of the sources below `root` as they are now."""
    content = hashlib.sha256()
    for path in sorted(path for source in SOURCES for path in (root / source).rglob("*")):
        name = path.relative_to(root).as_posix()
        if path.suffix in SUFFIXES and not name.startswith(tuple(f"{part}/" for part in APART)) and path.is_file():
            content.update(f"{name}\n{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    digest = content.hexdigest()
    commit = _git(root, "rev-parse", "--short=10", "HEAD")
    if not commit:
        return Revision(f"{__version__}, sources {digest[:10]}", digest)
    changed = _git(root, "status", "--porcelain", "--", *SOURCES, *(f":!{part}" for part in APART))
    return Revision(f"{commit}+{digest[:10]}" if changed else commit, digest)


def _git(root: Path, *arguments: str) -> str:
    """What git says; nothing where there is no git, or `root` is not the top of a work tree of it."""
    if not (root / ".git").exists():
        return ""
    try:
        return subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
