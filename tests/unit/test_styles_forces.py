"""fix damping/local and fix poreforce."""

from __future__ import annotations

import numpy as np
import pytest
from styles_scene import Grain, Material, Scene, run_scene


def damping_law_scene(comm, alpha: float) -> dict:
    random = np.random.default_rng(4)
    grains = [Grain((0.005 + 0.01 * (k % 4), 0.01, 0.005 + 0.005 * (k // 4)), v=tuple(random.normal(0, 1, 3)), omega=tuple(random.normal(0, 9, 3)))
              for k in range(8)]
    grains[0] = Grain(grains[0].x, v=(0.0, 1.0, -1.0))  # at rest in one component: not damped there
    scene = Scene(comm, grains)
    force = random.normal(0, 1, (8, 3))
    scene.commands("group damped id 1 2 3 4 5 6 7", "fix pf all property/atom f_pf vector yes no no 0. 0. 0.", "fix pore all poreforce pf",
                   f"fix damp damped damping/local {alpha}", "fix move all nve/noforce")
    scene.run(0)  # the first run after its definition sets a property/atom to its initial values
    scene.engine.property_atom("pf")[:] = force[scene.engine.atom("id") - 1]
    scene.run(1)
    return {"force": force, "v": scene.gather("v"), "f": scene.gather("f"), "torque": scene.gather("torque")}


def test_local_damping_of_each_component() -> None:
    r = run_scene(damping_law_scene, alpha=0.7)[0]
    expected = r["force"] - 0.7 * np.abs(r["force"]) * np.sign(r["v"])
    expected[7] = r["force"][7]  # not in the fix's group
    np.testing.assert_array_equal(r["f"], expected)
    assert r["f"][0, 0] == r["force"][0, 0]


def spinning_pair_scene(comm, alpha: float) -> dict:
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01), omega=(0, 0, 500.0)), Grain((0.0119, 0.01, 0.01), omega=(0, 100.0, -300.0))])
    scene.commands("fix move all nve/noforce")
    if alpha:
        scene.commands(f"fix damp all damping/local {alpha}")
    scene.run(20)
    return {"torque": scene.gather("torque"), "omega": scene.gather("omega")}


def test_local_damping_of_moments() -> None:
    free, damped = (run_scene(spinning_pair_scene, alpha=alpha)[0] for alpha in (0, 0.4))
    assert np.abs(free["torque"]).max() > 0
    np.testing.assert_array_equal(damped["torque"], free["torque"] - 0.4 * np.abs(free["torque"]) * np.sign(free["omega"]))


def oscillating_grain_scene(comm, alpha: float) -> dict:
    """A grain between two planes a little narrower than it: a spring of 2 kn. Energy, and the way of the force, at each step."""
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01), v=(0.05, 0, 0))], time_step=2e-8)
    scene.commands("fix left all wall/plane normal 1 0 0 position 0.00901 kn 1e6 velocity 0",
                   "fix right all wall/plane normal -1 0 0 position 0.01099 kn 1e6 velocity 0",
                   f"fix damp all damping/local {alpha}", "fix move all nve/sphere")
    mass, steps = scene.gather("rmass")[0], []
    for step in range(3000):
        scene.run(1, setup=step == 0)
        x, v = scene.gather("x")[0, 0] - 0.01, scene.gather("v")[0, 0]
        steps.append((0.5 * mass * v**2 + 0.5 * 2e6 * x**2, abs(2e6 * x), abs(v) * 2e-8))
    return {"steps": np.array(steps), "start": 0.5 * mass * 0.05**2}


def test_local_damping_takes_alpha_times_force_times_way() -> None:
    r = run_scene(oscillating_grain_scene, alpha=0.2)[0]
    energy, force, way = r["steps"].T
    lost = 0.2 * np.sum(force * way)
    assert 0.3 < energy[-1] / r["start"] + lost / r["start"] < 1.01
    assert r["start"] - energy[-1] == pytest.approx(lost, rel=1e-2)


def pore_force_scene(comm, fast: bool) -> dict:
    """Colliding grains with a force of their own each, by the fast fix or by fix addforce with atom-style variables."""
    random = np.random.default_rng(8)
    cells = np.stack(np.meshgrid(*[np.arange(3)] * 3), axis=-1).reshape(-1, 3)
    grains = [Grain(tuple(0.018 + 2.01e-3 * c * [1, 0.5, 0.5] * [1, 2, 2] - [0, 0.01, 0.01]), v=tuple(random.normal(0, 0.5, 3))) for c in cells]
    scene = Scene(comm, grains, Material(gamman=1e4, gammat=1e4))
    scene.commands("group some id <= 20", "fix pf all property/atom f_pf vector yes no no 0. 0. 0.")
    if fast:
        scene.commands("fix pore some poreforce pf")
    else:
        scene.commands("variable fx atom f_pf[1]", "variable fy atom f_pf[2]", "variable fz atom f_pf[3]", "fix pore some addforce v_fx v_fy v_fz")
    scene.commands("fix damp all damping/local 0.1", "fix move all nve/sphere")
    force = random.normal(0, 0.5, (27, 3))
    scene.run(0)  # the first run after its definition sets a property/atom to its initial values
    scene.engine.property_atom("pf")[:] = force[scene.engine.atom("id") - 1]
    scene.run(1)
    total = [scene.fix_value("pore", column) for column in (1, 2, 3)]
    scene.run(1500)
    return {"x": scene.gather("x"), "v": scene.gather("v"), "f": scene.gather("f"), "total": total, "force": force,
            "grains": len(scene.engine.atom("id"))}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_pore_force_is_fix_addforce_to_the_last_bit(ranks: int) -> None:
    fast, stock = (run_scene(pore_force_scene, ranks=ranks, fast=fast)[0] for fast in (True, False))
    assert 0 < fast["grains"] and (ranks == 1) == (fast["grains"] == 27)
    for name in ("x", "v", "f"):
        np.testing.assert_array_equal(fast[name], stock[name])
    np.testing.assert_allclose(fast["total"], fast["force"][:20].sum(axis=0), rtol=1e-12)
