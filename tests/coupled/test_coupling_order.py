"""How the error of two-way coupling falls with its interval: order 1; and what a prediction of the drainage takes off it."""

from __future__ import annotations

import numpy as np
import pytest
from sample_runs import CASES, Result
from tiny_fault import settings

#: 384 grains: the drained top settles by three quarters in 800 steps.
SMALL = ("pack.box_m=[0.014, 0.014, 0.014]", "fluid.viscosity_Pa_s=8.0", "sample.loading_time_s=6e-5", "output.history_interval_steps=96")
INTERVALS = (8, 16, 32)


@pytest.fixture(scope="module")
def settlement(poreslip, stage_cache, tmp_path_factory):
    """`settlement(split, interval)`: strain of the consolidating pack over time, (n,)."""

    def run(split: str, interval: int) -> np.ndarray:
        out = tmp_path_factory.mktemp("order")
        inputs = settings(*SMALL, f"flow.split={split}", f"flow.interval_steps={interval}", "flow.interval_tolerance=0")
        done = poreslip("run", CASES / "consolidation" / "consolidation.toml", "--only", "two_way", "--out", out, *inputs, env={"PORESLIP_CACHE": str(stage_cache)})
        assert done.returncode == 0, done.stderr
        return Result(out / "consolidation" / "two_way").history["strain_z"]

    return run


@pytest.fixture(scope="module")
def every_step(settlement) -> np.ndarray:
    return settlement("undrained", 1)


@pytest.fixture(scope="module")
def errors(settlement, every_step):
    """Errors of the split "undrained", m/m, at INTERVALS."""
    return np.array([np.sqrt(np.mean((settlement("undrained", interval) - every_step) ** 2)) for interval in INTERVALS])


def test_order_in_the_interval(errors, every_step):
    # What lies between an interval and a solve in every step.
    order = np.polyfit(np.log(np.array(INTERVALS) - 1.0), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.3)
    assert errors[-1] < 0.05 * every_step[-1]


def test_prediction_takes_most_of_the_error(settlement, errors, every_step):
    predicted = np.sqrt(np.mean((settlement("predicted", INTERVALS[-1]) - every_step) ** 2))
    assert predicted < 0.3 * errors[-1]
