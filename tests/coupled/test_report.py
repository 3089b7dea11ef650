"""What a run tells of itself: how quasi-static it was, warnings once, and every run of a case file as if it were alone."""

from __future__ import annotations

import json

import pytest
from processes import the_message
from tiny_fault import history, settings

#: Compressed at a few per cent of the tiny fault's own rate, over a small strain.
SLOW = ("loading.horizontal_strain=2e-5", "loading.strain_rate_per_s=0.2")


@pytest.fixture
def start(poreslip, tiny_case, tmp_path, stage_cache):
    """`start(*arguments, ranks=1)`: run the case file; what was printed."""

    def run(*arguments: str, ranks: int = 1):
        return poreslip("run", tiny_case, "--out", tmp_path / "out", *arguments, ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})

    return run


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_too_fast_a_run_warns_once(start, tmp_path, ranks):
    done = start("--only", "wet", *settings("loading.strain_rate_per_s=50.0", "flow.interval_steps=1", "output.history_interval_steps=1"), ranks=ranks)
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "tiny" / "wet" / "report.json").read_text())
    assert len(report["warnings"]) >= 2
    for warning in report["warnings"]:
        assert done.stdout.count(f"wet  warning: {warning}") == 1
        assert "lower loading.strain_rate_per_s" in warning
    page = (tmp_path / "out" / "tiny" / "wet" / "report.md").read_text()
    assert page.count("**Warning**") == len(report["warnings"])


def test_a_slow_run_is_quasi_static(start, tmp_path):
    done = start("--only", "dry", *settings(*SLOW, "bonds.strength_mean_Pa=1e9"))
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stdout
    run = tmp_path / "out" / "tiny" / "dry"
    report = json.loads((run / "report.json").read_text())
    assert report["warnings"] == []
    checks = report["quasi_static_checks"]
    assert 0.0 < checks["unbalanced_force_ratio"] < 2e-2
    assert 0.0 < checks["wall_stress_difference"] < 2e-2
    assert 0.0 < checks["inertial_number"] < 1e-3
    assert 0.0 < checks["overlap_max_over_d"] < 1e-2
    # The worst of the run stand in the report, and the last line of the history.
    rows = history(run)
    assert checks["unbalanced_force_ratio"] == pytest.approx(rows["unbalanced_force_ratio"].max(), rel=1e-9)
    assert report["last"]["strain"] == pytest.approx(rows["strain"][-1], rel=1e-9)
    assert report["complete"] is True and report["ended"] == "the end of loading"


def test_runs_of_a_case_do_not_know_each_other(start, run_fault, tmp_path):
    """Both runs in one process write what each writes alone."""
    assert start().returncode == 0
    for name in ("wet", "dry"):
        alone = run_fault(run=name, out=f"{name}-alone")
        for table in ("history.csv", "bonds.csv"):
            assert (alone / table).read_bytes() == (tmp_path / "out" / "tiny" / name / table).read_bytes(), (name, table)
    runs = json.loads((tmp_path / "out" / "tiny" / "runs.json").read_text())
    assert runs["runs"] == ["wet", "dry"]


def test_every_input_stands_in_the_results(run_fault):
    case = json.loads((run_fault(run="dry") / "case.json").read_text())
    assert case["pack"]["seed"] == 1 and case["material"]["local_damping"] == 0.2 and case["decks_directory"].endswith("liggghts-inputs")


def test_a_run_that_fails_leaves_its_tables(start, tmp_path):
    """The pressure is not a number from the middle of the loading to near its end."""
    formula = "where((strain > 1e-4) & (strain < 1.8e-4), sqrt(s - 1), 1e6)"
    done = start("--only", "wet", *settings("pressure.mode=expression", f"pressure.expression={formula}"))
    the_message(done, 3)
    rows = history(tmp_path / "out" / "tiny" / "wet")
    assert rows["strain"][-1] > 8e-5
    assert (tmp_path / "out" / "tiny" / "wet" / "history.csv").read_bytes().endswith(b"\n")


def test_blocks_that_part_end_the_run(run_fault):
    run = run_fault("loading.stop_vertical_strain=1e-3")
    report = json.loads((run / "report.json").read_text())
    assert report["complete"] is True and "the blocks part" in report["ended"]
    rows = history(run)
    assert (rows["vertical_strain"][:-1] < 1e-3).all() and rows["vertical_strain"][-1] >= 1e-3
