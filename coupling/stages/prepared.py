"""The stages before loading: pack, initial stress, bonds. Each is a deck whose end state is kept for all runs with the same inputs."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coupling import __version__
from coupling.case.run_case import RunCase
from coupling.collective import on_first_ranks, raised_together
from coupling.engine.interface import Engine
from coupling.errors import InputError, of_file
from coupling.scene.walls import SCENE_WALLS, wall_positions
from coupling.signals import StopRequest
from coupling.stages.balance import settle
from coupling.stages.deck_variables import bond_variables, fault_geometry, loaded_areas, pack_variables, stress_variables
from coupling.stages.pack import write_grains
from coupling.stages.packing import RELEASE_DECK, Packing

RESTART, MANIFEST = "engine.restart", "manifest.json"
#: Balance that the initial stress ends with: mean unbalanced force over mean contact force.
BALANCED = 1e-3
#: What makes a pack beside its decks and inputs.
PACK_SOURCES = ("pack.py", "packing.py", "size_exchange.py", "balance.py")
PARTIAL_SUFFIX = ".partial"
#: An unfinished stage this old was left by a kill, s.
ABANDONED_AFTER_S = 86400.0


@dataclass(frozen=True)
class Stage:
    """The end of a stage: the engine's restart file, and what was measured of it."""

    restart: Path
    manifest: dict


def cache_directory() -> Path:
    """Where prepared stages are kept: the environment's PORESLIP_CACHE, else `poreslip` in the user's cache directory."""
    chosen = os.environ.get("PORESLIP_CACHE")
    if chosen:
        return Path(chosen).resolve()
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "poreslip"


def prepare(case: RunCase, comm, open_engine: Callable[[Any, Path], Engine], tell: Callable[[str], None]) -> Stage:
    """State from which the case is loaded: from the cache where its decks and inputs are the same, else made now by the first `pack.ranks` ranks, so
    that it is the same on any number of them. open_engine: of a communicator and the path of a log. Collective."""
    makers = [("pack", "in.pack", _make_pack), ("stress", _scene_deck("stress", case), _make_stress)]
    if case.bonded:
        makers.append(("bond", "in.bond", _make_bonds))
    stage: Stage | None = None
    for name, deck, make in makers:
        stage = _kept_or_made(name, Path(case.decks_directory) / deck, make, case, stage, comm, open_engine, tell)
    assert stage is not None
    return stage


def load_deck(case: RunCase) -> Path:
    """Deck of the loading stage."""
    return Path(case.decks_directory) / _scene_deck("load", case)


def load_deck_digest(case: RunCase) -> str:
    """Digest of the deck of the loading stage and of what it includes."""
    return hashlib.sha256(json.dumps(_texts([load_deck(case)]), sort_keys=True).encode()).hexdigest()


def results_variable(decks: list[Path], directory: Path) -> dict[str, object]:
    """The variable of decks that names the directory of their results, where they ask for it: a path with a blank is of no use to others."""
    return {"results": directory.resolve()} if any("${results}" in text for text in _texts(decks).values()) else {}


def _scene_deck(stage: str, case: RunCase) -> str:
    return f"in.{stage}" if case.scene == "two_sides" else f"in.{stage}_{case.scene}"


def _kept_or_made(name: str, deck: Path, make, case: RunCase, before: Stage | None, comm, open_engine, tell) -> Stage:
    key = _key(name, deck, case, before)
    directory = cache_directory() / f"{name}-{key[:20]}"
    found = comm.bcast(_read(directory) if comm.rank == 0 else None)
    if found is not None:
        return found
    if comm.size < case.pack.ranks:
        raise InputError(
            f"pack.ranks = {case.pack.ranks} (run {case.name}): the stage {name} of this pack is not kept in {cache_directory()} yet, and so many ranks make it; this run "
            f"has {comm.size}. Start it once with mpirun -n {case.pack.ranks}, or set pack.ranks = {comm.size}, which makes another pack.")
    return on_first_ranks(comm, case.pack.ranks, lambda makers: _made(name, deck, make, case, before, makers, open_engine, tell, directory, key))


def _made(name: str, deck: Path, make, case: RunCase, before: Stage | None, comm, open_engine, tell, directory: Path, key: str) -> Stage:
    """Make a stage on the ranks of `comm` and keep it."""
    work = None
    with raised_together(comm):
        if comm.rank == 0:
            work = _working_directory(name)
    work = Path(comm.bcast(work))
    try:
        with StopRequest() as stop:
            results = results_variable([deck, deck.with_name(RELEASE_DECK)] if name == "pack" else [deck], work)
            engine = open_engine(comm, work / "log.liggghts")
            engine.between_commands = stop.leave_if_received
            engine.define(results)
            manifest = make(case, engine, comm, deck, work, before, tell)
            engine.write_restart(work / RESTART)
            engine.close()
        comm.Barrier()
        with raised_together(comm):
            if comm.rank == 0:
                manifest |= {"key": key, "stage": name, "restart_sha256": _digest(work / RESTART)}
                with of_file(work / MANIFEST):
                    (work / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n")
                if _read(directory) is None:
                    shutil.rmtree(directory, ignore_errors=True)
                    os.replace(work, directory)
    finally:
        # Without a barrier: after an error the other ranks may be anywhere.
        if comm.rank == 0:
            shutil.rmtree(work, ignore_errors=True)
    made = comm.bcast(_read(directory) if comm.rank == 0 else None)
    if made is None:
        raise InputError(f"{directory} does not hold what was just written to it; see whether its disk is full, or set PORESLIP_CACHE to another directory")
    return made


def _working_directory(name: str) -> str:
    """A new directory for a stage in the making; what a kill left of such directories is removed."""
    cache = cache_directory()
    try:
        cache.mkdir(parents=True, exist_ok=True)
        for left in cache.glob(f"*{PARTIAL_SUFFIX}"):
            if time.time() - left.stat().st_mtime > ABANDONED_AFTER_S:
                shutil.rmtree(left, ignore_errors=True)
        return tempfile.mkdtemp(prefix=f"{name}-", suffix=PARTIAL_SUFFIX, dir=cache)
    except OSError as error:
        raise InputError(f"prepared stages cannot be kept in {cache} ({error.strerror}); set PORESLIP_CACHE to a directory that can be written") from None


def _read(directory: Path) -> Stage | None:
    """A kept stage, or None where there is none or its files are not what was written."""
    try:
        manifest = json.loads((directory / MANIFEST).read_text())
        whole = manifest["restart_sha256"] == _digest(directory / RESTART)
    except (OSError, ValueError, KeyError):
        return None
    return Stage(directory / RESTART, manifest) if whole else None


def _key(name: str, deck: Path, case: RunCase, before: Stage | None) -> str:
    """Digest of all that makes a stage: decks, inputs, and the stage before."""
    content = {
        "version": __version__,
        "stage": name,
        "before": before.manifest["key"] if before else None,
        "decks": _texts([deck, deck.with_name(RELEASE_DECK)] if name == "pack" else [deck]),
        "scene": case.scene,
        "pack": case.to_dict()["pack"],
        "bonded": case.bonded,
    }
    if name == "pack":
        content["sources"] = {source: (Path(__file__).parent / source).read_text() for source in PACK_SOURCES}
        variables = pack_variables(case, Path())
    else:
        variables = (stress_variables if name == "stress" else bond_variables)(case, before)
    # Paths differ between machines; how far bonds may stretch decides nothing before they are there.
    content["variables"] = {k: v for k, v in variables.items() if k not in ("inputs", "grains", "restart_in", "tangential")}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _texts(decks: list[Path]) -> dict[str, str]:
    """Texts of decks, and of every file that they may include, by name; those with a variable in their name by pattern."""
    found: dict[str, str] = {}
    waiting = list(decks)
    while waiting:
        path = waiting.pop()
        if path.name in found or not path.is_file():
            continue
        # A remark in a deck may be in any encoding.
        found[path.name] = path.read_text(encoding="utf-8", errors="surrogateescape")
        for name in re.findall(r"^include\s+\$\{inputs\}/(\S+)", found[path.name], flags=re.MULTILINE):
            waiting += sorted(decks[0].parent.glob(re.sub(r"\$\{\w+\}", "*", name)))
    return found


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _make_pack(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before, tell) -> dict:
    count = 0
    with raised_together(comm):
        if comm.rank == 0:
            with of_file(work / "grains.data"):
                count = write_grains(case.pack, work / "grains.data", case.periodic_z)
    count = comm.bcast(count)
    tell(f"packing {count} grains (once for all runs with this pack)")
    made = Packing(case, engine, comm, deck).make(work / "grains.data", count)
    tell(f"packed {made['grains']} grains ({made['floaters']} floaters removed) to porosity {made['porosity']:.4f}, "
         f"{made['porosity_bulk']:.4f} away from the walls; aim {case.pack.porosity:g}")
    return made


def _make_stress(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before: Stage, tell) -> dict:
    engine.deck(deck, stress_variables(case, before), before.manifest["grains"])
    packed = before.manifest["walls"]
    areas = loaded_areas(case, fault_geometry(case, packed, case.pack.box_m[2]))
    targets = {name: case.initial_stress_Pa * area for name, area in areas.items()}
    settle(engine, comm, "initial stress", lambda: targets, balanced=BALANCED, tolerance=case.pack.initial_stress_tolerance)
    return before.manifest | {"walls": wall_positions(engine, SCENE_WALLS[case.scene]), "geometry": packed}


def _make_bonds(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before: Stage, tell) -> dict:
    engine.deck(deck, bond_variables(case, before), before.manifest["grains"])
    bonds = comm.allreduce(engine.intact_bonds())
    tell(f"bonded {bonds} contacts in the blocks")
    return before.manifest | {"bonds": bonds}
