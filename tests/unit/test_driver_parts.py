"""Parts of the driver that need no engine: what a checkpoint's digest covers, files replaced in one step, times, the progress line."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from tiny_fault import TINY

from coupling.case.files import load_case
from coupling.errors import of_file
from coupling.results.checkpoint import all_in, case_digest, remove_partial
from coupling.results.output import write_atomically
from coupling.results.phases import Phases
from coupling.results.progress import Progress


@pytest.fixture
def digest(tmp_path):
    """`digest(*overrides)`: of the tiny fault's wet run."""
    (tmp_path / "tiny.toml").write_text(TINY)
    return lambda *overrides: case_digest(load_case(tmp_path / "tiny.toml", overrides).runs[0])


def test_digest_leaves_out_what_is_only_written(digest, tmp_path):
    (tmp_path / "decks").mkdir()
    written = ("output.snapshots=3", "output.checkpoint_every_steps=100", "title=another", f"decks_directory={tmp_path}/decks")
    assert {digest(override) for override in written} == {digest()}


@pytest.mark.parametrize(
    "override",
    ["pack.seed=2", "material.friction=0.4", "bonds.shear_ratio=0.9", "fault.end_band_m=1e-3", "loading.stop_vertical_strain=0.03",
     "pressure.right_target_Pa=1.0", "flow.forces=pressure", "flow.interval_steps=5", "loading.deck_variables.wall_speed_limit=1.0"],
)  # fmt: skip
def test_digest_covers_every_input(digest, override):
    assert digest(override) != digest()


def test_files_are_replaced_in_one_step(tmp_path):
    path = tmp_path / "report.json"
    write_atomically(path, "old\n")
    write_atomically(path, "new\n")
    assert path.read_text() == "new\n"
    assert [left.name for left in tmp_path.iterdir()] == ["report.json"]


def test_partial_checkpoints_are_none(tmp_path):
    for name in ("checkpoint-000000000100", "checkpoint-000000000020", "partial-checkpoint-000000000200"):
        (tmp_path / name).mkdir()
    (tmp_path / "checkpoint-000000000300").write_text("a file")
    assert [path.name for path in all_in(tmp_path)] == ["checkpoint-000000000020", "checkpoint-000000000100"]
    remove_partial(tmp_path)
    assert not (tmp_path / "partial-checkpoint-000000000200").exists()


def test_phases_add_up():
    phases = Phases()
    for _ in range(2):
        with phases.timed("engine"):
            time.sleep(0.01)
    spent = phases.to_dict()["engine"]
    assert spent["calls"] == 2 and spent["wall_s"] >= 0.02 and spent["cpu_s"] < 0.02


def test_progress_writes_a_line_every_tenth(capsys):
    progress = Progress("case1", shown=True)
    for step in range(1, 101):
        progress.show(step / 100, "strain")
    progress.finish("the end")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert lines[0].startswith("case1   10.0 %") and lines[9].startswith("case1  100.0 %") and lines[9].endswith("00:00 left")


def test_progress_of_other_ranks_is_silent(capsys):
    progress = Progress("case1", shown=False)
    progress.show(1.0, "strain")
    progress.finish("the end")
    assert capsys.readouterr().out == ""


def test_a_full_disk_names_the_file():
    """What the system says of a write names none."""
    with pytest.raises(OSError, match=r"No space left on device: '/dev/full'"), of_file(Path("/dev/full")), open("/dev/full", "w") as file:
        file.write("a line")
        file.flush()
