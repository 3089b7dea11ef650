"""Case files of the scene "sample": what its walls and faces may be told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from coupling.case.files import load_case
from coupling.case.schema import Sample
from coupling.errors import InputError
from coupling.stages.deck_variables import load_variables

CASES = Path(__file__).resolve().parents[2] / "cases"
TEXT = 'scene = "sample"\nflow.kind = "solve"\n'


def loaded(directory: Path, *overrides: str):
    path = directory / "box.toml"
    path.write_text(TEXT)
    (run,) = load_case(path, overrides).runs
    return run


def test_the_cases_of_the_repository() -> None:
    runs = {f"{name}/{run.name}": run for name in ("darcy", "consolidation", "undrained") for run in load_case(CASES / name / f"{name}.toml").runs}
    assert {key for key, run in runs.items() if run.needs_mesh} == {"darcy/run", "consolidation/two_way", "undrained/uniaxial", "undrained/isotropic"}
    assert not any(run.bonded or run.has_fault for run in runs.values())


def test_motions_of_walls(tmp_path: Path) -> None:
    run = loaded(tmp_path, 'sample.walls={ x_left = "speed 0.5", x_right = "speed 0.5", z_top = "stress 2e7" }')
    values = load_variables(run, tmp_path, None)
    # Into the box: upwards at a low wall, downwards at a high one.
    assert values["motion_x_left"] == '"velocity 0.5"'
    assert values["motion_x_right"] == '"velocity -0.5"'
    assert values["motion_y_front"] == '"velocity 0"'
    assert values["motion_z_top"].startswith('"servo stress v_wanted_z_top area v_area_z ')
    assert (values["stress_z_top"], values["stress_z_bottom"]) == (2e7, 1e7)


@pytest.mark.parametrize("text", ["", "fixed 1", "speed", "speed fast", "speed nan", "stress 1 2", "force 3"])
def test_other_motions_are_refused(text: str) -> None:
    with pytest.raises(ValueError):
        Sample(walls={"z_top": text}).motion("z_top")


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ('flow.kind="prescribed"', 'set "solve", or "none"'),
        ('sample.walls={ z_low = "fixed" }', "z_low is no wall; allowed are x_left"),
        ('sample.walls={ z_top = "push 3" }', 'none of "fixed", "speed V"'),
        ("sample.walls={ z_top = 3.0 }", 'none of "fixed", "speed V"'),
        ("fluid.faces={ top = 0.0 }", "top is no face; allowed are xmin"),
        ('fluid.faces={ zmax = "open" }', "the pressure of zmax is a number"),
        ("fluid.compressibility_per_Pa=0", 'must be above 0 with flow.split = "undrained"'),
        ("fluid.compressibility_per_Pa=-1e-10", "at least 0"),
        ("fluid.viscosity_Pa_s=-1", "above 0"),
        ('flow.split="drained"', '"undrained", "predicted", "staggered"'),
        ("sample.loading_time_s=1e-9", "too few to follow the grains; lengthen it"),
        ("output.history_interval_steps=70", "multiple of flow.interval_steps"),
        ('flow={ interval_tolerance = 0.01, split = "staggered" }', 'bears intervals only up to a limit that does not follow from their error; leave it out, or set flow.split = "predicted"'),
        ("flow={ interval_tolerance = 0.01, two_way = false }", "intervals follow the error of a two-way flow alone; leave it out"),
        ("flow.interval_tolerance=1.5", "at most 1"),
    ],
)
def test_bad_inputs(tmp_path: Path, override: str, told: str) -> None:
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, override)
    assert told in str(refused.value)


def test_intervals_that_follow_their_error(tmp_path: Path) -> None:
    following = ("flow.interval_tolerance=0.01", 'flow.split="predicted"', "flow.interval_steps=70", "output.history_interval_steps=90")
    loaded(tmp_path, *following)
    with pytest.raises(InputError, match="must be a multiple of output.history_interval_steps, 90, where intervals end .* 180 is the nearest"):
        loaded(tmp_path, *following, "output.checkpoint_every_steps=200")


def test_a_wall_that_pulls(tmp_path: Path) -> None:
    pulls = 'sample.walls={ z_top = "stress -1e6" }'
    with pytest.raises(InputError, match="pulls, and grains hold no wall back"):
        loaded(tmp_path, pulls, "flow.kind=none")
    # Behind a fluid under suction one may.
    loaded(tmp_path, pulls, "flow.kind=solve", "fluid.initial_pressure_Pa=-2e6")


def test_a_ramp_that_does_not_end(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must not be longer than sample.loading_time_s"):
        loaded(tmp_path, "sample.ramp_time_s=1", 'sample.walls={ z_top = "stress 2e7" }')
    loaded(tmp_path, "sample.ramp_time_s=1")


def test_an_incompressible_fluid_needs_a_way_out(tmp_path: Path) -> None:
    incompressible = ("fluid.compressibility_per_Pa=0", 'flow.split="staggered"')
    with pytest.raises(InputError, match="must be above 0 in a sealed box"):
        loaded(tmp_path, *incompressible)
    loaded(tmp_path, *incompressible, "fluid.faces={ zmax = 0.0 }")


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("fluid.faces={ xmin = 0.0 }", "fluid.held say what is held"),
        ("fluid.initial_pressure_Pa=1e5", "begins with the field of"),
        ('fluid.held="gouge"', '"faces", "blocks"'),
        ("fluid.compressibility_per_Pa=0", 'set "staggered"'),
    ],
)
def test_bad_inputs_of_a_fault(override: str, told: str) -> None:
    with pytest.raises(InputError) as refused:
        load_case(CASES / "two_sides" / "quick.toml", ["flow.kind=solve", override])
    assert told in str(refused.value)


def test_a_fault_may_have_any_flow() -> None:
    for case, one_way in ((case, one_way) for case in ("two_sides/quick", "supplement/supplement") for one_way in ("true", "false")):
        runs = load_case(CASES / f"{case}.toml", ["flow.kind=solve", f"flow.two_way={one_way}"]).runs
        assert all(run.needs_mesh for run in runs)


def test_the_interface_slip_runs_are_pairs() -> None:
    """One-way and two-way with the same inputs, water and a fluid as much thinner as the loading is faster than the paper's."""
    runs = load_case(CASES / "interface_slip" / "interface_slip.toml").runs
    assert len(runs) == 8
    for one, two in zip(runs[::2], runs[1::2]):
        assert (one.flow.two_way, two.flow.two_way) == (False, True) and two.name == one.name.replace("one_way", "two_way")
        assert replace(two, name=one.name, group=one.group, flow=one.flow) == one
        slower = 3.83 / 7.8e-3 if "slow" in one.name else 1.0
        assert one.fluid.viscosity_Pa_s == pytest.approx(1e-3 / slower, rel=1e-3)


def test_an_empty_table_leaves_no_entries(tmp_path: Path) -> None:
    """In a run or on the command line; an empty section leaves all."""
    path = tmp_path / "box.toml"
    path.write_text(TEXT + 'fluid.faces = { zmin = 0.0, zmax = 1.0 }\nsample.walls = { z_top = "stress 2e7" }\n'
                    '[[run]]\nname = "open"\nfluid = {}\n[[run]]\nname = "sealed"\nfluid.faces = {}\n')  # fmt: skip
    opened, sealed = load_case(path).runs
    assert opened.fluid.faces == {"zmin": 0.0, "zmax": 1.0} and sealed.fluid.faces == {} and sealed.sample.walls == opened.sample.walls
    opened, sealed = load_case(path, ["sample.walls={}", "fluid.faces.zmin=5.0"]).runs
    assert opened.fluid.faces == {"zmin": 5.0, "zmax": 1.0} and sealed.fluid.faces == {"zmin": 5.0}
    assert opened.sample.walls == sealed.sample.walls == {}
