"""The files that the command `poreflow` writes: the same of any number of ranks, of which none puts the whole pack together."""

from __future__ import annotations

import json
import re
from pathlib import Path

import meshio
import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver.command.sorted_over_ranks import sorted_over_ranks

GRAINS = 60


@pytest.fixture(scope="module")
def dump(tmp_path_factory) -> Path:
    """A pack whose grains are numbered unevenly and in no order, with a period."""
    x, r = random_pack(GRAINS, (0.06, 0.1), seed=3)
    number = np.random.default_rng(5).permutation(GRAINS) ** 3 + 7
    rows = "".join(f"{k} {a:.17g} {b:.17g} {c:.17g} {s:.17g}\n" for k, (a, b, c), s in zip(number, x, r))
    path = tmp_path_factory.mktemp("dump") / "dump.grains"
    path.write_text(f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{GRAINS}\nITEM: BOX BOUNDS pp ff ff\n0 1\n0 1\n0 1\nITEM: ATOMS id x y z radius\n{rows}")
    return path


def arguments(dump: Path, directory: Path) -> list[str | Path]:
    return ["-m", "flowsolver", dump, "--face", "ymin=1", "--face", "ymax=0", "--json", directory / "out.json", "--forces", directory / "forces.npz", "--vtu", directory / "p.vtu"]


def written(mpirun, ranks: int, dump: Path, directory: Path) -> tuple[dict, dict[str, np.ndarray], np.ndarray]:
    """Report, forces, and (m, 4) places and pressures of the pores, sorted by place."""
    directory.mkdir()
    done = mpirun(ranks, arguments(dump, directory))
    assert done.returncode == 0, done.stderr
    picture = meshio.read(directory / "p.vtu")
    pores = np.column_stack([picture.points, picture.point_data["pressure"]])
    with np.load(directory / "forces.npz") as forces:
        return json.loads((directory / "out.json").read_text()), dict(forces), pores[np.lexsort(pores[:, :3].round(9).T)]


#: The command, and what its process came to by the system's own count.
PEAK = """
import sys
from pathlib import Path
from flowsolver.command.command_line import main
from mpi4py import MPI
status = main(sys.argv[1:])
peak = 1024 * int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
sums = MPI.COMM_WORLD.gather(peak)
if sums:
    print("peak", sum(sums))
sys.exit(status)
"""


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
def test_the_peak_of_memory_is_that_of_all_that_was_done(mpirun, dump, tmp_path, ranks):
    """Writing loads a library, and puts memory to use, that the computation does not."""
    done = mpirun(ranks, ["-c", PEAK, *arguments(dump, tmp_path)[2:]])
    assert done.returncode == 0, done.stderr
    peak = int(done.stdout.split("peak ")[1])
    told = json.loads((tmp_path / "out.json").read_text())["peak_memory_bytes"]
    assert 0.99 * peak < told <= peak


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 4])
def test_files_of_ranks_are_those_of_one(mpirun, dump, tmp_path, ranks):
    """Two and four ranks, against one."""
    one, forces, pores = written(mpirun, 1, dump, tmp_path / "one")
    several, forces_too, pores_too = written(mpirun, ranks, dump, tmp_path / "several")
    assert several["ranks"] == ranks and several["pores"] == one["pores"] == len(pores)
    assert forces.keys() == forces_too.keys() == {"id", "force", "wall_force"}
    assert (np.diff(forces["id"]) > 0).all() and len(forces["id"]) == GRAINS
    np.testing.assert_array_equal(forces_too["id"], forces["id"])
    scale = np.abs(forces["force"]).max()
    np.testing.assert_allclose(forces_too["force"], forces["force"], rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(forces_too["wall_force"], forces["wall_force"], rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(pores_too, pores, rtol=0, atol=1e-9)
    # Every rank's pores have a piece of their own.
    assert len(re.findall("<Piece ", (tmp_path / "several" / "p.vtu").read_text())) == ranks


@pytest.mark.parallel
@pytest.mark.parametrize("option", ["--forces", "--vtu"])
def test_a_full_disk_is_told_once(mpirun, dump, option):
    """Two ranks: one message, and both end with the status of bad input."""
    done = mpirun(2, ["-m", "flowsolver", dump, "--face", "ymin=1", option, "/dev/full"])
    assert done.returncode == 2
    assert re.findall("(?m)^poreflow: .*", done.stderr) == ["poreflow: cannot write /dev/full: No space left on device"]


@pytest.mark.parallel
def test_no_rank_puts_files_or_orders_together(mpirun, tmp_path):
    """Three ranks, one of which has most rows and one none."""
    done = mpirun(3, [Path(__file__).with_name("poreflow_files_ranks.py"), tmp_path])
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "parts").read_bytes() == b"".join(np.full(n, k, np.uint8).tobytes() for k, n in enumerate((0, 5, 70)))
    picture = meshio.read(tmp_path / "p.vtu")
    np.testing.assert_array_equal(picture.points[:, 0], [*range(5), *range(70)])
    np.testing.assert_array_equal(picture.point_data["pressure"], np.repeat([1.0, 2.0], (5, 70)))
    # Not every reader takes an empty piece.
    assert (tmp_path / "p.vtu").read_text().count("<Piece ") == 2


def test_sorted_on_one_rank():
    key = np.array([5, -1, 3])
    number, column = sorted_over_ranks(MPI.COMM_SELF, key, np.arange(6).reshape(3, 2))
    np.testing.assert_array_equal(number, [-1, 3, 5])
    np.testing.assert_array_equal(column, [[2, 3], [4, 5], [0, 1]])
