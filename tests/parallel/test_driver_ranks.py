"""Ranks: 1, 2 and 3, from the same kept pack. The same breaks, the same grains in the same places, the same history."""

from __future__ import annotations

import json
from pathlib import Path

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

    assert_same(one, several)
    assert len(broken_bonds(one)) > 100


@pytest.mark.parallel
def test_upright_fault_on_two_ranks(run_fault, upright_case):
    one = run_fault("output.snapshots=2", case=upright_case, out="one")
    two = run_fault("output.snapshots=2", case=upright_case, out="two", ranks=2)
    assert_same(one, two)
    assert json.loads((two / "report.json").read_text())["momentum_residual"] < 1e-10


def assert_same(one: Path, several: Path) -> None:
    a, b = last_grains(one), last_grains(several)
    np.testing.assert_array_equal(a["id"], b["id"])
    assert np.abs(a["position"] - b["position"]).max() < 1e-9 * MEAN_DIAMETER
    np.testing.assert_array_equal(a["coordination"], b["coordination"])

    breaks = [[(row["step"], row["id_i"], row["id_j"], row["mode"]) for row in broken_bonds(result)] for result in (one, several)]
    assert sorted(breaks[0]) == sorted(breaks[1])

    before, after = history(one), history(several)
    # On several ranks the mesh is built anew where one rank can repair it.
    for name in set(before) - {"mesh_rebuilds"}:
        scale = np.abs(before[name]).max()
        np.testing.assert_allclose(after[name], before[name], rtol=0, atol=1e-7 * scale, err_msg=name)
