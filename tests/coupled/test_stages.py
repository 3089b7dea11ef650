"""Stages before loading: kept between runs, made anew when what made them differs or is damaged, refused when no pack can come of them."""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from processes import the_message
from tiny_fault import history, settings

SEVERAL = pytest.param(2, marks=pytest.mark.parallel)


@pytest.fixture
def cache(run_fault, stage_cache, tmp_path) -> Path:
    """A cache of the test's own, with the stages of the tiny fault in it."""
    run_fault(run="dry", out="makes-the-stages")
    return shutil.copytree(stage_cache, tmp_path / "cache")


@pytest.fixture
def run(poreslip, tiny_case, tmp_path, cache):
    """`run(*overrides, out="out", ranks=1)`: run the dry tiny fault with that cache; what came of it."""

    def start(*overrides: str, out: str | Path = "out", ranks: int = 1, **env: str):
        command = ["run", tiny_case, "--only", "dry", "--out", tmp_path / out, *settings(*overrides)]
        return poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(cache)} | env)

    return start


def kept(cache: Path) -> dict[str, float]:
    """Stages in the cache, with the times at which their files were written."""
    return {path.name: (path / "engine.restart").stat().st_mtime for path in cache.iterdir()}


def test_stages_are_kept(run, cache):
    before = kept(cache)
    done = run("material.local_damping=0.1", "loading.horizontal_strain=1e-5", "output.history_interval_steps=10")
    assert done.returncode == 0, done.stderr
    assert "packing" not in done.stdout and "bonded" not in done.stdout
    assert kept(cache) == before


@pytest.mark.parametrize(
    "override, made",
    [
        ("pack.seed=2", ["bond", "pack", "stress"]),
        ("fault.gouge_width_m=0.0045", ["bond", "stress"]),
        ("bonds.seed=2", ["bond"]),
    ],
)
def test_what_differs_is_made_anew(run, cache, override, made):
    before = kept(cache)
    assert run(override).returncode == 0
    assert sorted(name.split("-")[0] for name in set(kept(cache)) - set(before)) == made


@pytest.mark.parallel
def test_the_same_on_any_number_of_ranks(run, cache, tmp_path):
    """A pack that two ranks make is another one: it has a key of its own, and one rank cannot make it."""
    one = {path.name: digest(path) for path in cache.iterdir()}
    shutil.rmtree(cache)
    assert run(ranks=3).returncode == 0
    # The session's cache may hold stages of other tests, too.
    three = {path.name: digest(path) for path in cache.iterdir()}
    assert len(three) == 3 and three.items() <= one.items()
    assert run("pack.ranks=2", ranks=3).returncode == 0
    assert len(set(kept(cache)) - set(three)) == 3
    assert run("pack.ranks=2").returncode == 0
    shutil.rmtree(cache)
    message = the_message(run("pack.ranks=2"), 2)
    assert "pack.ranks = 2 (run dry)" in message and "mpirun -n 2" in message


def digest(stage: Path) -> str:
    return json.loads((stage / "manifest.json").read_text())["restart_sha256"]


#: Beside the servos of in.stress: what they are to hold, Pa, and what an x wall and a plate bear, N.
RECORD = """\
variable       borne_x equal f_x_left[3]
variable       borne_plate equal f_z_bottom_left[3]
fix            record all print {every} "${{held}} ${{borne_x}} ${{borne_plate}} ${{area_x}} ${{area_bottom_left}}" file {file} title "" screen no
"""


def test_stiff_grains_are_unloaded_to_the_initial_stress(run, own_decks, tmp_path):
    """From the stress that the pack comes with, by equal ratios over 40000 steps, with walls and plates that follow."""
    deck, record = own_decks / "in.stress", tmp_path / "unloading.txt"
    before = "fix            damp all damping/local"
    assert deck.read_text().count(before) == 1
    deck.write_text(deck.read_text().replace(before, RECORD.format(every=4000, file=record) + before))
    stiff = ("material.stiffness_reading=literal", "material.modulus_Pa=1e10", "loading.horizontal_strain=1e-6", "output.history_interval_steps=10")
    done = run(*stiff, "pack.confining_stress_Pa=1e9", "pack.initial_stress_tolerance=0.02", f"decks_directory={own_decks}")
    assert done.returncode == 0, done.stderr
    held, borne_x, borne_plate, area_x, area_plate = np.loadtxt(record).T
    assert 1e9 * 0.01**0.1 < held[0] < 1e9 and held[10] == 1e7
    np.testing.assert_allclose(held[1:10] / held[:9], 0.01**0.1, rtol=1e-9)
    np.testing.assert_allclose(borne_x[:11] / area_x[:11], held[:11], rtol=0.05)
    np.testing.assert_allclose(borne_plate[:11] / area_plate[:11], held[:11], rtol=0.05)
    stresses = history(tmp_path / "out" / "tiny" / "dry")
    assert [stresses[name][0] for name in ("sigma_h_left_Pa", "sigma_h_right_Pa", "sigma_v_Pa")] == pytest.approx([1e7] * 3, rel=0.05)


@pytest.mark.parametrize("ranks", [1, SEVERAL])
@pytest.mark.parametrize("file", ["engine.restart", "manifest.json"])
def test_a_damaged_stage_is_made_anew(run, cache, file, ranks):
    for stage in cache.glob("bond-*"):
        content = (stage / file).read_bytes()
        (stage / file).write_bytes(content[: len(content) // 2])
    done = run(ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("bonded") == 1 and "packing" not in done.stdout
    assert "bonded" not in run(ranks=ranks).stdout


def test_a_stage_that_a_kill_left_is_removed(run, cache):
    old, young = cache / "pack-old.partial", cache / "pack-young.partial"
    for left in (old, young):
        left.mkdir()
    os.utime(old, (time.time() - 2 * 86400,) * 2)
    assert run("bonds.seed=5").returncode == 0
    assert not old.exists() and young.exists()


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_cache_that_cannot_be_written(run, tmp_path, ranks):
    (tmp_path / "file").write_text("")
    message = the_message(run(ranks=ranks, PORESLIP_CACHE=str(tmp_path / "file" / "cache")), 2)
    assert f"prepared stages cannot be kept in {tmp_path}/file/cache" in message
    assert "set PORESLIP_CACHE to a directory that can be written" in message


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_results_that_cannot_be_written(run, tmp_path, ranks):
    (tmp_path / "file").write_text("")
    message = the_message(run(out="file", ranks=ranks), 2)
    assert "file is a file, so no directory can be made there" in message


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_file_in_the_place_of_the_results(run, tmp_path, ranks):
    (tmp_path / "out" / "tiny").mkdir(parents=True)
    (tmp_path / "out" / "tiny" / "dry").write_text("")
    message = the_message(run(ranks=ranks), 2)
    assert f"{tmp_path}/out/tiny/dry" in message and "Check that the path exists, may be written" in message


def test_a_directory_in_the_place_of_a_table(run, tmp_path):
    (tmp_path / "out" / "tiny" / "dry" / "history.csv").mkdir(parents=True)
    assert "history.csv" in the_message(run(), 2)


@pytest.mark.parametrize(
    "override, part",
    [
        ("pack.box_m=[0.001, 0.001, 0.001]", "each side must hold three of the largest grains"),
        ("fault.gouge_width_m=0.02", "the gouge (width 0.02 m, dip 45) reaches"),
        ("pack.porosity=1.0", "pack.porosity = 1"),
        ("pack.diameter_m=[1e-8, 1e-8]", "more than the engine can number"),
    ],
)
def test_a_pack_that_cannot_be(run, override, part):
    assert part in the_message(run(override), 2)


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_a_pack_that_no_machine_holds(run, ranks):
    """The box in centimetres: 5e8 grains."""
    message = the_message(run("pack.box_m=[3.1, 0.7, 1.5]", ranks=ranks), 2)
    assert "pack.box_m = [3.1, 0.7, 1.5]" in message and "GB more than a machine of this run has free" in message


@pytest.mark.parametrize(
    "overrides, ranks",
    [
        # A handful of grains in a box of their size.
        pytest.param(("pack.porosity=0.9", "pack.box_m=[0.031, 0.0067, 0.015]"), 1, id="too few grains"),
        pytest.param(("pack.porosity=0.9", "pack.box_m=[0.031, 0.0067, 0.015]"), 2, id="too few grains-2", marks=pytest.mark.parallel),
        # Far beyond the stability limit.
        pytest.param(("pack.deck_variables.time_step=1e-4",), 1, id="too long a step"),
        # Under this stress the walls would meet.
        pytest.param(("pack.confining_stress_Pa=1e11",), 1, id="too much stress", marks=pytest.mark.slow),
    ],
)
def test_a_pack_that_fails(run, overrides, ranks, cache):
    message = the_message(run(*overrides, ranks=ranks), 3)
    assert "does not come to rest" in message or "grains were lost" in message
    assert not list(cache.glob("*.partial"))
