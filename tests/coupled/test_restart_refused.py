"""What is no checkpoint of the run that is asked for is refused with one message that says what to do, and nothing is computed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from processes import the_message
from tiny_fault import TINY

NEWEST = "checkpoint-000000000300"


@pytest.fixture(scope="module")
def finished(poreslip, stage_cache, tmp_path_factory) -> Path:
    """Output directory of a finished run with two checkpoints."""
    directory = tmp_path_factory.mktemp("finished")
    (directory / "tiny.toml").write_text(TINY)
    command = ["run", directory / "tiny.toml", "--only", "dry", "--out", directory / "out", "--checkpoint-every", "100"]
    done = poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0, done.stderr
    return directory / "out"


@pytest.fixture
def kept(finished, tmp_path) -> Path:
    """A copy of its results, to be damaged."""
    return shutil.copytree(finished, tmp_path / "out") / "tiny" / "dry"


def truncate_engine(run: Path) -> None:
    file = run / NEWEST / "engine.restart"
    file.write_bytes(file.read_bytes()[:-100])


def damage_engine(run: Path) -> None:
    file = run / NEWEST / "engine.restart"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def remove_engine(run: Path) -> None:
    (run / NEWEST / "engine.restart").unlink()


def truncate_state(run: Path) -> None:
    file = run / NEWEST / "state.json"
    file.write_text(file.read_text()[:-50])


def edit_state(run: Path) -> None:
    file = run / NEWEST / "state.json"
    content = json.loads(file.read_text())
    content["state"]["reference"]["length"] *= 1.01
    file.write_text(json.dumps(content))


def empty_state(run: Path) -> None:
    (run / NEWEST / "state.json").write_text("[]")


def other_case(run: Path) -> None:
    file = run / "case.json"
    content = json.loads(file.read_text())
    content["material"]["friction"] = 0.3
    file.write_text(json.dumps(content))


def shorter_history(run: Path) -> None:
    file = run / "history.csv"
    file.write_bytes(file.read_bytes()[:200])


def no_bond_table(run: Path) -> None:
    (run / "bonds.csv").unlink()


def no_checkpoints(run: Path) -> None:
    for checkpoint in run.glob("checkpoint-*"):
        shutil.rmtree(checkpoint)


def no_directory(run: Path) -> None:
    shutil.rmtree(run)


def empty_directory(run: Path) -> None:
    shutil.rmtree(run)
    run.mkdir()


OLDER = "remove {newest} to restart from the one before it"
DAMAGE = {
    truncate_engine: ("is truncated or missing", OLDER),
    damage_engine: ("is damaged: its content is not what was written", OLDER),
    remove_engine: ("has 0 bytes", OLDER),
    truncate_state: ("cannot be read as a checkpoint's state", OLDER),
    edit_state: ("was changed or damaged since it was written", OLDER),
    empty_state: ("cannot be read as a checkpoint's state", OLDER),
    other_case: ("written by a run with other inputs", "another --out"),
    shorter_history: ("history.csv is shorter than when the checkpoint was written", "run the case from its start"),
    no_bond_table: ("bonds.csv is shorter than when the checkpoint was written", "run the case from its start"),
    no_checkpoints: ("it holds no checkpoint", "--checkpoint-every STEPS"),
    no_directory: ("there is no case.json in it", "give the directory of one run"),
    empty_directory: ("there is no case.json in it", "give the directory of one run"),
}


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda damage: damage.__name__)
def test_refused(kept, poreslip, damage):
    damage(kept)
    before = (kept / "history.csv").read_bytes() if (kept / "history.csv").is_file() else None
    message = the_message(poreslip("run", "--restart", kept), 2)
    for part in DAMAGE[damage]:
        assert part.format(newest=kept / NEWEST) in message
    if before is not None:
        assert (kept / "history.csv").read_bytes() == before


@pytest.mark.parallel
@pytest.mark.parametrize("damage", [truncate_engine, edit_state, shorter_history, no_checkpoints], ids=lambda damage: damage.__name__)
def test_refused_on_two_ranks(kept, poreslip, damage):
    damage(kept)
    message = the_message(poreslip("run", "--restart", kept, ranks=2, timeout=40), 2)
    assert DAMAGE[damage][0] in message


def test_a_damaged_checkpoint_taken_away_the_older_one_serves(kept, poreslip):
    truncate_engine(kept)
    shutil.rmtree(kept / NEWEST)
    assert poreslip("run", "--restart", kept).returncode == 0


def test_a_parent_directory_names_the_runs_below(kept, poreslip):
    assert f"runs found below it: {kept}" in the_message(poreslip("run", "--restart", kept.parent), 2)


@pytest.mark.parametrize("option", [("--out", "x"), ("--only", "dry"), ("--set", "pack.seed=2")], ids=" ".join)
def test_inputs_cannot_be_changed(kept, poreslip, option):
    assert "--restart continues a run as it was started" in the_message(poreslip("run", "--restart", kept, *option), 2)
