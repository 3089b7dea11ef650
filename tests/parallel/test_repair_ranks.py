"""Ranks: 1, 2 and 4. Meshes repaired by flips, with walls and with periods, are those made anew."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "unit"))
from geometry_reference import random_pack  # noqa: E402

CASE = Path(__file__).with_name("repair_ranks_case.py")


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2, 4])
@pytest.mark.parametrize(("periodic", "step"), [("none", 3e-4), ("z", 3e-4), ("xy", 1.5e-3), ("xyz", 3e-4)])
def test_repaired_is_made_anew(mpirun, tmp_path, periodic, step, ranks):
    x, r = random_pack(400, (0.036, 0.064), seed=9)
    np.savez(tmp_path / "pack.npz", x=x, r=r)
    moves = 30
    done = mpirun(ranks, [CASE, tmp_path / "pack.npz", periodic if periodic != "none" else "-", moves, step])
    assert done.returncode == 0, done.stderr
    kept, repaired, rebuilt = (int(count) for count in done.stdout.split())
    assert kept + repaired + rebuilt == moves
    # Some of the moves turn a cell inside out.
    assert repaired > (20 if step < 1e-3 else 10)


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(("periodic", "moves"), [("-", 20), ("z", 20), ("xy", 30)])
def test_ties_among_grains_walls_and_images(mpirun, periodic, moves, ranks):
    """Copies of a cell fall alike, or the mesh is made anew; three grains across a wall that holds their circle's centre have a cell too."""
    done = mpirun(ranks, [Path(__file__).with_name("shaken_lattice_case.py"), periodic, moves])
    assert done.returncode == 0, done.stderr
    kept, repaired, rebuilt = (int(count) for count in done.stdout.split())
    assert kept + repaired + rebuilt == moves and rebuilt > 10
