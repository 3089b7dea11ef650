"""Prescribed pressures in a run: the ways to give them, the ways to apply them, and how their forces balance."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from tiny_fault import history, last_grains

STRONG = "bonds.strength_mean_Pa=1e9"


def report(run) -> dict:
    return json.loads((run / "report.json").read_text())


def test_addforce_is_the_fast_fix(run_fault):
    fast = run_fault("output.snapshots=2", out="fast")
    addforce = run_fault("output.snapshots=2", "flow.pore_force=addforce", out="addforce")
    assert "addforce" in (addforce / "log.liggghts").read_text() and "fix            add_pore_force all addforce" not in (fast / "log.liggghts").read_text()
    a, b = last_grains(fast), last_grains(addforce)
    assert np.abs(a["pressure_force"]).max() > 1.0
    for name in ("position", "velocity", "pressure_force"):
        np.testing.assert_allclose(b[name], a[name], rtol=0, atol=1e-9 * np.abs(a[name]).max(), err_msg=name)
    np.testing.assert_array_equal(history(fast)["bonds_intact"], history(addforce)["bonds_intact"])


def test_an_expression_is_the_pressure_it_says(run_fault):
    """Case 2's pressure written as a formula gives case 2 to rounding."""
    linear = history(run_fault(STRONG, out="linear"))
    formula = "p_left + (p_right - p_left) * where(s < -width/2, 0, where(s > width/2, 1, s/width + 0.5))"
    expression = history(run_fault(STRONG, "pressure.mode=expression", f"pressure.expression={formula}", out="expression"))
    for name in linear:
        np.testing.assert_allclose(expression[name], linear[name], rtol=1e-7, atol=1e-9 * np.abs(linear[name]).max(), err_msg=name)
    assert linear["sigma_n_Pa"][-1] > 1.2 * linear["sigma_n_Pa"][0]


def test_uniform_is_linear_between_equals(run_fault):
    both = (STRONG, "pressure.left_target_Pa=1e7", "pressure.right_target_Pa=1e7")
    linear = history(run_fault(*both, out="linear"))
    uniform = history(run_fault(*both, "pressure.mode=uniform", out="uniform"))
    np.testing.assert_allclose(uniform["sigma_n_Pa"], linear["sigma_n_Pa"], rtol=1e-7)
    np.testing.assert_allclose(uniform["p_left_Pa"], uniform["p_right_Pa"])
    assert uniform["p_left_Pa"][-1] == pytest.approx(1e7, rel=2e-2)


def test_forces_of_the_pressure_alone(run_fault):
    """Law (2) of the paper leaves out the drag in the throats, where the pressure has a gradient."""
    total = last_grains(run_fault(STRONG, "output.snapshots=2", out="total"))
    alone = last_grains(run_fault(STRONG, "output.snapshots=2", "flow.forces=pressure", out="alone"))
    a, b = (np.linalg.norm(grains["pressure_force"], axis=1).sum() for grains in (total, alone))
    assert 0.5 < b / a < 0.95


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_forces_balance(run_fault, ranks):
    """Forces on grains and walls sum to zero in every update of a run."""
    result = run_fault("pressure.right_target_Pa=5e6", ranks=ranks)
    residual = report(result)["momentum_residual"]
    assert 0.0 < residual < 1e-10
    assert "momentum_residual" in (result / "report.md").read_text()


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_a_pressure_that_is_not_a_number(failing_fault, ranks):
    """It is one only between two strains, which the check of the case does not try."""
    formula = "where((strain > 5e-5) & (strain < 1e-4), sqrt(s - 1), 1e6)"
    message = failing_fault("pressure.mode=expression", f"pressure.expression={formula}", run="wet", status=3, ranks=ranks)
    assert "gives nan at [" in message and "give a formula that is finite in every pore" in message


def test_plates_hold_the_total_stress(run_fault, own_decks):
    """Loaded slowly, contact force and fluid force together bear on the plates what the case says, each as the engine has it."""
    with open(own_decks / "in.load", "a") as deck:
        deck.write("variable plate equal ${area_bottom_left}\nthermo_style custom step f_z_bottom_left[3] f_z_bottom_left[4] v_plate\n")
    slow = ("loading.horizontal_strain=3e-5", "loading.strain_rate_per_s=0.1", "pressure.left_target_Pa=4e6", "pressure.right_target_Pa=4e6")
    run = run_fault(STRONG, *slow, "flow.interval_steps=10", "output.history_interval_steps=50", f"decks_directory={own_decks}")
    rows = history(run)
    assert rows["p_left_Pa"][-1] == pytest.approx(4e6, rel=1e-2)
    np.testing.assert_allclose(rows["sigma_v_Pa"], 1e7, rtol=2e-2)
    np.testing.assert_allclose(rows["sigma_h_left_Pa"], rows["sigma_h_right_Pa"], rtol=2e-2)
    assert rows["unbalanced_force_ratio"].max() < 5e-2

    lines = [line.split() for line in (run / "log.liggghts").read_text().splitlines() if re.fullmatch(r"\s*\d+(\s+[-+.\de]+){3}\s*", line)]
    _, contact, fluid, area = (float(value) for value in lines[-1])
    assert (contact + fluid) / area == pytest.approx(1e7, rel=2e-2)
    # The fluid bears on all of the plate's area; its edge at the gouge runs along pores, not along the interface.
    assert fluid / area == pytest.approx(4e6, rel=0.1)
