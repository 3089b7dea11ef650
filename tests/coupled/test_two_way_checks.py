"""Two-way runs whose step or servo would be unstable with the fluid: refused before the first step, with a setting that holds."""

from __future__ import annotations

import json
import re

import pytest
from processes import the_message
from tiny_fault import settings

from coupling.stability.small_cases import BOX, FAULT

SEVERAL = pytest.param(2, marks=pytest.mark.parallel)
#: Drained at the bottom, so that the loaded wall has undrained pores behind it.
SMALL = BOX + """\
loading.time_step_fraction = 0.25
sample.loading_time_s = 5e-6
sample.ramp_time_s = 5e-6
sample.walls = { z_top = "stress 1.1e7" }
fluid.faces = { zmin = 0.0 }
flow.kind = "solve"
flow.interval_steps = 10
output.history_interval_steps = 10
"""


@pytest.fixture
def small(poreslip, stage_cache, tmp_path):
    def run(*overrides: str, ranks: int = 1):
        case = tmp_path / "small.toml"
        case.write_text(SMALL)
        return poreslip("run", case, "--out", tmp_path / "out", *settings(*overrides), ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})

    return run


def report(tmp_path) -> dict:
    return json.loads((tmp_path / "out" / "small" / "run" / "report.json").read_text())["quasi_static_checks"]


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_step_too_long_for_the_fluid(small, tmp_path, ranks):
    stiff, fixed = "fluid.compressibility_per_Pa=1e-13", 'sample.walls={ z_top = "fixed" }'
    message = the_message(small(stiff, fixed, ranks=ranks), 2)
    assert "loading.time_step_fraction = 0.25: the step of 5.06e-08 s is longer than grains bear" in message
    fraction, compressibility = re.search(r"Set ([\d.e-]+), a fluid.compressibility_per_Pa of ([\d.e-]+) or more", message).groups()
    if ranks > 1:
        return
    # Either of what it names is accepted, and the pack stays at rest however often the fluid flows: with the forces of the step before it in the
    # first half of the next, a step above 0.7 of the limit drove the grains.
    for interval in (1, 10):
        done = small(stiff, fixed, f"loading.time_step_fraction={fraction}", f"flow.interval_steps={interval}", "sample.loading_time_s=3e-6")
        assert done.returncode == 0, done.stderr
        assert report(tmp_path)["energy_gain"] < 1e-6
    assert small(f"fluid.compressibility_per_Pa={compressibility}", fixed).returncode == 0


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_servo_against_a_stiff_fluid(small, ranks):
    message = the_message(small("fluid.compressibility_per_Pa=5e-12", ranks=ranks), 2)
    assert 'z_top = "stress 1.1e7": the fluid behind this wall is' in message
    compressibility = re.search(r"compressibility_per_Pa of ([\d.e-]+) or more", message)[1]
    assert ranks > 1 or small(f"fluid.compressibility_per_Pa={compressibility}").returncode == 0


STAGGERED = ("fluid.compressibility_per_Pa=4.6e-11", "fluid.viscosity_Pa_s=10.0", "flow.split=staggered", "material.local_damping=0.2", "sample.loading_time_s=3e-5")


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_servo_against_a_stiff_fluid_that_answers_at_solves_alone(small, tmp_path, ranks):
    message = the_message(small(*STAGGERED, "flow.interval_steps=12", "output.history_interval_steps=12", ranks=ranks), 2)
    assert 'flow.interval_steps = 12: with flow.split = "staggered" the fluid behind the wall of sample.walls: z_top = "stress 1.1e7"' in message
    steps = int(re.search(r"Set (\d+) or fewer", message)[1])
    if ranks > 1:
        return
    assert small(*STAGGERED, f"flow.interval_steps={steps}", f"output.history_interval_steps={steps}").returncode == 0
    assert report(tmp_path)["energy_gain"] < 1e-6
    # The other that it names; and what lets the pores drain within the interval.
    assert 'or set flow.split = "undrained"' in message
    assert small(*STAGGERED, "flow.split=undrained", "flow.interval_steps=12", "output.history_interval_steps=12").returncode == 0
    assert small(*STAGGERED, "fluid.viscosity_Pa_s=1.0", "flow.interval_steps=40", "output.history_interval_steps=40").returncode == 0


def test_waves_that_a_late_fluid_drives(small, tmp_path):
    """Between fixed walls, where no servo is: the estimate's own number holds, with a pressure that jumps."""
    fixed = ('sample.walls={ z_top = "fixed" }', "fluid.faces={ zmin = 1e6 }", *STAGGERED)
    message = the_message(small(*fixed, "flow.interval_steps=100", "output.history_interval_steps=100"), 2)
    assert "flow.interval_steps = 100" in message
    steps = int(re.search(r"set (\d+) or fewer", message)[1])
    assert small(*fixed, f"flow.interval_steps={steps}", f"output.history_interval_steps={2 * steps}").returncode == 0
    assert report(tmp_path)["energy_gain"] < 1e-3
    # Twice as many are accepted, told of beforehand, and caught in the run.
    longer = small(*fixed, f"flow.interval_steps={2 * steps}", f"output.history_interval_steps={2 * steps}")
    assert f"flow.interval_steps = {2 * steps} is more than what flow.split = \"staggered\" bears, {steps} steps by estimate" in longer.stdout
    assert "the motion is unstable" in the_message(longer, 3)


@pytest.mark.parametrize("inputs", [("loading.time_step_fraction=0.95",), ("loading.time_step_fraction=0.6", "material.restitution=0.01"),
                                    ("loading.time_step_fraction=0.8", "material.local_damping=0.7")])  # fmt: skip
def test_a_step_too_long_for_the_contacts(small, tmp_path, inputs):
    dry = ("flow.kind=none", "sample.loading_time_s=4e-5", *inputs)
    message = the_message(small(*dry), 2)
    assert "is longer than the contacts bear" in message
    fraction = re.search(r"set at most (\d\.\d+)", message)[1]
    done = small(*dry, f"loading.time_step_fraction={fraction}")
    assert done.returncode == 0, done.stderr
    assert report(tmp_path)["energy_gain"] < 1e-6


FLOWING = FAULT.replace('pressure.mode = "none"', 'pressure.left_target_Pa = 1e7\nflow.kind = "solve"\nflow.interval_steps = 10') + "time_step_fraction = 0.02\n"


def test_the_plates_of_a_fault_against_a_stiff_fluid(poreslip, stage_cache, tmp_path):
    """Between the pressures that the blocks' faces are held at, pores of the gouge lie behind the plates too."""
    (tmp_path / "fault.toml").write_text(FLOWING)

    def run(*overrides: str):
        stiff = settings("fluid.compressibility_per_Pa=1e-12", "loading.horizontal_strain=2e-5", *overrides)
        return poreslip("run", tmp_path / "fault.toml", "--out", tmp_path / "out", *stiff, env={"PORESLIP_CACHE": str(stage_cache)})

    message = the_message(run(), 2)
    # Which plate is the first depends on the pack, and so on the ranks that made it.
    assert re.search(r"the scene two_sides, z_(top|bottom)_(left|right): the fluid behind this wall is", message) and "a servo holds a stress up to 1.5 times" in message
    gain, compressibility = re.search(r"servo_gain of at most ([\d.e-]+), or set a fluid.compressibility_per_Pa of ([\d.e-]+) or more", message).groups()
    assert run(f"loading.deck_variables.servo_gain={gain}").returncode == 0
    assert run(f"fluid.compressibility_per_Pa={compressibility}").returncode == 0
