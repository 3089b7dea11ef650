"""The command `poreslip stability`: every scene in a process of its own, which may crash or hang, and the table of what came of them."""

from __future__ import annotations

import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path

from coupling.errors import InputError
from coupling.results.output import write_atomically
from coupling.stability.program_run import RANKS, in_time
from coupling.stability.scene import FAILED, Outcome, Scene
from coupling.stability.table import Line, write
from coupling.study.revision import revision
from coupling.study.runner import on_ranks

#: A scene that takes longer hangs, s: they take seconds, of two cores that others use too.
PATIENCE_S = 600.0
OUTCOME = "outcome.json"


def all_scenes() -> list[Scene]:
    """All scenes in the order of the table."""
    from coupling.stability import coupling_scenes, flow_scenes, grain_limits, grain_scenes

    return [scene for part in (grain_limits, grain_scenes, flow_scenes, coupling_scenes) for scene in part.scenes()]


def chosen(patterns: list[str], quick: bool) -> list[Scene]:
    """Scenes whose names, or beginnings of them, match any of the patterns (as in a shell), or all; `quick`: of these, those of a second or two."""
    scenes = all_scenes()

    def named(scene: Scene, pattern: str) -> bool:
        return fnmatch(scene.name, pattern) or fnmatch(scene.name, pattern.rstrip("/") + "/*")

    for pattern in patterns:
        if not any(named(scene, pattern) for scene in scenes):
            groups = sorted({scene.name.rsplit("/", 1)[0] for scene in scenes})
            raise InputError(f"--only {pattern}: no scene has such a name. `poreslip stability --list` shows them all; they begin with {', '.join(groups)}.")
    return [scene for scene in scenes if (not patterns or any(named(scene, pattern) for pattern in patterns)) and (scene.quick or not quick)]


def stability(patterns: list[str], directory: Path, jobs: int, quick: bool, ranks: int) -> int:
    """Carry out scenes, print a line of each, write the table; 0, or 3 if any ended in another way than it may. ranks: of what can be spread."""
    scenes = chosen(patterns, quick)
    directory.mkdir(parents=True, exist_ok=True)
    # Of the code as it is now: it may be edited while scenes are carried out.
    revision()
    started = time.perf_counter()
    lines: list[Line] = []
    with ThreadPoolExecutor(jobs) as pool:
        for scene, (outcome, seconds) in zip(scenes, pool.map(lambda one: _apart(one, directory / "scenes" / one.name.replace("/", "-"), ranks), scenes)):
            lines.append(Line(scene.name, scene.what, scene.expected, outcome, seconds))
            limit = f"; found {outcome.found:.3g}, predicted {outcome.predicted:.3g} {outcome.unit}" if outcome.found is not None else ""
            print(f"{'' if lines[-1].as_it_may else 'NOT AS IT MAY: '}{scene.name}  {outcome.ended}{limit}  {outcome.figure[:150]}", flush=True)
    write(lines, directory, ranks)
    wrong = [line.name for line in lines if not line.as_it_may]
    print(f"{len(lines)} scenes in {time.perf_counter() - started:.0f} s, {len(wrong)} not as they may end; {directory}/stability.md")
    return 3 if wrong else 0


def _apart(scene: Scene, directory: Path, ranks: int) -> tuple[Outcome, float]:
    """Carry out one scene in a process of its own, or several; its wall seconds."""
    started = time.perf_counter()
    directory.mkdir(parents=True, exist_ok=True)
    (directory / OUTCOME).unlink(missing_ok=True)
    launch = on_ranks(ranks) if scene.spread else []
    status, said = in_time([*launch, sys.executable, "-m", "coupling.stability", scene.name, str(directory)], PATIENCE_S, {RANKS: str(ranks)})
    seconds = time.perf_counter() - started
    try:
        return Outcome(**json.loads((directory / OUTCOME).read_text())), seconds
    except (OSError, ValueError):
        how = "hung" if status is None else f"signal {-status}" if status < 0 else f"exit status {status}"
        return Outcome(FAILED, f"{how}: {' '.join(said.split())[-200:]}"), seconds


def one(name: str, directory: Path) -> None:
    """Carry out the scene of this name here, on all ranks of this process, and leave its outcome in the directory."""
    scene = next(scene for scene in all_scenes() if scene.name == name)
    outcome = scene.act(directory)
    if int(os.environ.get("OMPI_COMM_WORLD_RANK", "0")) == 0:
        write_atomically(directory / OUTCOME, json.dumps(asdict(outcome)))
