"""The preconditioner over repaired meshes: the answers of a new one, fewer set-ups, and dropped where it no longer pays."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import UNIT_BOX, random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.transfer import carry_pressure

DRIVEN = Boundary(pressure={"ymin": 1e5, "ymax": 0.0})
GRAINS = 400


@pytest.fixture
def moving():
    """`moving(step)`: each grain moved by about so much, in diameters, and the network and its flow after it; with the pressures carried over."""
    x, r = random_pack(GRAINS, (0.04, 0.06), seed=8)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.remember_previous()
    net.update(np.arange(GRAINS), x, r, UNIT_BOX)
    flow, rng = PoreFlow(net, 1e-3), np.random.default_rng(0)

    def move(step: float, pressure: np.ndarray) -> tuple[str, np.ndarray]:
        nonlocal x
        x = np.clip(x + rng.normal(size=x.shape) * step * 0.1, 0.061, 0.939)
        before = net.pores
        outcome = net.update(np.arange(GRAINS), x, r, UNIT_BOX)
        flow.refresh()
        return outcome, carry_pressure(net, pressure, before) if outcome != "kept" else pressure

    return net, flow, move


def test_carried_over_repairs(moving):
    net, flow, move = moving
    pressure = flow.steady(DRIVEN).pressure
    set_ups, repaired, iterations = 0, 0, []
    for _ in range(12):
        outcome, pressure = move(3e-4, pressure)
        result = flow.steady(DRIVEN, pressure, tolerance=1e-10)
        new = PoreFlow(net, 1e-3).steady(DRIVEN, pressure, tolerance=1e-10)
        # Residuals of 1e-10, in pressures of up to 1e5 Pa.
        np.testing.assert_allclose(result.pressure, new.pressure, rtol=0, atol=1e-3)
        assert not new.report["preconditioner_kept"]
        repaired += outcome == "repaired"
        set_ups += not result.report["preconditioner_kept"]
        iterations.append(result.report["iterations"] - new.report["iterations"])
        pressure = result.pressure
    assert repaired >= 4
    assert set_ups <= 3
    assert np.mean(iterations) < 10


def test_dropped_where_too_much_changed(moving):
    """Of a mesh most of whose pores are other ones nothing is carried over."""
    net, flow, move = moving
    pressure = flow.steady(DRIVEN).pressure
    outcome, pressure = move(0.5, pressure)
    assert outcome != "kept"
    result = flow.steady(DRIVEN, pressure)
    assert not result.report["preconditioner_kept"]
    np.testing.assert_allclose(result.pressure, PoreFlow(net, 1e-3).steady(DRIVEN).pressure, rtol=0, atol=1e-3)


def test_dropped_once_the_changes_add_up(moving):
    """Small moves: kept over some of them; sooner or later a set-up pays, and solves take as few iterations as at first."""
    _, flow, move = moving
    first = flow.steady(DRIVEN, tolerance=1e-8)
    pressure, kept, set_ups = first.pressure, 0, 0
    for _ in range(200):
        _, pressure = move(2e-4, pressure)
        result = flow.steady(DRIVEN, 0 * pressure, tolerance=1e-8)
        kept += result.report["preconditioner_kept"]
        set_ups += not result.report["preconditioner_kept"]
        if kept and not result.report["preconditioner_kept"]:
            break
    assert 0 < set_ups < kept
    again = flow.steady(DRIVEN, 0 * pressure, tolerance=1e-8)
    assert again.report["iterations"] <= 1.5 * first.report["iterations"] + 2
