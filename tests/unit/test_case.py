"""Case files that are right: what is read, merged and derived."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import pytest

from coupling.case.files import load_case, run_case_from_dict, select_runs
from coupling.case.schema import SECTIONS

CASES = Path(__file__).resolve().parents[2] / "cases"


def written(directory: Path, text: str) -> Path:
    path = directory / "fault.toml"
    path.write_text('scene = "two_sides"\npressure.mode = "none"\n' + text)
    return path


@pytest.mark.parametrize("name", ["two_sides/full", "two_sides/quick", "two_sides/literal_stiffness", "supplement/supplement"])
def test_the_cases_of_a_fault_are_the_papers_five(name: str) -> None:
    case_file = load_case(CASES / f"{name}.toml")
    targets = {run.name: (run.pressure.left_target_Pa, run.pressure.right_target_Pa) for run in case_file.runs if run.needs_mesh}
    assert targets == {"case1": (2.5e7, 2.5e7), "case2": (2.5e7, 0.0), "case3": (0.0, 2.5e7), "case4": (1.25e7, 1.25e7)}
    assert [run.name for run in case_file.runs if not run.needs_mesh] == ["case5"]


def test_a_file_of_a_windows_editor_reads_as_any_other(tmp_path: Path) -> None:
    """With the mark of UTF-8 in front, and carriage returns."""
    plain = load_case(written(tmp_path, "[pack]\nporosity = 0.4\n")).runs
    marked = tmp_path / "marked" / "fault.toml"
    marked.parent.mkdir()
    marked.write_bytes(b"\xef\xbb\xbf" + (tmp_path / "fault.toml").read_bytes().replace(b"\n", b"\r\n"))
    assert load_case(marked).runs == plain


def test_defaults_are_table_I(tmp_path: Path) -> None:
    (run,) = load_case(written(tmp_path, "")).runs
    assert run.pack.box_m == (0.08, 0.02, 0.05)
    assert run.pack.diameter_m == (1.8e-3, 2.2e-3)
    assert (run.pack.porosity, run.material.friction, run.fault.gouge_width_m) == (0.35, 0.5, 0.012)
    assert (run.case, run.name, run.title) == ("fault", "run", "fault")
    # SCIENCE: the box holds about 12 300 grains at porosity 0.35
    assert run.estimated_grains == pytest.approx(12_300, rel=0.01)


def test_full_toml_changes_only_what_it_says() -> None:
    """full.toml spells the defaults out; a default that moves would leave it behind."""
    run = load_case(CASES / "two_sides" / "full.toml").runs[0]
    differing = {
        f"{name}.{field.name}"
        for name, kind in SECTIONS.items()
        for field in dataclasses.fields(kind)
        if getattr(getattr(run, name), field.name) != getattr(kind(), field.name)
    }
    allowed = {"pressure.left_target_Pa", "pressure.right_target_Pa", "output.history_interval_steps", "output.snapshots", "output.checkpoint_every_steps"}
    assert differing <= allowed


@pytest.mark.parametrize(("reading", "stiffness"), [("effective-modulus", math.pi / 2 * 5e7), ("older-pfc", 2e8), ("literal", 5e10)])
def test_readings_of_the_stiffness(tmp_path: Path, reading: str, stiffness: float) -> None:
    (run,) = load_case(written(tmp_path, ""), [f"material.stiffness_reading={reading}"]).runs
    assert run.normal_stiffness_N_per_m == pytest.approx(stiffness, rel=1e-14)
    assert run.shear_stiffness_N_per_m == pytest.approx(stiffness / 2, rel=1e-14)
    assert run.critical_time_step_s == pytest.approx(0.63 * math.sqrt(2650 * math.pi / 6 * 1.8e-3**3 / stiffness), rel=1e-14)
    assert run.loading_steps == math.ceil(3.1e-3 / 1.56 / (0.5 * run.critical_time_step_s))


def test_damping_gives_the_restitution_of_a_collision(tmp_path: Path) -> None:
    (run,) = load_case(written(tmp_path, ""), ["material.restitution=0.3"]).runs
    half_mass = 2650 * math.pi / 6 * 2e-3**3 / 2
    decay = run.normal_damping_per_s / 2
    frequency = math.sqrt(run.normal_stiffness_N_per_m / half_mass - decay**2)
    assert math.exp(-decay * math.pi / frequency) == pytest.approx(0.3, rel=1e-12)
    (run,) = load_case(written(tmp_path, ""), ["material.restitution=1"]).runs
    assert run.normal_damping_per_s == 0.0


def test_a_run_overrides_the_file_and_the_command_line_overrides_both(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """
        [pack]
        seed = 5
        deck_variables = { drag = 3 }
        [[run]]
        name = "loose"
        pack.porosity = 0.4
        [[run]]
        name = "dense"
        pack.porosity = 0.36
        pack.deck_variables.skin = "1e-4"
        """,
    )
    runs = load_case(path, ["pack.seed=9", "bonds.enabled=false"]).runs
    assert [(run.name, run.pack.seed, run.pack.porosity, run.bonds.enabled) for run in runs] == [("loose", 9, 0.4, False), ("dense", 9, 0.36, False)]
    assert runs[0].pack.deck_variables == {"drag": 3}
    assert runs[1].pack.deck_variables == {"drag": 3, "skin": "1e-4"}
    assert load_case(path, ["pack.porosity=0.38"]).runs[1].pack.porosity == 0.38


def test_a_sweep_multiplies_runs_and_changes_the_pack_alone(tmp_path: Path) -> None:
    path = written(tmp_path, '[sweep]\nseeds = [3, 4]\n[[run]]\nname = "a"\n[[run]]\nname = "b"\n')
    case_file = load_case(path)
    assert [(run.name, run.group, run.pack.seed) for run in case_file.runs] == [("a-seed3", "a", 3), ("a-seed4", "a", 4), ("b-seed3", "b", 3), ("b-seed4", "b", 4)]
    first, second = case_file.runs[:2]
    assert dataclasses.replace(second, name=first.name, pack=dataclasses.replace(second.pack, seed=3)) == first
    assert [run.name for run in select_runs(case_file, ["a"]).runs] == ["a-seed3", "a-seed4"]
    assert [run.name for run in select_runs(case_file, ["b-seed4", "a-seed3"]).runs] == ["a-seed3", "b-seed4"]
    assert [run.name for run in load_case(path, ["sweep.seeds=[7]"]).runs] == ["a-seed7", "b-seed7"]


def test_runs_can_be_told_apart_by_their_inputs(tmp_path: Path) -> None:
    path = written(tmp_path, "[pack.deck_variables]\ndrag = 7\n")
    one, again, other = (load_case(path, overrides).runs[0] for overrides in ([], [], ["pack.deck_variables.drag=8"]))
    assert len({one, again, other}) == 2


def test_whole_numbers_are_taken_for_lengths_and_stresses(tmp_path: Path) -> None:
    (run,) = load_case(written(tmp_path, "[loading]\nvertical_stress_Pa = 10_000_000\n")).runs
    assert isinstance(run.loading.vertical_stress_Pa, float)


def test_what_is_written_down_is_read_back(tmp_path: Path) -> None:
    for run in load_case(CASES / "two_sides" / "quick.toml", ["sweep.seeds=[1, 2]"]).runs:
        resolved = json.loads(json.dumps(run.to_dict()))
        assert resolved["derived"]["loading_steps"] == run.loading_steps
        assert run_case_from_dict(resolved, "case.json") == run


@pytest.mark.parametrize(
    "formula", ["p_left", "0", "where(s < 0, p_left, p_right)", "p_t * strain / 3.1e-3 * exp(-(x**2 + y**2 + z**2) / width**2)", "1e6 * sin(2e3 * time)"]
)
def test_pressure_formulas(tmp_path: Path, formula: str) -> None:
    (run,) = load_case(written(tmp_path, ""), ["pressure.mode=expression", f'pressure.expression="{formula}"']).runs
    assert run.pressure.expression == formula
    assert run.needs_mesh
