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

import numpy as np

from coupling import __version__
from coupling.case_schema import RunCase
from coupling.collective import raised_together
from coupling.deck_variables import bond_variables, fault_geometry, pack_variables, plate_areas, stress_variables
from coupling.engine.interface import Engine
from coupling.errors import ComputationError, InputError
from coupling.pack import write_grains
from coupling.packing import exchange_sizes
from coupling.walls import PACK, SCENE_WALLS, wall_positions

RESTART, MANIFEST = "engine.restart", "manifest.json"
#: Balance that a stage ends with, mean unbalanced force over mean contact force, and how far the walls' forces may be from their
#: targets then. A pack without friction creeps on under the least difference of its stresses, so it is left to the next stage,
#: which has friction, to settle it strictly.
PACK_BALANCED, PACK_WALL_TOLERANCE = 2e-2, 5e-2
STRESS_BALANCED, STRESS_WALL_TOLERANCE = 1e-3, 2e-3
#: Steps between two looks at it, and how many looks before the stage is given up.
SETTLE_STEPS, SETTLE_LOOKS = 1000, 60
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


def prepare(case: RunCase, comm, open_engine: Callable[[Path], Engine], tell: Callable[[str], None]) -> Stage:
    """State from which the case is loaded: from the cache where its decks and inputs are the same, else made now; collective."""
    makers = [("pack", "in.pack", _make_pack), ("stress", _scene_deck("stress", case), _make_stress)]
    if case.bonds.enabled:
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


def _scene_deck(stage: str, case: RunCase) -> str:
    return f"in.{stage}" if case.scene == "two_sides" else f"in.{stage}_{case.scene}"


def _kept_or_made(name: str, deck: Path, make, case: RunCase, before: Stage | None, comm, open_engine, tell) -> Stage:
    key = _key(name, deck, case, before)
    directory = cache_directory() / f"{name}-{key[:20]}"
    found = comm.bcast(_read(directory) if comm.rank == 0 else None)
    if found is not None:
        return found
    work = None
    with raised_together(comm):
        if comm.rank == 0:
            work = _working_directory(name)
    work = Path(comm.bcast(work))
    try:
        engine = open_engine(work / "log.liggghts")
        manifest = make(case, engine, comm, deck, work, before, tell)
        engine.write_restart(work / RESTART)
        engine.close()
        comm.Barrier()
        with raised_together(comm):
            if comm.rank == 0:
                manifest |= {"key": key, "stage": name, "restart_sha256": _digest(work / RESTART)}
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
        "decks": _texts([deck, deck.with_name("in.pack_release")] if name == "pack" else [deck]),
        "scene": case.scene,
        "pack": case.to_dict()["pack"],
        "material": {k: v for k, v in case.to_dict()["material"].items() if k != "local_damping"},
    }
    if name != "pack":
        content |= {"fault": case.to_dict()["fault"], "initial_stress": case.initial_stress_Pa}
    if name == "bond" or case.bonds.enabled:
        content |= {"bonds": case.to_dict()["bonds"] if name == "bond" else True}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _texts(decks: list[Path]) -> dict[str, str]:
    """Texts of decks, and of every file that they may include, by name; those with a variable in their name by pattern."""
    found: dict[str, str] = {}
    waiting = list(decks)
    while waiting:
        path = waiting.pop()
        if path.name in found or not path.is_file():
            continue
        found[path.name] = path.read_text()
        for name in re.findall(r"^include\s+\$\{inputs\}/(\S+)", found[path.name], flags=re.MULTILINE):
            waiting += sorted(decks[0].parent.glob(re.sub(r"\$\{\w+\}", "*", name)))
    return found


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _make_pack(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before, tell) -> dict:
    periodic_z = case.scene == "supplement"
    count = 0
    with raised_together(comm):
        if comm.rank == 0:
            count = write_grains(case.pack, work / "grains.data", periodic_z)
    count = comm.bcast(count)
    tell(f"packing about {case.estimated_grains} grains (once for all runs with this pack)")
    engine.deck(deck, pack_variables(case, work / "grains.data"), grains=count)
    first, last, closed, release, steps = (_deck_number(engine, name) for name in (
        "exchange_first", "exchange_last", "closed_rounds", "release_rounds", "exchange_steps"))  # fmt: skip
    names = [n for n in PACK if not (periodic_z and n.startswith("z_"))]

    def size() -> list[float]:
        at = wall_positions(engine, names)
        height = case.pack.box_m[2] if periodic_z else at["z_top"] - at["z_bottom"]
        return [at["x_right"] - at["x_left"], at["y_back"] - at["y_front"], height]

    def target_forces() -> dict[str, float]:
        length, depth, height = size()
        area = {"x": depth * height, "y": length * height, "z": length * depth}
        return {name: case.pack.confining_stress_Pa * area[name[0]] for name in names}

    for step in np.geomspace(first, last, int(closed)):
        exchange_sizes(engine, comm, names, step)
        engine.run(int(steps), setup=True)
    engine.deck(deck.with_name("in.pack_release"), {}, grains=count)
    for _ in range(int(release)):
        exchange_sizes(engine, comm, names, last)
        engine.run(int(steps), setup=True)
    _settle(engine, comm, "pack", target_forces, PACK_BALANCED, PACK_WALL_TOLERANCE)
    floaters = _delete_floaters(engine, comm)
    _settle(engine, comm, "pack", target_forces, PACK_BALANCED, PACK_WALL_TOLERANCE)
    volume = comm.allreduce(float((4.0 / 3.0 * np.pi * engine.atom("radius") ** 3).sum()))
    measured = {"grains": engine.total_grains, "floaters": floaters, "walls": wall_positions(engine, names), "size_m": size(),
                "porosity": 1.0 - volume / float(np.prod(size()))}
    tell(f"packed {measured['grains']} grains ({floaters} floaters removed) to porosity {measured['porosity']:.4f}")
    return measured


def _make_stress(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before: Stage, tell) -> dict:
    engine.deck(deck, stress_variables(case, before), before.manifest["grains"])
    packed = before.manifest["walls"]
    fault = fault_geometry(case, packed, case.pack.box_m[2])
    areas = plate_areas(case, fault) | {"x_left": fault.x_wall_area, "x_right": fault.x_wall_area}
    _settle(engine, comm, "initial stress", lambda: {name: case.initial_stress_Pa * area for name, area in areas.items()}, STRESS_BALANCED,
            STRESS_WALL_TOLERANCE)
    return before.manifest | {"walls": wall_positions(engine, SCENE_WALLS[case.scene]), "geometry": packed}


def _make_bonds(case: RunCase, engine: Engine, comm, deck: Path, work: Path, before: Stage, tell) -> dict:
    engine.deck(deck, bond_variables(case, before), before.manifest["grains"])
    bonds = comm.allreduce(engine.intact_bonds())
    tell(f"bonded {bonds} contacts in the blocks")
    return before.manifest | {"bonds": bonds}


def _settle(engine: Engine, comm, what: str, target_forces: Callable[[], dict[str, float]], balanced: float, tolerance: float) -> None:
    """Make steps until the forces balance and the walls bear their target forces, N by fix id."""
    ratio = worst = float("inf")
    for _ in range(SETTLE_LOOKS):
        ratio = unbalanced_force_ratio(engine, comm)
        worst = max(abs(engine.wall(name).contact_force / target - 1.0) for name, target in target_forces().items())
        if ratio < balanced and worst < tolerance:
            return
        engine.run(SETTLE_STEPS, setup=True)
    raise ComputationError(
        f"the {what} does not come to rest in {SETTLE_LOOKS * SETTLE_STEPS} more steps: unbalanced-force ratio {ratio:.2e}, wanted {balanced:g}, and "
        f"wall forces off by {worst:.2e}, wanted {tolerance:g}. More drag or more steps in its deck (pack.deck_variables) or a shorter "
        "loading.time_step_fraction help")


def unbalanced_force_ratio(engine: Engine, comm) -> float:
    """Mean resultant force on a grain that is in contact, over the mean normal force of the contacts."""
    contacts = engine.contacts()
    touching = np.isin(engine.atom("id"), _ids_in_contact(contacts.id, comm))
    sums = np.array([
        np.linalg.norm(engine.atom("f")[touching], axis=1).sum(), touching.sum(), contacts.normal_force.sum(), len(contacts),
    ], dtype=float)  # fmt: skip
    force, grains, normal, count = comm.allreduce(sums)
    return float(force / max(grains, 1) / (normal / max(count, 1))) if normal > 0 else float("inf")


def _ids_in_contact(pairs: np.ndarray, comm) -> np.ndarray:
    """Ids of the grains of all ranks that touch another grain."""
    return np.unique(np.concatenate(comm.allgather(np.unique(pairs))))


def _deck_number(engine: Engine, name: str) -> float:
    """Value of a `variable ... index` line of the deck."""
    engine.command(f"variable driver_reads equal ${{{name}}}")
    return engine.variable("driver_reads")


def _delete_floaters(engine: Engine, comm) -> int:
    """Delete the grains without a contact; return their number."""
    floating = ~np.isin(engine.atom("id"), _ids_in_contact(engine.contacts().id, comm))
    count = comm.allreduce(int(floating.sum()))
    if count:
        engine.atom("type")[floating] = 3
        engine.command("group floaters type 3")
        engine.delete_group("floaters")
        engine.command("group floaters delete")
        engine.run(0, setup=True)
    return count
