"""Packs: the grains they start from, the exchange of sizes, and what a box of some hundred grains reaches."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from coupling.case.schema import Pack
from coupling.engine.interface import Contacts
from coupling.stages.pack import aimed_porosity, densest_porosity, exchange_step, is_loose, packing_friction, random_porosity, write_grains
from coupling.stages.packing import solid_volume_within
from coupling.stages.size_exchange import exchange_sizes

BOX = (0.02, 0.014, 0.016)
#: What the fits of coupling/stages/pack.py are good for, in boxes this small.
POROSITY_TOLERANCE, SIZE_TOLERANCE = 0.015, 0.012
MAKE = Path(__file__).with_name("packing_box.py")


def rows(path: Path) -> np.ndarray:
    return np.loadtxt(path.read_text().split("Atoms", 1)[1].splitlines())


# -- the grains -----------------------------------------------------------------------------------------------------------


def test_grains_are_made_from_the_seed_alone(tmp_path):
    pack = Pack(box_m=BOX)
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        write_grains(Pack(box_m=BOX, seed=seed), tmp_path / name, False)
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1] != texts[2]
    grains = rows(tmp_path / "a")
    assert np.array_equal(grains[:, 0], np.arange(1, len(grains) + 1))
    assert grains[:, 2].min() >= pack.diameter_m[0] and grains[:, 2].max() <= pack.diameter_m[1]
    assert np.all(grains[:, 4:] > 0.0) and np.all(grains[:, 4:] < BOX)


@pytest.mark.parametrize("porosity", [0.2, 0.38, 0.45, 0.6])
@pytest.mark.parametrize("ratio", [1.0, 1.2, 3.0])
def test_solid_volume_is_that_of_the_aim(tmp_path, porosity, ratio):
    pack = Pack(box_m=(0.04, 0.03, 0.05), diameter_m=(2e-3 * 2 / (1 + ratio), 2e-3 * 2 * ratio / (1 + ratio)), porosity=porosity)
    count = write_grains(pack, tmp_path / "grains", False)
    diameter = rows(tmp_path / "grains")[:, 2]
    assert count == len(diameter)
    solid = (np.pi / 6.0 * diameter**3).sum() / math.prod(pack.box_m)
    # Some grains more than that: those that will be left without contacts.
    assert 0.98 * (1.0 - aimed_porosity(pack, False)) < solid < 1.6 * (1.0 - aimed_porosity(pack, False))


def test_walls_make_a_pack_looser_and_a_spread_of_sizes_denser():
    thick, thin = Pack(box_m=(0.08, 0.02, 0.05)), Pack(box_m=(0.08, 0.01, 0.05))
    assert random_porosity(thick, True) < random_porosity(thick, False) < random_porosity(thin, False)
    assert densest_porosity(thick, False) == pytest.approx(0.35, abs=2e-3)
    equal = Pack(diameter_m=(2e-3, 2e-3))
    assert densest_porosity(equal, False) == pytest.approx(random_porosity(equal, False))


def test_looser_packs_take_shorter_exchanges_then_friction():
    packs = [Pack(porosity=porosity) for porosity in (0.3, 0.35, 0.36, 0.37, 0.38, 0.42, 0.45)]
    steps = [exchange_step(pack, False) for pack in packs]
    assert steps == sorted(steps, reverse=True) and steps[0] == steps[1] == 1.5
    frictions = [packing_friction(pack, False) for pack in packs]
    assert frictions == sorted(frictions) and frictions[:5] == [0.0] * 5 and frictions[5] > 0.0
    assert [is_loose(pack, False) for pack in packs] == [False] * 5 + [True] * 2
    given = Pack(porosity=0.35, friction=0.3)
    assert is_loose(given, False) and packing_friction(given, False) == 0.3


# -- the exchange of sizes -------------------------------------------------------------------------------------------------


class OneRank:
    def allgather(self, value):
        return [value]

    def allreduce(self, value):
        return value


def grains_in_a_row(radius, position, ids=None):
    """An engine with grains along x, whose contacts are those of neighbours in the row, and no wall near."""
    radius, position = np.array(radius), np.array([[x, 0.0, 0.0] for x in position])
    ids = np.arange(1, len(radius) + 1) if ids is None else np.array(ids)
    arrays = {"id": ids.astype(np.int32), "radius": radius, "rmass": 2650.0 * radius**3, "x": position}
    overlap = radius[:-1] + radius[1:] - np.diff(position[:, 0])
    touch = overlap > 0
    pairs = np.stack([ids[:-1], ids[1:]], axis=1).astype(np.int64)[touch]
    nothing = np.zeros((len(pairs), 3))
    contacts = Contacts(pairs, pairs.astype(np.int32), touch[touch], overlap[touch], nothing, overlap[touch], nothing, 0.5 * overlap[touch] ** 2)
    walls = {"x_left": SimpleNamespace(position=-1.0), "x_right": SimpleNamespace(position=1.0)}
    return SimpleNamespace(atom=arrays.__getitem__, contacts=lambda: contacts, wall=walls.__getitem__)


def test_the_squeezed_grain_becomes_small_and_the_loose_one_large():
    # The second is squeezed most, the last is loose.
    engine = grains_in_a_row([1.1e-3, 1.2e-3, 1.0e-3, 1.15e-3], [0.0, 2.0e-3, 4.0e-3, 9.0e-3])
    density = engine.atom("rmass") / engine.atom("radius") ** 3
    exchange_sizes(engine, OneRank(), ["x_left", "x_right"], 3.0)
    radius = engine.atom("radius")
    assert sorted(radius) == [1.0e-3, 1.1e-3, 1.15e-3, 1.2e-3]
    assert radius.argmin() == 1 and radius.argmax() == 3
    assert engine.atom("rmass") / radius**3 == pytest.approx(density, rel=1e-14)


def test_a_small_step_leaves_every_size_in_its_place():
    engine = grains_in_a_row([1.1e-3, 1.2e-3, 1.0e-3, 1.15e-3], [0.0, 2.0e-3, 4.0e-3, 9.0e-3])
    exchange_sizes(engine, OneRank(), ["x_left", "x_right"], 1e-3)
    assert list(engine.atom("radius")) == [1.1e-3, 1.2e-3, 1.0e-3, 1.15e-3]


def test_the_exchange_does_not_depend_on_the_order_of_the_grains():
    radius, position, ids = np.array([1.1e-3, 1.2e-3, 1.0e-3, 1.15e-3]), np.array([0.0, 2.0e-3, 4.0e-3, 9.0e-3]), [7, 2, 9, 4]
    forwards, backwards = grains_in_a_row(radius, position, ids), grains_in_a_row(radius[::-1], 9.0e-3 - position[::-1], ids[::-1])
    for engine in (forwards, backwards):
        exchange_sizes(engine, OneRank(), ["x_left", "x_right"], 1.0)
    assert list(forwards.atom("radius")) == list(backwards.atom("radius")[::-1])


@pytest.mark.parametrize("radius", [[1e-3, 1e-3, 1e-3], [0.9e-3, 0.8e-3, 0.7e-3]], ids=["equal sizes", "no contact"])
def test_nothing_to_exchange(radius):
    engine = grains_in_a_row(radius, [0.0, 1.9e-3, 4.0e-3] if radius[0] == 1e-3 else [0.0, 3e-3, 6e-3])
    exchange_sizes(engine, OneRank(), ["x_left", "x_right"], 1.0)
    assert list(engine.atom("radius")) == radius


# -- solid volume ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("inside, fraction", [(2.0, 1.0), (0.0, 0.5), (-2.0, 0.0), (0.5, 27.0 / 32.0)])
def test_a_sphere_at_a_face(inside, fraction):
    """inside: distance of the centre from the face, in radii; the cap of height h R holds h^2 (3 - h) / 4 of the sphere."""
    volume = solid_volume_within(np.array([[10.0, 10.0, inside]]), np.ones(1), np.zeros(3), np.full(3, 20.0), periodic_z=False)
    assert volume == pytest.approx(fraction * 4.0 / 3.0 * math.pi, rel=1e-14)
    if fraction < 1.0:
        assert solid_volume_within(np.array([[10.0, 10.0, inside]]), np.ones(1), np.zeros(3), np.full(3, 20.0), periodic_z=True) > volume


# -- whole packs -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def make(mpirun, tmp_path):
    """`make(*overrides, ranks=1, scene="two_sides")`: a pack of some hundred grains, as packing_box.py prints it."""

    def run(*overrides: str, ranks: int = 1, scene: str = "two_sides") -> dict:
        case = tmp_path / "box.toml"
        case.write_text(
            f'scene = "{scene}"\npressure.mode = "none"\nfault.gouge_width_m = 0.0045\nfault.end_band_m = 0.0\n'
            f"fault.dip_degrees = {90 if scene == 'supplement' else 80}\npack.box_m = {list(BOX)}\n")
        done = mpirun(ranks, [MAKE, case, tmp_path, *overrides])
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run


def near_the_aim(made: dict, aim: float, tolerance: float = POROSITY_TOLERANCE) -> None:
    assert made["porosity"] == pytest.approx(aim, abs=tolerance)
    assert made["size_m"] == pytest.approx(list(BOX), rel=SIZE_TOLERANCE)
    assert made["porosity_bulk"] < made["porosity"]
    assert list(made["stress_Pa"].values()) == pytest.approx([1e7] * len(made["stress_Pa"]), rel=0.03)
    assert made["grains"] == made["grains_started"] - made["floaters"] == len(made["radii"])


@pytest.mark.parametrize("seed", [1, 2])
def test_as_dense_as_it_gets(make, seed):
    made = make(f"pack.seed={seed}")
    near_the_aim(made, densest_porosity(Pack(box_m=BOX), False))
    assert made["floaters"] <= 0.03 * made["grains_started"]
    assert made["densities"] == pytest.approx([2650.0, 2650.0], rel=1e-10)


@pytest.mark.parametrize("aim, tolerance", [(0.39, 0.015), (0.41, 0.015), (0.46, 0.03)])
def test_as_loose_as_asked_for(make, aim, tolerance):
    near_the_aim(make(f"pack.porosity={aim}"), aim, tolerance)


def test_the_same_again(make):
    first, second = make(), make()
    assert first["state"] == second["state"]


@pytest.mark.parallel
def test_two_ranks_make_as_dense_a_pack(make):
    """The same start; after thousands of steps rounding has made another, equally dense, pack of the same sizes."""
    one, two = make(), make(ranks=2)
    assert one["grains_started"] == two["grains_started"]
    assert two["porosity"] == pytest.approx(one["porosity"], abs=0.01)
    near_the_aim(two, densest_porosity(Pack(box_m=BOX), False))


def test_periodic_along_z(make):
    made = make(scene="supplement")
    assert set(made["stress_Pa"]) == {"x_left", "x_right", "y_front", "y_back"} and made["size_m"][2] == BOX[2]
    near_the_aim(made, densest_porosity(Pack(box_m=BOX), True))


@pytest.mark.parametrize("diameters", [[2e-3, 2e-3], [1.5e-3, 2.2e-3]])
def test_other_sizes(make, diameters):
    made = make(f"pack.diameter_m={diameters}", "pack.porosity=0.37")
    assert made["porosity"] == pytest.approx(0.40, abs=0.05)
    assert made["size_m"] == pytest.approx(list(BOX), rel=0.03)
    assert list(made["stress_Pa"].values()) == pytest.approx([1e7] * 6, rel=0.03)
