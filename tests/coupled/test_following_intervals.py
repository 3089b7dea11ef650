"""Intervals between two solves that follow their error: what the tolerance makes of a settlement, ranks, and going on from a checkpoint."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from sample_runs import CASES, Result
from tiny_fault import settings

#: 384 grains: the drained top settles by three quarters in 1200 steps, of which the load takes 300 to rise.
SMALL = ("pack.box_m=[0.014, 0.014, 0.014]", "fluid.viscosity_Pa_s=8.0", "sample.loading_time_s=6e-5", "output.history_interval_steps=96")
FOLLOWING = (*SMALL, "flow.interval_steps=96", "flow.solver_tolerance=1e-12")


@pytest.fixture(scope="module")
def consolidation(poreslip, stage_cache, tmp_path_factory):
    """`consolidation(*overrides, ranks=1)`: results of the consolidating pack."""

    def run(*overrides: str, ranks: int = 1) -> Result:
        out = tmp_path_factory.mktemp("following")
        command = ["run", CASES / "consolidation" / "consolidation.toml", "--only", "two_way", "--out", out, *settings(*overrides)]
        done = poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})
        assert done.returncode == 0, done.stderr
        return Result(out / "consolidation" / "two_way")

    return run


def test_the_tolerance_bounds_the_error(consolidation):
    """A quarter of the tolerance takes half the length (order 2), and with it most of the error: 6.4e-3, 1.1e-3 and 4e-4 when measured."""
    exact = consolidation(*SMALL, "flow.interval_steps=4", "flow.interval_tolerance=0").history["strain_z"]
    errors, lengths = [], []
    for tolerance in (0.08, 0.02, 0.005):
        result = consolidation(*FOLLOWING, f"flow.interval_tolerance={tolerance}")
        told = result.report["interval_error"]
        # An interval's error is that of the one before, in a load that changes.
        assert 0.4 * tolerance < told["worst"] < 2.0 * tolerance
        assert 1 <= told["shortest_interval_steps"] < told["longest_interval_steps"] <= 96
        assert result.report["work_residual"] < 1e-10 and result.report["mass_residual"] < 1e-8
        np.testing.assert_array_equal(result.history["step"][:-1] % 96, 0)
        errors.append(np.sqrt(np.mean((result.history["strain_z"] - exact) ** 2) / np.mean(exact**2)))
        lengths.append(result.report["steps"] / result.report["solver"]["solves"])
    assert errors[0] < 0.01 and errors[1] < 0.4 * errors[0] and errors[2] < 0.7 * errors[1]
    assert all(1.2 < longer / shorter < 2.5 for longer, shorter in zip(lengths, lengths[1:]))
    # Even intervals that need no more solves than the second of these err more.
    even = consolidation(*SMALL, "flow.interval_steps=32", "flow.interval_tolerance=0")
    assert even.report["steps"] / even.report["solver"]["solves"] < 1.1 * lengths[1]
    assert errors[1] < 0.6 * np.sqrt(np.mean((even.history["strain_z"] - exact) ** 2) / np.mean(exact**2))


@pytest.mark.parallel
def test_same_on_two_ranks(consolidation):
    inputs = (*FOLLOWING, "flow.interval_tolerance=0.04", "sample.loading_time_s=3e-5")
    one, two = consolidation(*inputs), consolidation(*inputs, ranks=2)
    for name in set(one.history) - {"mesh_rebuilds"}:
        np.testing.assert_allclose(two.history[name], one.history[name], rtol=0, atol=1e-6 * np.abs(one.history[name]).max(), err_msg=name)
    assert two.report["interval_error"] == pytest.approx(one.report["interval_error"], rel=1e-5)
    assert two.report["solver"]["solves"] == one.report["solver"]["solves"]


def test_goes_on_from_a_checkpoint(consolidation, poreslip):
    """Where the load has just risen: lengths and errors go on as they were."""
    result = consolidation(*FOLLOWING, "flow.interval_tolerance=0.04", "output.checkpoint_every_steps=384", "sample.loading_time_s=4e-5")
    history, report = result.history, result.report
    for path in sorted(result.directory.glob("checkpoint-*")):
        if path.name != "checkpoint-000000000384":
            shutil.rmtree(path)
    done = poreslip("run", "--restart", result.directory, env={"PORESLIP_CACHE": "/dev/null"})
    assert done.returncode == 0, done.stderr
    for name in set(history) - {"mesh_rebuilds"}:
        # The linear solver starts anew: the same to its tolerance.
        np.testing.assert_allclose(result.history[name], history[name], rtol=0, atol=1e-7 * np.abs(history[name]).max(), err_msg=name)
    assert result.report["restarted_at_steps"] == [384]
    assert result.report["solver"]["solves"] == report["solver"]["solves"]
    assert result.report["interval_error"] == pytest.approx(report["interval_error"], rel=1e-6)
