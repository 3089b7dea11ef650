"""The contact bond on one and two ranks, across periodic faces, and over a restart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from styles_reference import strength
from styles_scene import Grain, Material, Scene, run_scene

SETTINGS = "fix bonds all bond/settings strength_mean 1e6 strength_sd 0.3e6 seed 3 gap 1e-6 types 1 1 armed "
MATERIAL = Material(gamman=2.0e4, gammat=1.0e4)


def block(rows: tuple[int, int, int] = (6, 4, 4), drift: float = 0.0) -> list[Grain]:
    """Grains on a cubic lattice about the middle of the box, where two ranks meet at x = 0.02 m; the halves part slowly."""
    random = np.random.default_rng(1)
    cells = np.stack(np.meshgrid(*[np.arange(n) for n in rows], indexing="ij"), axis=-1).reshape(-1, 3)
    centres = np.array([0.02, 0.01, 0.01]) + 1.999e-3 * (cells - (np.array(rows) - 1) / 2)
    velocity = random.normal(0, 0.15, (len(cells), 3)) + np.array([drift, 0, 0])
    velocity[:, 0] += 0.4 * np.sign(cells[:, 0] - rows[0] / 2 + 0.5)
    return [Grain(tuple(x), v=tuple(v)) for x, v in zip(centres, velocity)]


def breaking_block_scene(comm, drift: float, steps: int, restart: str | None = None) -> dict:
    """A bonded block torn apart; `restart` writes the state half way."""
    scene = Scene(comm, block(drift=drift), MATERIAL, style="tangential bond stretch_max 0.03")
    scene.commands(SETTINGS + "yes", "fix move all nve/sphere")
    scene.run(1)
    scene.commands("fix_modify bonds armed no")
    formed = scene.contact_rows()
    scene.run(steps // 2 - 20)
    scene.run(20)  # the breaks before its set-up are known to all ranks at the end, those after it not yet
    if restart:
        scene.engine.write_restart(Path(restart))
    breaks = scene.take_breaks()
    scene.run(steps - steps // 2)
    return {**final_state(scene), "formed": formed, "breaks_before": breaks, "breaks": scene.take_breaks()}


def final_state(scene: Scene) -> dict:
    return {"x": scene.gather("x"), "v": scene.gather("v"), "omega": scene.gather("omega"), "f": scene.gather("f"),
            "contacts": scene.contact_rows(), "bonds": scene.intact_bonds(), "counts": [scene.fix_value("bonds", c) for c in range(1, 6)],
            "grains": scene.comm.allgather(len(scene.engine.atom("id")))}


def resumed_block_scene(comm, restart: str, steps: int) -> dict:
    scene = Scene.from_restart(comm, Path(restart), MATERIAL, style="tangential bond stretch_max 0.03")
    scene.commands("fix bonds all bond/settings armed no", "fix move all nve/sphere")
    scene.run(steps)
    return {**final_state(scene), "breaks": scene.take_breaks()}


@pytest.mark.parallel
def test_one_and_two_ranks_break_the_same_bonds() -> None:
    """A block that drifts from one rank to the other while it breaks: 3 mm on the way."""
    one = run_scene(breaking_block_scene, drift=1.0, steps=3000)[0]
    two = run_scene(breaking_block_scene, ranks=2, drift=1.0, steps=3000)[0]
    assert min(two["grains"]) > 0
    np.testing.assert_array_equal(one["formed"][:, :5], two["formed"][:, :5])
    assert len(one["breaks_before"]) > 10
    for name in ("breaks_before", "breaks"):
        np.testing.assert_array_equal(one[name][:, :4], two[name][:, :4])  # step, ids, mode
        np.testing.assert_allclose(one[name][:, 4:], two[name][:, 4:], rtol=1e-8, atol=1e-9)
    assert one["bonds"] == two["bonds"] == one["counts"][0] and one["counts"] == two["counts"]
    assert one["counts"][1] == len(one["formed"]) == one["bonds"] + len(one["breaks_before"]) + len(one["breaks"])
    np.testing.assert_allclose(one["x"], two["x"], atol=1e-12)


def crossing_pair_scene(comm) -> dict:
    """Two bonded grains that turn about each other and drift across x = 0.02 m, pulled to breaking just there."""
    scene = Scene(comm, [Grain((0.0185, 0.01, 0.01), v=(2.0, 0.1, 0)), Grain((0.0205, 0.01, 0.01), v=(2.01, -0.1, 0.05))], time_step=1e-7)
    scene.commands(SETTINGS + "yes", "fix move all nve/noforce")
    owners = []
    scene.run(1)
    for _ in range(60):
        scene.run(50)
        owners.append(comm.allgather(len(scene.engine.atom("id"))))
    return {"owners": owners, "breaks": scene.take_breaks(), "bonds": scene.intact_bonds(), "f": scene.gather("f")}


@pytest.mark.parallel
def test_a_bond_across_the_rank_boundary_breaks_in_the_same_step() -> None:
    one = run_scene(crossing_pair_scene)[0]
    two = run_scene(crossing_pair_scene, ranks=2)[0]
    assert [1, 1] in two["owners"] and len(one["breaks"]) == 1
    np.testing.assert_array_equal(one["breaks"], two["breaks"])
    np.testing.assert_array_equal(one["f"], two["f"])


def crossing_sheared_pair_scene(comm) -> dict:
    """Two grains in sheared contact, bonded for good, that drift across x = 0.02 m; lists are made anew at each stop."""
    grains = [Grain((0.0175, 0.01, 0.01), v=(10.0, 0.05, 0.02)), Grain((0.01949, 0.01, 0.01), v=(10.0, -0.05, 0), omega=(0, 20, 10))]
    scene = Scene(comm, grains, time_step=1e-7)
    scene.commands("fix bonds all bond/settings strength_mean infinite strength_sd 0 seed 3 types 1 1 armed yes", "fix move all nve/noforce")
    owners, contacts, forces = [], [], []
    for _ in range(60):
        scene.run(50)
        owners.append(comm.allgather(len(scene.engine.atom("id"))))
        contacts.append(scene.contact_rows())
        forces.append(scene.gather("f"))
    return {"owners": owners, "contacts": np.array(contacts), "forces": np.array(forces)}


@pytest.mark.parallel
def test_the_shear_of_a_contact_goes_with_it_across_the_rank_boundary() -> None:
    one = run_scene(crossing_sheared_pair_scene)[0]
    two = run_scene(crossing_sheared_pair_scene, ranks=2)[0]
    assert [1, 1] in two["owners"] and [0, 2] in two["owners"]
    shear = np.linalg.norm(one["contacts"][:, 0, 6:9], axis=1)
    assert np.all(np.diff(shear) > 0) and shear[-1] > 10
    for name in ("contacts", "forces"):
        np.testing.assert_array_equal(one[name], two[name])


def lattice_scene(comm) -> dict:
    """A lattice of widely spread strengths, stretched along x until all bonds in that direction are broken."""
    scene = Scene(comm, block((8, 3, 3)), MATERIAL)
    scene.commands(SETTINGS.replace("strength_sd 0.3e6", "strength_sd 0.8e6 strength_floor 0.2e6") + "yes", "fix move all nve/noforce")
    scene.run(1)
    scene.commands("fix_modify bonds armed no")
    formed = scene.contact_rows()
    stretch = np.zeros((72, 3))
    stretch[:, 0] = 50.0 * (scene.gather("x")[:, 0] - 0.02)
    scene.assign("v", stretch)
    scene.run(1500)
    return {"formed": formed, "breaks": scene.take_breaks(), "counts": [scene.fix_value("bonds", column) for column in range(1, 6)]}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_strengths_are_those_of_the_hash_on_any_number_of_ranks(ranks: int) -> None:
    def drawn(id_i: float, id_j: float) -> float:
        return strength(int(id_i), int(id_j), 1e6, 0.8e6, 0.2e6, 3)

    result = run_scene(lattice_scene, ranks=ranks)[0]
    step_force = 1e6 * 50.0 * 2.0e-3 * 1e-7  # N, growth of the tension in one step
    assert len(result["breaks"]) == 63  # of 7 x 9 bonds along x
    for _, id_i, id_j, mode, *_, normal, _, _ in result["breaks"]:
        limit = drawn(id_i, id_j) * np.pi * 1.0e-6
        assert mode == 1 and limit < -normal < limit + 1.01 * step_force
    strengths = [drawn(*row[:2]) for row in result["formed"] if row[4]]
    at_floor = strengths.count(0.2e6)
    assert result["counts"] == [len(strengths) - 63, len(strengths), at_floor, 63, 0] and at_floor > 5


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_restart_is_bitwise(ranks: int, tmp_path: Path) -> None:
    restart = str(tmp_path / "half.restart")
    through = run_scene(breaking_block_scene, ranks=ranks, drift=1.0, steps=240, restart=restart)[0]
    resumed = run_scene(resumed_block_scene, ranks=ranks, restart=restart, steps=120)[0]
    assert len(through["breaks"]) >= 3 and len(through["breaks_before"]) >= 3
    for name in ("x", "v", "omega", "f", "contacts", "breaks", "bonds", "counts"):
        np.testing.assert_array_equal(through[name], resumed[name], err_msg=name)


def rearmed_block_scene(comm, restart: str) -> set:
    """Pairs that are bonded after arming again, with a gap that takes in most of the broken ones."""
    scene = Scene.from_restart(comm, Path(restart), MATERIAL, style="tangential bond stretch_max 0.03")
    scene.commands(SETTINGS.replace("gap 1e-6", "gap 3e-5") + "yes", "fix move all nve/sphere")
    scene.run(2)
    return {(row[0], row[1]) for row in scene.contact_rows() if row[4]}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_broken_pairs_are_remembered_over_a_restart(ranks: int, tmp_path: Path) -> None:
    restart = str(tmp_path / "half.restart")
    before = run_scene(breaking_block_scene, ranks=ranks, drift=1.0, steps=240, restart=restart)[0]
    broken = {(row[1], row[2]) for row in before["breaks_before"]}
    formed = {(row[0], row[1]) for row in before["formed"] if row[4]}
    bonded = run_scene(rearmed_block_scene, ranks=ranks, restart=restart)[0]
    assert len(broken) >= 3 and formed - broken <= bonded and not bonded & broken


def periodic_scene(comm, shift: float) -> dict:
    """A bonded row along periodic x, stretched until it breaks at its weakest bond wherever the faces are."""
    count = 20
    grains = [Grain(((shift + 2.0e-3 * k) % 0.04, 0.01, 0.01), v=(1.2 * np.sin(2 * np.pi * k / count), 0, 0)) for k in range(count)]
    scene = Scene(comm, grains, MATERIAL, boundary="p f f", time_step=1e-7)
    scene.commands(SETTINGS + "yes", "fix move all nve/sphere")
    scene.run(1)
    scene.commands("fix_modify bonds armed no")
    bonds = scene.intact_bonds()
    for _ in range(20):
        scene.run(40)
    breaks = scene.take_breaks()
    momentum = (scene.gather("v") * scene.gather("rmass")[:, None]).sum(axis=0)
    return {"formed": bonds, "left": scene.intact_bonds(), "breaks": breaks, "momentum": momentum,
            "f": scene.gather("f").sum(axis=0)}


@pytest.mark.parallel
def test_bonds_across_a_periodic_face() -> None:
    results = [run_scene(periodic_scene, ranks=ranks, shift=shift)[0] for ranks, shift in ((1, 0.0), (2, 0.0), (1, 7.3e-3))]
    for result in results:
        assert result["formed"] == 20 and 0 < len(result["breaks"]) < 20
        assert result["left"] == 20 - len(result["breaks"])
        np.testing.assert_allclose(result["f"], 0, atol=2e-11)  # kn times the last bit of 0.04 m
        np.testing.assert_allclose(result["momentum"], 0, atol=1e-15)
        np.testing.assert_array_equal(result["breaks"][:, :4], results[0]["breaks"][:, :4])


def last_bit_scene(comm, far_first: bool, rebuild_every: int) -> dict:
    """A bond across the periodic face that nears its strength by 2e-19 m a step, where positions near 0.04 m have a last bit of 7e-18 m."""
    stretch = np.pi * 1.0e-6 * 1.0e6 / 1.0e6  # m, T / kn
    near, far = 1.0e-3, 0.04 - 2.0e-3 - stretch + 1.0e-3
    order = [0, 1] if far_first else [1, 0]
    positions = np.array([[far, 0.01, 0.01], [near, 0.01, 0.01]])
    overlapping = positions + np.array([[stretch + 1e-6, 0, 0], [0, 0, 0]])
    scene = Scene(comm, [Grain(tuple(x)) for x in overlapping[order]], boundary="p f f")
    scene.commands("fix bonds all bond/settings strength_mean 1e6 strength_sd 0 seed 3 types 1 1 armed yes", "fix move all nve/noforce",
                   f"neigh_modify every {rebuild_every} check no")
    scene.run(1)
    scene.commands("fix_modify bonds armed no")
    positions[1, 0] -= 2.0e-17
    scene.assign("x", positions[order])
    scene.assign("v", np.array([[0, 0, 0], [2.0e-12, 0, 0]])[order])
    force_sums = []
    for step in range(120):
        scene.run(1, setup=step == 0)
        force_sums.append(scene.gather("f")[:, 0].sum())
    return {"apart": int(np.sum(np.abs(force_sums) > 1.0)), "breaks": scene.take_breaks(), "bonds": scene.intact_bonds()}


@pytest.mark.parametrize("far_first", [True, False])
def test_copies_of_a_bond_that_differ_in_the_last_bit_are_broken_together(far_first: bool) -> None:
    rarely, each_step = (run_scene(last_bit_scene, far_first=far_first, rebuild_every=every)[0] for every in (1000, 1))
    assert rarely["apart"] == 2  # one copy holds two steps longer than the other: the case at hand
    assert each_step["apart"] == 1
    for result in (rarely, each_step):
        assert result["bonds"] == 0 and len(result["breaks"]) == 1
        assert -result["breaks"][0, 7] == pytest.approx(np.pi, rel=1e-9)
