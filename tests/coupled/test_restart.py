"""A run that goes on from a checkpoint follows the trajectory of the run that was never interrupted, to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tiny_fault import broken_bonds, history, last_grains

EVERY = ("--checkpoint-every", "100")
SNAPSHOTS = "output.snapshots=2"


def checkpoints(run: Path) -> list[str]:
    return sorted(path.name for path in run.glob("checkpoint-*"))


def restarted_from_the_older(poreslip, run: Path, ranks: int, **keys) -> Path:
    """Take the newest checkpoint away and continue from the one before it; the directory of the uninterrupted run, put aside."""
    aside = run.with_name("uninterrupted")
    shutil.copytree(run, aside)
    assert checkpoints(run) == ["checkpoint-000000000200", "checkpoint-000000000300"]
    shutil.rmtree(run / "checkpoint-000000000300")
    done = poreslip("run", "--restart", run, ranks=ranks, **keys)
    assert done.returncode == 0, done.stderr
    return aside


def assert_same_bits(one: Path, other: Path) -> None:
    tables = sorted(path.name for path in one.glob("*.csv"))
    assert tables == sorted(path.name for path in other.glob("*.csv")) and "history.csv" in tables
    for table in tables:
        assert (one / table).read_bytes() == (other / table).read_bytes(), table
    a, b = last_grains(one), last_grains(other)
    assert set(a) == set(b)
    for name in a:
        assert a[name].tobytes() == b[name].tobytes(), name
    assert checkpoints(one) == checkpoints(other)


def assert_counts_of_the_whole_run(uninterrupted: Path, restarted: Path, account: dict) -> None:
    """Reports tell the same steps and counts, and the restarted one no less time than its checkpoint."""
    one, other = (json.loads((run / "report.json").read_text()) for run in (uninterrupted, restarted))
    assert (one["restarted_at_steps"], other["restarted_at_steps"]) == ([], [200])
    assert one.keys() == other.keys()
    for name in {"steps", "solver", "remeshes", "bonds_broken", "wall_speed_limited_steps", "quasi_static_checks", "balances"} & one.keys():
        assert one[name] == other[name], name
    for parts, before in zip(other["cpu_s_by_phase_and_rank"], account["by_rank"], strict=True):
        assert all(parts[name][count] >= before[name][count] for name in before for count in ("cpu_s", "wall_s", "calls"))
        assert parts["engine"]["calls"] > before["engine"]["calls"] > 0
    assert other["wall_s"] > account["wall_s"] > 0.0
    assert other["grain_steps_per_cpu_s"] == pytest.approx(other["steps"] * other["grains"] / other["loading_cpu_s"])
    page = (restarted / "report.md").read_text()
    assert "Restarted from a checkpoint once, at step 200" in page and "Restarted" not in (uninterrupted / "report.md").read_text()


def account_of(run: Path, step: int) -> dict:
    return json.loads((run / f"checkpoint-{step:012d}" / "state.json").read_text())["state"]["phases"]


@pytest.mark.parametrize("run", ["wet", "dry"])
@pytest.mark.parametrize("bonds", ["true", "false"])
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_same_trajectory(run_fault, poreslip, ranks, bonds, run):
    result = run_fault(f"bonds.enabled={bonds}", SNAPSHOTS, run=run, ranks=ranks, options=EVERY)
    # Without the cache: a checkpoint holds all that a run needs to go on.
    aside = restarted_from_the_older(poreslip, result, ranks, env={"PORESLIP_CACHE": "/dev/null"})
    assert_same_bits(aside, result)
    assert_counts_of_the_whole_run(aside, result, account_of(result, 200))
    assert (result / "bonds.csv").exists() == (bonds == "true")
    if bonds == "true":
        assert len([row for row in broken_bonds(result) if int(row["step"]) > 200]) > 20
    assert (result / "log.liggghts").is_file() and (result / "log-from-200.liggghts").is_file()


def test_checkpoints_between_lines_of_the_history(run_fault, poreslip):
    """Bonds broken since the last line are neither lost nor told twice."""
    result = run_fault(options=("--checkpoint-every", "110"))
    aside = result.with_name("uninterrupted")
    shutil.copytree(result, aside)
    assert checkpoints(result)[-1] == "checkpoint-000000000330"
    between = [row for row in broken_bonds(result) if 320 < int(row["step"]) <= 330]
    assert between
    done = poreslip("run", "--restart", result)
    assert done.returncode == 0, done.stderr
    for table in ("history.csv", "bonds.csv"):
        assert (aside / table).read_bytes() == (result / table).read_bytes(), table


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_upright_fault(run_fault, poreslip, upright_case, ranks):
    result = run_fault(SNAPSHOTS, case=upright_case, ranks=ranks, options=EVERY)
    assert_same_bits(restarted_from_the_older(poreslip, result, ranks), result)


def test_addforce_too(run_fault, poreslip):
    result = run_fault("flow.pore_force=addforce", SNAPSHOTS, options=EVERY)
    assert_same_bits(restarted_from_the_older(poreslip, result, 1), result)


def test_a_checkpoint_changes_only_rounding(run_fault):
    # Without damping, which takes the velocities of half a step earlier in a step than in a setup.
    elastic = ("material.restitution=1.0", "material.local_damping=0.0", "bonds.strength_mean_Pa=1e9")
    without = history(run_fault(*elastic, "output.snapshots=3", out="without"))
    written = history(run_fault(*elastic, out="with", options=EVERY))
    for name in ("sigma_n_Pa", "contact_force_max_N", "kinetic_energy_J"):
        np.testing.assert_allclose(written[name], without[name], rtol=1e-7, err_msg=name)


@pytest.mark.parallel
def test_other_number_of_ranks_is_told(run_fault, poreslip):
    result = run_fault(options=EVERY)
    before = history(result)
    shutil.rmtree(result / "checkpoint-000000000300")
    done = poreslip("run", "--restart", result, ranks=2)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("checkpoint is of 1 ranks and goes on with 2") == 1
    np.testing.assert_array_equal(history(result)["bonds_intact"], before["bonds_intact"])
    np.testing.assert_allclose(history(result)["sigma_n_Pa"], before["sigma_n_Pa"], rtol=1e-6)


def test_changed_loading_deck_is_told(run_fault, poreslip, own_decks):
    result = run_fault(f"decks_directory={own_decks}", options=EVERY)
    with open(own_decks / "in.load", "a") as deck:
        deck.write("compute ke_rotational all erotate/sphere\n")
    done = poreslip("run", "--restart", result)
    assert done.returncode == 0, done.stderr
    assert "the loading deck was changed since the checkpoint was written" in done.stdout


def test_rows_past_the_checkpoint_and_a_torn_line_are_cut(run_fault, poreslip):
    result = run_fault(SNAPSHOTS, options=EVERY)
    aside = result.with_name("uninterrupted")
    shutil.copytree(result, aside)
    with open(result / "history.csv", "a") as table:
        table.write("340,1.2e-05,3e-5\n360,1.3e-0")
    with open(result / "bonds.csv", "a") as table:
        table.write("340,0.0")
    (result / "partial-checkpoint-000000000400").mkdir()
    (result / "partial-checkpoint-000000000400" / "engine.restart").write_bytes(b"torn")
    done = poreslip("run", "--restart", result)
    assert done.returncode == 0, done.stderr
    assert_same_bits(aside, result)
    assert not list(result.glob("partial-*"))


def test_a_new_run_removes_what_a_former_one_left(run_fault):
    result = run_fault(SNAPSHOTS, run="dry", options=EVERY)
    assert checkpoints(result) and (result / "snapshots").is_dir()
    (result / "notes.txt").write_text("of the user")
    assert run_fault(run="dry") == result
    assert not checkpoints(result) and not (result / "snapshots").exists()
    assert (result / "notes.txt").is_file()
    assert json.loads((result / "report.json").read_text())["steps"] == 396
