"""fix wall/plane: its law on single grains, its servo, the fluid's share, changes of motion, restart and two ranks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from styles_scene import Grain, Material, Scene, SceneError, run_scene

POSITION, VELOCITY, CONTACT_FORCE, FLUID_FORCE, CONTACTS, WORK, LIMITED = range(7)


def wall_state(scene: Scene, name: str) -> list[float]:
    w = scene.engine.wall(name)
    return [w.position, w.velocity, w.contact_force, w.fluid_force, w.contacts, w.work, w.limited]


def law_scene(comm, normal: tuple, velocity: float) -> dict:
    """Three grains at one plane: one in the group and touching, one in the group and clear, one outside the group."""
    axis = int(np.flatnonzero(normal)[0])
    inward = np.array(normal, dtype=float)
    centres = np.full((3, 3), 0.01)
    for k, gap in enumerate((-3.0e-6, 0.4e-6, -3.0e-6)):
        centres[k, axis] = 0.01 + inward[axis] * (1.0e-3 + gap)
        centres[k, (axis + 1) % 3] += 3.0e-3 * (k - 1)
    speeds = [(0.3, -0.2, 0.1), (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)]
    scene = Scene(comm, [Grain(tuple(x), v=v, omega=(50.0, 0.0, 0.0)) for x, v in zip(centres, speeds)])
    scene.commands("group few id 1 2", f"fix side few wall/plane normal {normal[0]} {normal[1]} {normal[2]} position 0.01 kn 2e6 gamman 3e4 velocity {velocity}",
                   "fix move all nve/noforce")
    rows = []
    for step in range(30):
        scene.run(1, setup=step == 0)
        rows.append((scene.gather("x"), scene.gather("v"), scene.gather("f"), scene.gather("torque"), wall_state(scene, "side")))
    return {"rows": rows, "mass": scene.gather("rmass")}


@pytest.mark.parametrize("normal", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
def test_force_of_a_moving_plane(normal: tuple) -> None:
    result = run_scene(law_scene, normal=normal, velocity=0.25)[0]
    axis, inward = int(np.flatnonzero(normal)[0]), float(sum(normal))
    work, before = 0.0, 2e6 * 3.0e-6 + 3e4 * result["mass"][0] * inward * (0.25 - (0.3, -0.2, 0.1)[axis])
    for step, (x, v, force, torque, state) in enumerate(result["rows"], start=1):
        position = state[POSITION]
        assert position == pytest.approx(0.01 + step * 0.25e-7, abs=1e-15) and state[VELOCITY] == 0.25
        expected = np.zeros(3)
        for k in (0, 1):
            overlap = 1.0e-3 - inward * (x[k, axis] - position)
            approach = inward * (0.25 - v[k, axis])
            expected[k] = max(0.0, 2e6 * overlap + 3e4 * result["mass"][k] * approach) if overlap > 0 else 0.0
        np.testing.assert_allclose(force[:, axis] * inward, expected, atol=1e-12)
        assert np.count_nonzero(np.delete(force, axis, axis=1)) == 0 and np.count_nonzero(torque) == 0
        assert state[CONTACT_FORCE] == pytest.approx(expected.sum(), abs=1e-12) and state[CONTACTS] == np.count_nonzero(expected)
        work += 0.5 * (before + expected.sum()) * inward * 0.25e-7
        before = expected.sum()
        assert state[WORK] == pytest.approx(work, rel=1e-9)
    assert any(row[4][CONTACTS] == 2 for row in result["rows"]) == (inward > 0)  # the second grain is met by a plane that closes


def travelling_scene(comm, plane_speed: float, grain_speed: float) -> dict:
    """A plane and a grain, 6 mm apart at first, that run into each other."""
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01), v=(grain_speed, 0, 0))])
    scene.commands(f"fix side all wall/plane normal 1 0 0 position 0.003 kn 1e6 velocity {plane_speed}", "fix move all nve/noforce")
    scene.run(601)
    return {"x": scene.gather("x")[0, 0], "f": scene.gather("f")[0, 0], "side": wall_state(scene, "side")}


@pytest.mark.parametrize(("plane_speed", "grain_speed"), [(100.0, 0.0), (0.0, -100.0), (40.0, -60.0)])
def test_plane_and_grain_meet_from_afar(plane_speed: float, grain_speed: float) -> None:
    r = run_scene(travelling_scene, plane_speed=plane_speed, grain_speed=grain_speed)[0]
    assert r["f"] == pytest.approx(1e6 * 1.0e-5, rel=1e-9) and r["side"][CONTACTS] == 1
    assert r["f"] == pytest.approx(1e6 * (1.0e-3 - (r["x"] - r["side"][POSITION])), abs=1e-12)


def column() -> list[Grain]:
    """Two layers of five grains in x, between planes at z = 0.005 and about 0.009 m."""
    return [Grain((0.012 + 4.0e-3 * k, 0.01, 0.006 + 2.0e-3 * layer)) for k in range(5) for layer in range(2)]


STRESS, AREA = 2.0e5, 1.0e-4  # Pa, m2: 20 N on five grains
SERVO = "servo stress 2e5 area 1e-4 gain 0.1 vmax 0.5"


def servo_scene(comm, servo: str, fluid: float = 0.0, steps: int = 8000, restart: str | None = None) -> dict:
    scene = Scene(comm, column(), Material(gamman=3e4, gammat=3e4))
    scene.commands("fix low all wall/plane normal 0 0 1 position 0.005 kn 1e6 velocity 0", "variable side equal 0.01",
                   f"fix top all wall/plane normal 0 0 -1 position 0.00901 kn 1e6 gamman 1e4 {servo}",
                   "fix move all nve/sphere", "fix damp all damping/local 0.3")
    scene.engine.set_wall_fluid_force("top", fluid)
    scene.run(steps)
    if restart:
        scene.engine.write_restart(Path(restart))
        scene.run(steps)
    return servo_result(scene)


def servo_result(scene: Scene) -> dict:
    return {"top": wall_state(scene, "top"), "low": wall_state(scene, "low"), "x": scene.gather("x"), "v": scene.gather("v"),
            "vector": [scene.fix_value("top", column) for column in range(1, 8)]}


def leaving_scene(comm) -> tuple[float, list[float]]:
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01), v=(20.0, 0, 0))])
    scene.commands("fix side all wall/plane normal 1 0 0 position 0.00901 kn 1e6 gamman 1e5 velocity 0", "fix move all nve/noforce")
    scene.run(1)
    return scene.gather("f")[0, 0], wall_state(scene, "side")


def test_the_dashpot_does_not_pull() -> None:
    force, state = run_scene(leaving_scene)[0]  # 8 N of the spring against 21 N of the dashpot
    assert force == 0 and state[CONTACT_FORCE] == 0 and state[CONTACTS] == 1


def servo_steps_scene(comm, limit: str) -> list[list[float]]:
    scene = Scene(comm, column())
    scene.commands("variable limit equal 0.2+0.3", f"fix top all wall/plane normal 0 0 -1 position 0.008999 kn 1e6 {SERVO.replace('gain 0.1', 'gain 0.01').replace('vmax 0.5', limit)}",
                   "fix move all nve/sphere")
    scene.engine.set_wall_fluid_force("top", 2.0)
    states = []
    for step in range(200):
        scene.run(1, setup=step == 0)
        states.append(wall_state(scene, "top"))
    return states


@pytest.mark.parametrize("limit", ["vmax 0.5", "vmax v_limit"])
def test_speed_of_the_servo_at_each_step(limit) -> None:
    states = run_scene(servo_steps_scene, limit=limit)[0]
    limited = states[0][LIMITED]
    for before, after in zip(states, states[1:]):
        speed = 0.01 * (STRESS * AREA - before[CONTACT_FORCE] - 2.0) / (1e6 * max(before[CONTACTS], 1) * 1e-7)
        limited += abs(speed) > 0.5
        assert after[VELOCITY] == pytest.approx(-np.clip(speed, -0.5, 0.5), rel=1e-12)
        assert after[LIMITED] == limited
    assert {state[CONTACTS] for state in states} >= {0.0, 5.0} and 0 < limited < len(states)


def test_servo_reaches_its_stress() -> None:
    result = run_scene(servo_scene, servo=SERVO)[0]
    assert result["top"][CONTACT_FORCE] == pytest.approx(STRESS * AREA, rel=1e-6)
    assert result["low"][CONTACT_FORCE] == pytest.approx(STRESS * AREA, rel=1e-3)
    assert result["top"][LIMITED] > 10 and abs(result["top"][VELOCITY]) < 1e-5  # at vmax over the first gap, at rest in the end
    assert result["vector"] == result["top"]


def test_servo_holds_contact_and_fluid_together_with_variables() -> None:
    result = run_scene(servo_scene, servo="servo stress 2e5 area v_side2 gain 0.1 vmax 0.5".replace("v_side2", "v_side"), fluid=1990.0, steps=8000)[0]
    assert result["top"][FLUID_FORCE] == 1990.0
    assert result["top"][CONTACT_FORCE] == pytest.approx(2e5 * 0.01 - 1990.0, rel=1e-6)


def test_fluid_beyond_the_stress_drives_the_plane_back() -> None:
    result = run_scene(servo_scene, servo=SERVO, fluid=50.0, steps=100)[0]
    assert result["top"][VELOCITY] == 0.5 and result["top"][POSITION] == pytest.approx(0.00901 + 100 * 0.5e-7, abs=1e-15)


def resumed_servo_scene(comm, restart: str, command: str, steps: int) -> dict:
    scene = Scene.from_restart(comm, Path(restart), Material(gamman=3e4, gammat=3e4))
    scene.commands("fix low all wall/plane normal 0 0 1 position 0.0 kn 1e6 velocity 0", command, "fix move all nve/sphere", "fix damp all damping/local 0.3")
    before = wall_state(scene, "top")
    scene.run(steps)
    return servo_result(scene) | {"before": before}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_restart_of_a_servo_is_bitwise(ranks: int, tmp_path: Path) -> None:
    restart = str(tmp_path / "half.restart")
    through = run_scene(servo_scene, ranks=ranks, servo=SERVO, fluid=3.0, steps=300, restart=restart)
    command = f"fix top all wall/plane normal 0 0 -1 position 0.5 kn 1e6 gamman 1e4 {SERVO}"
    resumed = run_scene(resumed_servo_scene, ranks=ranks, restart=restart, command=command, steps=300)
    for before, after in zip(through, resumed):
        for name in before:
            np.testing.assert_array_equal(before[name], after[name], err_msg=name)
    assert through[0]["top"] == through[-1]["top"]


def test_after_a_restart_the_motion_is_the_commands_and_the_position_too_with_reset(tmp_path: Path) -> None:
    restart = str(tmp_path / "half.restart")
    run_scene(servo_scene, servo=SERVO, steps=300, restart=restart)
    carried, reset = (run_scene(resumed_servo_scene, restart=restart, steps=10,
                                command=f"fix top all wall/plane normal 0 0 -1 position 0.009 kn 1e6 velocity -0.125 {end}")[0] for end in ("", "reset yes"))
    assert carried["before"][POSITION] != 0.009 and carried["before"][WORK] > 0 and carried["top"][VELOCITY] == -0.125
    assert reset["before"][POSITION] == 0.009 and reset["before"][WORK] == 0
    assert reset["top"][POSITION] == pytest.approx(0.009 - 10 * 0.125e-7, abs=1e-15)


def changed_motion_scene(comm) -> list:
    scene = Scene(comm, column())
    scene.commands("fix top all wall/plane normal 0 0 -1 position 0.01 kn 1e6 velocity -1", "fix move all nve/sphere")
    scene.run(10)
    states = [wall_state(scene, "top")]
    for line in ("velocity 0.5", SERVO, "position 0.011"):
        scene.commands(f"fix_modify top {line}")
        scene.run(10)
        states.append(wall_state(scene, "top"))
    return states


def test_fix_modify_changes_the_motion_and_keeps_the_position() -> None:
    states = run_scene(changed_motion_scene)[0]
    positions = [state[POSITION] for state in states]
    np.testing.assert_allclose(positions, [0.01 - 1e-6, 0.01 - 0.5e-6, 0.01 - 1e-6, 0.011 - 0.5e-6], atol=1e-15)
    assert [state[VELOCITY] for state in states] == [-1, 0.5, -0.5, -0.5]


@pytest.mark.parallel
def test_one_and_two_ranks_agree() -> None:
    one = run_scene(servo_scene, servo=SERVO, steps=1000)
    two = run_scene(servo_scene, ranks=2, servo=SERVO, steps=1000)
    assert two[0]["top"] == two[1]["top"]
    np.testing.assert_allclose(two[0]["top"], one[0]["top"], rtol=1e-6)
    np.testing.assert_allclose(two[0]["x"], one[0]["x"], atol=1e-13)


def periodic_wall_scene(comm) -> None:
    scene = Scene(comm, column(), boundary="p f f")
    scene.commands("fix left all wall/plane normal 1 0 0 position 0. kn 1e6 velocity 0", "fix move all nve/sphere")
    scene.run(1)


def test_no_plane_across_a_periodic_direction() -> None:
    with pytest.raises(SceneError, match="fix left wall/plane: the box is periodic across this plane"):
        run_scene(periodic_wall_scene)
