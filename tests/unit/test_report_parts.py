"""Parts of a run's report: phases that count each second once, figures against their stated ranges, speeds without the stages."""

from __future__ import annotations

import time

import pytest

from coupling.results.phases import Phases
from coupling.report import speeds
from coupling.results.stated_ranges import STATED_RANGES, warnings


def busy(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_a_second_counts_once():
    phases = Phases()
    start = time.process_time()
    with phases.timed("outer"):
        busy(0.02)
        for _ in range(2):
            with phases.timed("inner"):
                busy(0.03)
    whole = time.process_time() - start
    assert phases.calls == {"outer": 1, "inner": 2}
    assert phases.cpu["inner"] == pytest.approx(0.06, abs=0.01) and phases.cpu["outer"] < 0.04
    assert sum(phases.cpu.values()) == pytest.approx(whole, abs=5e-3)


def test_an_error_ends_a_phase():
    phases = Phases()
    with pytest.raises(RuntimeError), phases.timed("outer"), phases.timed("inner"):
        raise RuntimeError
    with phases.timed("next"):
        busy(0.01)
    assert phases.calls == {"outer": 1, "inner": 1, "next": 1} and phases.cpu["next"] >= 0.01


def test_part_of_a_phase_handed_on():
    phases = Phases()
    with phases.timed("solve"):
        busy(0.03)
    wall, cpu = phases.wall["solve"], phases.cpu["solve"]
    phases.shared("solve", {"assembly": 0.25 * wall})
    assert phases.wall["assembly"] == pytest.approx(0.25 * wall) and phases.cpu["assembly"] == pytest.approx(0.25 * cpu)
    assert phases.wall["solve"] == pytest.approx(0.75 * wall) and phases.cpu["solve"] == pytest.approx(0.75 * cpu)


@pytest.mark.parametrize("name", STATED_RANGES)
def test_a_figure_outside_of_its_range_is_told_once(name):
    limit = STATED_RANGES[name].highest
    assert warnings({name: limit, "kinetic_energy_J": 1e9}) == []
    for value in (1.01 * limit, float("inf"), float("nan")):
        (said,) = warnings({name: value, "kinetic_energy_J": 1e9})
        assert said.startswith(f"{name} reached") and f"ends at {limit:g}" in said and STATED_RANGES[name].advice in said


def test_speeds_leave_the_stages_out():
    times = [{"stages": {"cpu_s": 50.0, "wall_s": 60.0}, "engine": {"cpu_s": 2.0, "wall_s": 3.0}, "output": {"cpu_s": 0.5, "wall_s": 1.0}},
             {"stages": {"cpu_s": 50.0, "wall_s": 60.0}, "engine": {"cpu_s": 3.0, "wall_s": 3.5}, "output": {"cpu_s": 0.5, "wall_s": 1.0}}]  # fmt: skip
    found = speeds(times, 1200)
    assert found == pytest.approx({
        "loading_wall_s": 4.5, "loading_cpu_s": 6.0, "grain_steps_per_s": 1200 / 4.5, "grain_steps_per_cpu_s": 200.0, "grain_steps_per_engine_cpu_s": 240.0})  # fmt: skip


@pytest.mark.parametrize(("scene", "key"), [("two_sides", "loading.strain_rate_per_s"), ("supplement", "supplement.ramp_time_s"), ("sample", "sample.walls")])
def test_the_advice_names_an_input_of_the_scene(scene: str, key: str) -> None:
    (said,) = warnings({"loading_rate": 1.0}, scene)
    assert key in said and ("strain_rate" in said) == (scene == "two_sides")
