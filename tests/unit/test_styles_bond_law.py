"""The contact bond in LIGGGHTS against its law in Python: three grains pushed about at random, and named single cases."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from styles_reference import Body, BondedPair, strength
from styles_scene import Grain, Material, Scene, SceneError, run_scene

DT = 1.0e-7
SEED = 11
MEAN, DEVIATION = 1.0e6, 0.3e6  # Pa


def bond_command(mean="1e6", deviation="0.3e6", ratio="1", gap="0", armed="yes", types="1 1", extra="") -> str:
    return (f"fix bonds all bond/settings strength_mean {mean} strength_sd {deviation} shear_ratio {ratio} seed {SEED} gap {gap} "
            f"types {types} armed {armed} {extra}")


def random_walk_scene(comm, seed: int, shear_ratio: float, gap: float, material: Material, steps: int) -> dict:
    """Three grains near contact, velocities set anew every few steps; forces compared with the law at each step."""
    random = np.random.default_rng(seed)
    radii = np.array([1.0e-3, 0.8e-3, 1.2e-3])
    home = np.array([[0.0, 0.0, 0.0], [1.8e-3, 0.0, 0.0], [0.5e-3, 0.0, 0.0]]) + 0.01
    home[2] = third_corner(home[0], home[1], radii[0] + radii[2], radii[1] + radii[2])
    home += random.uniform(-gap, 0, size=(3, 3)) / 4
    scene = Scene(comm, [Grain(tuple(x), r) for x, r in zip(home, radii)], material, time_step=DT)
    scene.commands(bond_command(gap=repr(gap), ratio=shear_ratio), "fix move all nve/noforce")
    mass = scene.gather("rmass")
    pairs = {}
    for i, j in itertools.combinations(range(3), 2):
        pairs[i, j] = BondedPair(material.kn, material.kt, material.gamman, material.gammat, material.friction)
    worst_force = worst_torque = largest_force = 0.0
    breaks = []
    armed = True
    for step in range(1, steps + 1):
        if step % 10 == 1:
            x = scene.gather("x")
            pull = random.choice([0.0, 2.0e4, 2.0e5])
            scene.assign("v", pull * (home - x) + random.normal(0, 0.6, (3, 3)))
            scene.assign("omega", random.normal(0, 200, (3, 3)))
        if step == 2 or step == steps // 2:  # armed for the first step, and once more when most bonds are broken
            armed = not armed
            scene.commands(f"fix_modify bonds armed {'yes' if armed else 'no'}")
        scene.run(1, setup=step == 1)
        x, v, omega = (scene.gather(name) for name in ("x", "v", "omega"))
        bodies = [Body(k + 1, x[k], v[k], omega[k], radii[k], mass[k]) for k in range(3)]
        force, torque = np.zeros((3, 3)), np.zeros((3, 3))
        for (i, j), pair in pairs.items():
            stress = strength(i + 1, j + 1, MEAN, DEVIATION, 0.1 * MEAN, SEED)
            f, torque_i, torque_j, event = pair.step(bodies[i], bodies[j], DT, (stress, shear_ratio, gap) if armed else None)
            force[i] += f
            force[j] -= f
            torque[i] += torque_i
            torque[j] += torque_j
            if event:
                mode, point, normal, shear, energy = event
                breaks.append([step, i + 1, j + 1, {"tension": 1, "shear": 2}[mode], *point, normal, shear, energy])
        worst_force = max(worst_force, np.abs(force - scene.gather("f")).max())
        largest_force = max(largest_force, np.abs(force).max())
        worst_torque = max(worst_torque, np.abs(torque - scene.gather("torque")).max())
    expected_bonds = sum(pair.state == "bonded" for pair in pairs.values())
    return {"worst_force": worst_force, "worst_torque": worst_torque, "largest_force": largest_force,
            "expected_breaks": np.array(breaks).reshape(-1, 10),
            "breaks": scene.take_breaks(),
            "bonds": scene.intact_bonds(), "expected_bonds": expected_bonds,
            "branches": set().union(*(pair.touched for pair in pairs.values()))}


def third_corner(a: np.ndarray, b: np.ndarray, to_a: float, to_b: float) -> np.ndarray:
    """A point at given distances from a and b (which differ in x), in the plane of constant z."""
    base = b[0] - a[0]
    along = (to_a**2 - to_b**2 + base**2) / (2 * base)
    return a + [along, np.sqrt(to_a**2 - along**2), 0]


#: seed, friction, shear ratio: weak in shear; able to keep its shear through a break; weak in tension.
KINDS = [(1, 0.3, 0.4), (2, 3.0, 0.8), (3, 0.3, 50.0)]
WALKS = [(*kind, gap, damping) for kind in KINDS for gap, damping in ((0.0, 0.0), (2.0e-6, 1.0e4))]


@cache
def random_walk(seed: int, friction: float, shear_ratio: float, gap: float, damping: float) -> dict:
    material = Material(gamman=damping, gammat=damping / 2, friction=friction)
    return run_scene(random_walk_scene, seed=seed, shear_ratio=shear_ratio, gap=gap, material=material, steps=600)[0]


@pytest.mark.parametrize("walk", WALKS, ids=str)
def test_random_walk_follows_the_law(walk: tuple) -> None:
    result = random_walk(*walk)
    force_scale = result["largest_force"]
    assert result["worst_force"] < 1e-12 * force_scale
    assert result["worst_torque"] < 1e-12 * force_scale * 1.0e-3
    assert result["bonds"] == result["expected_bonds"]
    got, expected = result["breaks"], result["expected_breaks"]
    np.testing.assert_array_equal(got[:, :4], expected[:, :4])  # step, ids, mode
    np.testing.assert_allclose(got[:, 4:7], expected[:, 4:7], rtol=1e-12)
    np.testing.assert_allclose(got[:, 7:9], expected[:, 7:9], atol=1e-12 * force_scale)
    np.testing.assert_allclose(got[:, 9], expected[:, 9], atol=1e-12 * force_scale**2 / Material().kt)


def test_random_walks_meet_every_branch_of_the_law() -> None:
    branches = set().union(*(random_walk(*walk)["branches"] for walk in WALKS))
    assert branches == {"bonded across a gap", "bonded in tension", "bonded in compression", "bonded beyond friction", "slip", "stick",
                        "frictional after a break", "shear break, shear lost", "shear break, shear kept", "shear break, shear cut"}
    modes = np.concatenate([random_walk(*walk)["breaks"][:, 3] for walk in WALKS])
    assert set(modes) == {1, 2}


def pulled_pair_scene(comm, velocity: tuple, command: str, steps: int, friction: float = 0.5, separation: float = 1.999e-3,
                      then: tuple = (), then_steps: int = 0,
                      last: tuple = (), last_steps: int = 0, rearm: bool = False, setup: bool = False) -> dict:
    """Two grains along x, the second driven at up to three velocities in turn; what is on record at each step."""
    scene = Scene(comm, [Grain((0.01, 0.01, 0.01)), Grain((0.01 + separation, 0.01, 0.01))], Material(friction=friction), time_step=DT)
    scene.commands(command, "fix move all nve/noforce")
    rows = []
    scene.run(1)
    scene.commands("fix_modify bonds armed no")
    for speed, count in ((velocity, steps), (then, then_steps), (last, last_steps)):
        if count:
            scene.assign("v", np.array([[0.0, 0.0, 0.0], speed]))
            if rearm and speed != velocity:
                scene.commands("fix_modify bonds armed yes")
        for _ in range(count):
            scene.run(1, setup=setup)
            contacts = scene.contact_rows()
            rows.append((scene.engine.step, scene.gather("x")[1, 0] - scene.gather("x")[0, 0], scene.gather("f")[1].copy(),
                         scene.intact_bonds(), contacts[0, 5:9].copy() if len(contacts) else None))
    return {"rows": rows, "breaks": scene.take_breaks(), "counts": [scene.fix_value("bonds", column) for column in range(1, 6)]}


def pulled_pair(**arguments) -> dict:
    return run_scene(pulled_pair_scene, **arguments)[0]


AREA = np.pi * 1.0e-6  # m2, of the grains' radius 1 mm


def approach(way: float, direction: tuple, speed: float) -> dict:
    """Arguments of pulled_pair that cover a way ever more slowly, and then a little more, in steps of a 2500th of speed * DT at its end."""
    fast, medium = speed * DT, speed * DT / 50
    fast_steps = int(way / fast) - 1
    medium_steps = int((way - fast_steps * fast) / medium) - 1
    names = (("velocity", "steps"), ("then", "then_steps"), ("last", "last_steps"))
    phases = ((speed, fast_steps), (speed / 50, medium_steps), (speed / 2500, 600))
    return {key: value for (v, n), (rate, count) in zip(names, phases) for key, value in ((v, tuple(rate * c for c in direction)), (n, count))}


def test_tension_up_to_the_bonds_own_strength_then_nothing() -> None:
    limit = strength(1, 2, 1e6, 0.3e6, 1e5, SEED) * AREA
    result = pulled_pair(command=bond_command(), **approach(1.0e-6 + limit / 1e6, (1, 0, 0), 0.1))
    tension = np.array([-f[0] for _, _, f, _, _ in result["rows"]])
    intact = np.array([bonds for *_, bonds, _ in result["rows"]], dtype=bool)
    assert tension.max() <= limit < tension.max() + 1e6 * 0.1 / 2500 * DT * 1.001  # to within the last, slow step
    assert np.all(tension[~intact] == 0) and intact[0] and not intact[-1]
    opening = np.array([distance - 2.0e-3 for _, distance, *_ in result["rows"]])
    np.testing.assert_allclose(tension[intact], 1e6 * opening[intact], atol=1e-12)
    (row,) = result["breaks"]
    assert row[0] == np.array([step for step, *_ in result["rows"]])[~intact][0]
    assert list(row[1:4]) == [1, 2, 1]
    assert -row[7] == pytest.approx(1e6 * opening[~intact][0], abs=1e-12)
    assert row[9] == pytest.approx(row[7] ** 2 / 2e6, rel=1e-12)
    assert result["counts"] == [0, 1, 0, 1, 0]


@pytest.mark.parametrize(("away", "speed", "setup"), [(500, 1.0, False), (500, 1.0, True), (1600, 5.0, False)],
                         ids=["still a neighbour", "lists made anew at each step", "no longer a neighbour"])
def test_a_broken_pair_returns_unbonded_even_while_armed(away: int, speed: float, setup: bool) -> None:
    """Parted by 0.05 and 0.8 mm (the neighbour list reaches 0.6 mm), pushed together and parted again."""
    result = pulled_pair(velocity=(speed, 0, 0), command=bond_command(), steps=away, then=(-speed, 0, 0), then_steps=away + 10, rearm=True,
                         last=(1.0, 0, 0), last_steps=200, setup=setup)
    assert len(result["breaks"]) == 1
    returned = result["rows"][2 * away + 8 :]
    assert returned[0][4][0] > 0 and all(bonds == 0 for *_, bonds, _ in returned)
    assert min(force[0] for _, _, force, *_ in returned) == 0  # no tension on parting again
    assert result["counts"] == [0, 1, 0, 1, 0]


def test_a_gap_bonded_pair_starts_without_force() -> None:
    gap = 3.0e-6
    reach = pulled_pair(velocity=(0.1, 0, 0), command=bond_command(gap="4e-6"), steps=100, separation=2.0e-3 + gap)
    for _, distance, force, bonds, contact in reach["rows"]:
        assert bonds == 1
        assert -force[0] == pytest.approx(1e6 * (distance - 2.0e-3 - gap), abs=1e-12)
        assert contact[0] == pytest.approx(force[0], abs=1e-15)
    pushed = pulled_pair(velocity=(-1.0, 0, 0), command=bond_command(gap="4e-6"), steps=60, separation=2.0e-3 + gap)
    assert pushed["rows"][-1][2][0] == pytest.approx(1e6 * 6e-6, rel=1e-9)  # 3 um beyond touching: still from the gap
    beyond = pulled_pair(velocity=(0.1, 0, 0), command=bond_command(gap="2e-6"), steps=2, separation=2.0e-3 + gap)
    assert beyond["rows"][0][3] == 0 and beyond["counts"][1] == 0


def test_bonds_without_strength_never_hold_and_infinite_ones_always() -> None:
    nothing = pulled_pair(velocity=(0.5, 0, 0), command=bond_command(mean="0", deviation="0"), steps=100)
    assert min(force[0] for _, _, force, *_ in nothing["rows"]) == 0
    assert nothing["counts"][0] == 0 and len(nothing["breaks"]) == 1  # in tension, or before by the first rounding error in shear
    endless = pulled_pair(velocity=(5.0, 3.0, 0), command=bond_command(mean="infinite", deviation="0"), steps=150)
    assert endless["rows"][-1][3] == 1 and endless["rows"][-1][2][0] < -70 and not len(endless["breaks"])


def test_shear_is_not_limited_by_friction_while_bonded_then_breaks_at_its_strength() -> None:
    """Overlap 1 um: F_n = 1 N, friction carries 0.5 N; the bond carries S = T."""
    command = bond_command(deviation="0")
    limit = 1e6 * AREA
    result = pulled_pair(command=command, **approach(limit / 5e5, (0, 1, 0), 0.5))
    shear = np.array([np.linalg.norm(contact[1:4]) for *_, contact in result["rows"]])
    intact = np.array([bonds for *_, bonds, _ in result["rows"]], dtype=bool)
    assert shear[intact].max() <= limit < shear[intact].max() + 5e5 * 0.5 / 2500 * DT * 1.01
    normal = np.array([contact[0] for *_, contact in result["rows"]])
    np.testing.assert_allclose(shear[~intact], 0.5 * normal[~intact], rtol=1e-12)  # cut to mu F_n
    (row,) = result["breaks"]
    assert row[3] == 2 and row[8] == pytest.approx(limit, rel=1e-5)
    assert row[9] == pytest.approx((row[8] ** 2 - (0.5 * row[7]) ** 2) / (2 * 5e5), rel=1e-6)
    never = pulled_pair(velocity=(0, 0.5, 0), command=bond_command(deviation="0", ratio="infinite"), steps=150)
    assert never["rows"][-1][3] == 1


def test_shear_break_out_of_compression_loses_all_force() -> None:
    result = pulled_pair(velocity=(0, 0.5, 0), command=bond_command(deviation="0", ratio="0.5", gap="1e-6"), steps=100, separation=2.0005e-3)
    (row,) = result["breaks"]
    assert row[3] == 2
    broken = [force for _, _, force, bonds, _ in result["rows"] if not bonds]
    assert broken and all(np.all(force == 0) for force in broken)


def contact_row_scene(comm, first_on_the_right: bool) -> dict:
    centres = [(0.01, 0.01, 0.01), (0.011999, 0.01, 0.01)]
    if first_on_the_right:  # the engine sorts grains along x, so that it sees this pair from the higher id
        centres.reverse()
    scene = Scene(comm, [Grain(centres[0], type=1, v=(0, 1, 0.5)), Grain(centres[1], type=2, omega=(100, 0, 0))])
    scene.commands("fix move all nve/noforce")
    scene.run(5)
    return {"row": scene.contact_rows()[0], "x": scene.gather("x"), "f": scene.gather("f")}


@pytest.mark.parametrize("first_on_the_right", [False, True])
def test_forces_of_the_contact_list_are_those_on_the_lower_id(first_on_the_right: bool) -> None:
    r = run_scene(contact_row_scene, first_on_the_right=first_on_the_right)[0]
    separation = r["x"][0] - r["x"][1]
    distance = np.linalg.norm(separation)
    row = r["row"]
    assert list(row[:5]) == [1, 2, 1, 2, 0]
    np.testing.assert_allclose(row[5] * separation / distance + row[6:9], r["f"][0], atol=1e-12)
    assert row[9] == pytest.approx(2.0e-3 - distance, abs=1e-17)
    np.testing.assert_allclose(row[10:13], r["x"][1] + separation / 2, atol=1e-16)


def bonded_types_scene(comm, command: str) -> list:
    types = [1, 1, 2, 2, 3, 3]
    grains = [Grain((0.01 + k * 1.999e-3, 0.01, 0.01), type=kind) for k, kind in enumerate(types)]
    scene = Scene(comm, grains, time_step=DT)
    scene.commands("group few id 1 2", command, "fix move all nve/noforce")
    scene.run(1)
    return [(int(row[0]), int(row[1])) for row in scene.contact_rows() if row[4]]


@pytest.mark.parametrize(("types", "group", "expected"), [("1 1 3 3", "all", [(1, 2), (5, 6)]), ("1 2", "all", [(2, 3)]), ("2 2", "few", []),
                                                          ("1 1 3 3", "few", [(1, 2)])])
def test_only_listed_types_of_the_group_are_bonded(types: str, group: str, expected: list) -> None:
    command = bond_command(types=types).replace("fix bonds all", f"fix bonds {group}")
    assert run_scene(bonded_types_scene, command=command)[0] == expected


def cluster_scene(comm, style: str, bonds: bool) -> dict:
    """27 grains that fall together, with friction and damping."""
    random = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.arange(3)] * 3), axis=-1).reshape(-1, 3)
    grains = [Grain(tuple(0.01 + 2.0e-3 * cell + random.uniform(-1e-6, 1e-6, 3)), v=tuple(random.normal(0, 0.1, 3) - 0.5 * cell)) for cell in grid - 1]
    scene = Scene(comm, grains, Material(gamman=1e4, gammat=5e3), style=style)
    scene.commands("neigh_modify binsize 0.005", "atom_modify sort 0 0.0")  # the order of the sums follows bins and sorting
    if bonds:
        scene.commands(bond_command(armed="no"))
    scene.commands("fix floor all wall/plane normal 0 0 1 position 0.00698 kn 1e6 gamman 1e4 velocity 0.", "fix move all nve/sphere")
    scene.run(60)
    contacts = scene.contact_rows()
    scene.run(1000)
    return {"contacts": contacts, "x": scene.gather("x"), "omega": scene.gather("omega")}


def test_never_armed_it_is_the_stock_frictional_contact_to_the_last_bit() -> None:
    """The stock model forgets the shear of a parted contact only with computeElasticPotential on (else at the next neighbour list)."""
    stock, bond = (run_scene(cluster_scene, style=style, bonds=bonds)[0] for style, bonds in (("tangential history computeElasticPotential on", False), ("tangential bond", True)))
    assert len(stock["contacts"]) > 10 and np.abs(stock["contacts"][:, 6:9]).max() > 0
    for name in stock:
        np.testing.assert_array_equal(stock[name], bond[name])


def test_a_bond_longer_than_stretch_max_is_refused() -> None:
    with pytest.raises(SceneError, match="bond of grains 1 and 2 is 0.0505 of .* more than stretch_max 0.05"):
        pulled_pair(velocity=(10.0, 0, 0), command=bond_command(mean="infinite", deviation="0"), steps=200)
