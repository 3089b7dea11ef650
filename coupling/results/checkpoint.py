"""Checkpoints: the engine's restart file and the driver's state in one directory, seen whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from pathlib import Path

import numpy as np

from coupling.case.run_case import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.errors import InputError, of_file

FORMAT = 5
PREFIX = "checkpoint-"
PARTIAL_PREFIX = "partial-"
ENGINE_FILE, STATE_FILE, FLOW_FILE = "engine.restart", "state.json", "flow.npz"
#: Checkpoints kept besides the newest, against damage to it.
KEPT_BEFORE = 1


def case_digest(case: RunCase) -> str:
    """Digest of every input that decides the trajectory; what is only written may change between a run and its restart."""
    content = {k: v for k, v in case.to_dict().items() if k not in ("output", "title", "case", "run", "group", "decks_directory")}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def write(directory: Path, engine: Engine, comm, state: dict, arrays: dict[str, np.ndarray]) -> Path:
    """Write a checkpoint of this step into ``directory``, then drop those that are no longer kept; the engine's file in it. Collective.

    arrays: of the flow, those of rank 0; no file is made where there are none.

    The new one is made under another name and renamed, so that a kill at any moment leaves the last whole one.
    """
    final = directory / f"{PREFIX}{engine.step:012d}"
    partial = directory / f"{PARTIAL_PREFIX}{final.name}"
    with raised_together(comm):
        if comm.rank == 0:
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
    comm.Barrier()
    engine.write_restart(partial / ENGINE_FILE)
    comm.Barrier()
    with raised_together(comm), of_file(final):
        if comm.rank == 0:
            restart = partial / ENGINE_FILE
            state = state | {"format": FORMAT, "engine_sha256": _digest(restart), "engine_bytes": restart.stat().st_size}
            if arrays:
                np.savez(partial / FLOW_FILE, **arrays)
                state["flow_sha256"] = _digest(partial / FLOW_FILE)
            text = json.dumps(state, indent=2)
            # The digest of the state stands in its last line, so that a torn state file is told too.
            (partial / STATE_FILE).write_text(json.dumps({"state": state, "sha256": hashlib.sha256(text.encode()).hexdigest()}, indent=2))
            for name in (ENGINE_FILE, STATE_FILE, *([FLOW_FILE] if arrays else [])):
                with open(partial / name, "rb") as file:
                    os.fsync(file.fileno())
            shutil.rmtree(final, ignore_errors=True)
            os.replace(partial, final)
            for old in all_in(directory)[: -1 - KEPT_BEFORE]:
                shutil.rmtree(old)
    return final / ENGINE_FILE


def all_in(directory: Path) -> list[Path]:
    """Checkpoints in a run's directory, oldest first."""
    return sorted(path for path in directory.glob(f"{PREFIX}*") if path.is_dir())


def remove_partial(directory: Path) -> None:
    """Remove what a kill left of checkpoints that were being written."""
    for partial in directory.glob(f"{PARTIAL_PREFIX}{PREFIX}*"):
        shutil.rmtree(partial)


def read(directory: Path, case: RunCase) -> tuple[Path, dict]:
    """Newest checkpoint of a run: the engine's restart file and the driver's state, checked.

    Raises InputError where there is none, where it is damaged, or where it belongs to another case.
    """
    if not directory.is_dir():
        raise InputError(f"--restart {directory}: no such directory; give the directory of a run, such as out/quick/case1")
    found = all_in(directory)
    if not found:
        raise InputError(
            f"--restart {directory}: it holds no checkpoint. A run writes them with --checkpoint-every STEPS or "
            "output.checkpoint_every_steps; without one, run the case from its start")
    newest = found[-1]
    advice = f"remove {newest} to restart from the one before it" if len(found) > 1 else "run the case from its start"
    try:
        content = json.loads((newest / STATE_FILE).read_text())
        state = content["state"]
        intact = hashlib.sha256(json.dumps(state, indent=2).encode()).hexdigest() == content["sha256"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{newest / STATE_FILE} cannot be read as a checkpoint's state ({error}); {advice}") from None
    if not intact:
        raise InputError(f"{newest / STATE_FILE} was changed or damaged since it was written; {advice}")
    if state.get("format") != FORMAT:
        raise InputError(f"{newest}: checkpoint format {state.get('format')}, this poreslip reads {FORMAT}; run the case from its start")
    if state["case_sha256"] != case_digest(case):
        raise InputError(
            f"{newest} was written by a run with other inputs than this case; they are listed in {directory / 'case.json'}. Restart with the same "
            "case file and --set values, or run the changed case from its start into another --out")
    restart = newest / ENGINE_FILE
    size = restart.stat().st_size if restart.is_file() else 0
    if size != state["engine_bytes"]:
        raise InputError(f"{restart} has {size} bytes instead of {state['engine_bytes']}: it is truncated or missing; {advice}")
    if _digest(restart) != state["engine_sha256"]:
        raise InputError(f"{restart} is damaged: its content is not what was written; {advice}")
    flow = newest / FLOW_FILE
    if "flow_sha256" in state and not (flow.is_file() and _digest(flow) == state["flow_sha256"]):
        raise InputError(f"{flow} is missing or damaged: its content is not what was written; {advice}")
    return restart, state


def flow_arrays(restart: Path) -> dict[str, np.ndarray]:
    """The flow's arrays beside the engine's restart file of a checkpoint; empty where there are none."""
    path = restart.with_name(FLOW_FILE)
    if not path.is_file():
        return {}
    with np.load(path) as file:
        return dict(file)


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
