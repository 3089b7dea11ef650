"""Ranks: 1, 2 and 4. The same pressures, forces and flows, with walls and with periods."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "unit"))
from geometry_reference import random_pack  # noqa: E402

CASE = Path(__file__).with_name("flow_ranks_case.py")


@pytest.mark.parallel
@pytest.mark.parametrize("periodic", ["-", "z", "xyz"])
def test_same_on_any_number_of_ranks(mpirun, tmp_path, periodic):
    x, r = random_pack(400, (0.04, 0.065), seed=11)
    np.savez(tmp_path / "pack.npz", x=x, r=1.02 * r)
    results = []
    for ranks in (1, 2, 4):
        out = tmp_path / f"{ranks}.npz"
        done = mpirun(ranks, [CASE, tmp_path / "pack.npz", periodic, out])
        assert done.returncode == 0, done.stderr
        results.append(np.load(out))
    one = results[0]
    for other in results[1:]:
        for name in one:
            # of a pore, its vertices and then its pressure
            values = one[name][:, 4] if name.endswith("pressure") else one[name]
            scale = np.abs(values).max(initial=0.0)
            np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-9 * scale, err_msg=name)


@pytest.mark.parallel
def test_default_tolerance_agrees_to_1e_9_by_either_law(mpirun, tmp_path):
    """8000 grains, of whose throats some are next to closed and some, by hydraulic-radius, of next to no length."""
    results = []
    for ranks in (1, 2, 4):
        out = tmp_path / f"{ranks}.npz"
        done = mpirun(ranks, [CASE.with_name("flow_agreement_case.py"), CASE.parent.parent / "data" / "peer_pack_8000.npz", out])
        assert done.returncode == 0, done.stderr
        results.append(np.load(out))
    one = results[0]
    for other in results[1:]:
        for name in one:
            if name.endswith("iterations"):
                # Strong throats between pores of two ranks cost the preconditioner nothing.
                assert other[name] <= 1.5 * one[name], (name, int(one[name][0]), int(other[name][0]))
                continue
            np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-9 * np.abs(one[name][..., -1] if "pressure" in name else one[name]).max(), err_msg=name)


@pytest.mark.parallel
def test_ranks_without_grains_take_part_in_each_solve(mpirun, tmp_path):
    results = []
    for ranks in (1, 2, 3):
        out = tmp_path / f"{ranks}.npy"
        done = mpirun(ranks, [CASE.with_name("empty_rank_case.py"), out], timeout=60)
        assert done.returncode == 0, done.stderr
        results.append(np.load(out))
    assert len(results[0]) == 14
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], rtol=1e-9)
