"""What a run tells of itself: how quasi-static it was, warnings once, and every run of a case file as if it were alone."""

from __future__ import annotations

import json

import numpy as np
import pytest
from processes import the_message
from sample_runs import SQUEEZE
from tiny_fault import history, settings

from coupling.stability.small_cases import SAMPLE

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
    assert 0.0 < checks["wall_stress_difference"] < 2e-2 and 0.0 < checks["held_stress_error"] < 2e-2
    assert 0.0 < checks["inertial_number"] < 1e-3
    assert 0.0 < checks["overlap_max_over_d"] < 1e-2
    assert 0.0 < checks["loading_rate"] < 2e-2
    # The worst of the run stand in the report, and the last line of the history.
    rows = history(run)
    assert checks["unbalanced_force_ratio"] == pytest.approx(rows["unbalanced_force_ratio"].max(), rel=1e-9)
    assert report["last"]["strain"] == pytest.approx(rows["strain"][-1], rel=1e-9)
    assert report["complete"] is True and report["ended"] == "the end of loading"


def test_a_two_way_run_tells_where_its_time_went_and_how_well_it_closed(poreslip, tmp_path, stage_cache):
    """A pack squeezed by a driven wall, in which the mesh changes."""
    (tmp_path / "squeeze.toml").write_text(SQUEEZE)
    inputs = settings("sample.loading_time_s=1e-5", "output.checkpoint_every_steps=0")
    done = poreslip("run", tmp_path / "squeeze.toml", "--out", tmp_path / "out", *inputs, env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0, done.stderr
    run = tmp_path / "out" / "squeeze" / "run"
    report = json.loads((run / "report.json").read_text())
    (phases,) = report["cpu_s_by_phase_and_rank"]
    assert {"engine", "exchange", "tessellation", "geometry", "assembly", "solve", "forces", "output"} <= set(phases)
    assert all(spent["cpu_s"] >= 0.0 and spent["wall_s"] >= 0.0 for spent in phases.values())
    assert report["loading_cpu_s"] == pytest.approx(sum(spent["cpu_s"] for name, spent in phases.items() if name != "stages"))
    assert report["grain_steps_per_cpu_s"] == pytest.approx(report["steps"] * report["grains"] / report["loading_cpu_s"])
    assert report["peak_memory_bytes_by_rank"][0] > 1e7
    # Solved at the end of each interval of 20 steps.
    solver, rows = report["solver"], history(run)
    assert solver["solves"] == -(-report["steps"] // 20) and 0 < solver["iterations_at_most"] <= solver["iterations"]
    assert set(report["balances"]) == {"momentum_residual", "work_residual", "mass_residual", "remesh_mass_residual"}
    assert all(0.0 <= one["final"] <= one["worst"] for one in report["balances"].values())
    # The mesh is taken up before each of them, and once before the first forces.
    assert sum(report["remeshes"].values()) == solver["solves"] + 1 and report["remeshes"]["repaired"] > 0
    # The one driven wall's way in a step over an overlap of 1e-3 d, and the strain rate of 20 m/s over the box.
    checks = report["quasi_static_checks"]
    step = 20.0 * report["last"]["time_s"] / report["last"]["step"]
    assert checks["loading_rate"] == pytest.approx(rows["loading_rate"].max(), rel=1e-9)
    assert 1e-4 * 2e-3 < step / rows["loading_rate"][0] < rows["overlap_max_over_d"][0] * 2e-3
    assert checks["inertial_number"] > 20.0 / 0.014 * 2e-3 * (2650 / rows["sigma_z_Pa"].max()) ** 0.5
    assert [warning.split()[0] for warning in report["warnings"]].count("inertial_number") == 1
    taken = report["interpretations"]
    assert taken["conductance"] == "duct" and taken["perimeter"].startswith("whole") and taken["split"] == "undrained" and taken["bond_strength"] == "no bonds"
    page = (run / "report.md").read_text()
    for words in ("| mass_residual |", "solver: iterations |", "| mesh repaired |", "| assembly |", "Peak memory"):
        assert words in page


def test_when_the_mesh_is_made_anew_is_an_input(run_fault):
    """A tiny fault at a great rate, 40 updates: the mesh needed, always anew, and trusted for a while."""
    runs = {name: run_fault(*inputs, run="wet", out=name) for name, inputs in {
        "needed": (), "always": ("flow.remesh=always",), "trusted": ("flow.remesh_displacement=0.3",)}.items()}  # fmt: skip
    counts = {name: json.loads((run / "report.json").read_text())["remeshes"] for name, run in runs.items()}
    updates = sum(counts["needed"].values())
    assert counts["always"] == {"kept": 0, "repaired": 0, "rebuilt": updates}
    assert 0 < counts["trusted"]["repaired"] + counts["trusted"]["rebuilt"] < counts["needed"]["repaired"] + counts["needed"]["rebuilt"] <= updates
    needed, always, trusted = (history(runs[name])["sigma_n_Pa"] for name in ("needed", "always", "trusted"))
    # A mesh that is repaired is the one made anew.
    np.testing.assert_allclose(always, needed, rtol=1e-6)
    np.testing.assert_allclose(trusted, needed, rtol=1e-3)


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
    # The plates do not keep up with them, and the report says so.
    off = abs(rows["sigma_v_Pa"] / 1e7 - 1.0).max()
    assert report["quasi_static_checks"]["held_stress_error"] == pytest.approx(off, rel=1e-6) and off > 0.1
    assert [warning.split()[0] for warning in report["warnings"]].count("held_stress_error") == 1


def test_a_sample_tells_how_well_its_walls_hold_their_stress(poreslip, tmp_path, stage_cache):
    (tmp_path / "sample.toml").write_text(SAMPLE)
    done = poreslip("run", tmp_path / "sample.toml", "--out", tmp_path / "out", env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0, done.stderr
    run = tmp_path / "out" / "sample" / "run"
    rows, report = history(run), json.loads((run / "report.json").read_text())
    wanted = 1e7 + 1e6 * np.minimum(rows["time_s"] / 2e-5, 1.0)
    assert report["quasi_static_checks"]["held_stress_error"] == pytest.approx(abs(rows["sigma_z_Pa"] / wanted - 1.0).max(), rel=1e-6)
    assert report["warnings"] == []


@pytest.mark.parallel
@pytest.mark.parametrize("name", ["snapshots/partial_grains_0.vtu", "snapshots/index.partial", "report.md.partial"])
def test_what_the_first_rank_cannot_write_ends_all_ranks(start, tmp_path, name):
    (tmp_path / "out" / "tiny" / "dry" / name).mkdir(parents=True)
    message = the_message(start("--only", "dry", *settings("output.snapshots=1"), ranks=2), 2)
    assert name in message and "the disk has room" in message
