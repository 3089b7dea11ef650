"""Ranks: 1, 2 and 3, from the same kept pack. The same breaks, the same grains in the same places, the same history."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_fault import broken_bonds, history, last_grains

MEAN_DIAMETER = 2e-3


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
@pytest.mark.parametrize("run", ["wet", "dry"])
def test_same_on_any_number_of_ranks(run_fault, run, ranks):
    inputs = ("output.snapshots=2", "bonds.strength_mean_Pa=1e6", "bonds.strength_sd_Pa=2e5", "loading.horizontal_strain=1e-4")
    one = run_fault(*inputs, run=run, out="one")
    several = run_fault(*inputs, run=run, out="several", ranks=ranks)

    a, b = last_grains(one), last_grains(several)
    np.testing.assert_array_equal(a["id"], b["id"])
    assert np.abs(a["position"] - b["position"]).max() < 1e-9 * MEAN_DIAMETER
    np.testing.assert_array_equal(a["coordination"], b["coordination"])

    breaks = [[(row["step"], row["id_i"], row["id_j"], row["mode"]) for row in broken_bonds(result)] for result in (one, several)]
    assert sorted(breaks[0]) == sorted(breaks[1])
    assert len(breaks[0]) > 100

    before, after = history(one), history(several)
    # On several ranks the mesh is built anew where one rank can repair it.
    for name in set(before) - {"mesh_rebuilds"}:
        scale = np.abs(before[name]).max()
        np.testing.assert_allclose(after[name], before[name], rtol=0, atol=1e-7 * scale, err_msg=name)


@pytest.mark.parallel
def test_the_pack_is_as_good_on_two_ranks(run_fault, tiny_case, poreslip, tmp_path):
    """Made on two ranks a pack is another one, from the same grains, and just as dense."""
    out = []
    for ranks in (1, 2):
        command = ["run", tiny_case, "--only", "dry", "--out", tmp_path / f"out{ranks}"]
        done = poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(tmp_path / f"cache{ranks}")})
        assert done.returncode == 0, done.stderr
        line = next(line for line in done.stdout.splitlines() if "packed" in line)
        out.append((int(line.split()[2]), float(line.split()[-1])))
    (grains, porosity), (other_grains, other_porosity) = out
    assert abs(other_grains - grains) <= 0.01 * grains
    assert other_porosity == pytest.approx(porosity, abs=5e-3)
