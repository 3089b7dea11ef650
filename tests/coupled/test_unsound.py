"""Runs that become unstable: each ends with one message that says how it shows and what to change, on one rank and on two."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from processes import the_message
from tiny_fault import history

SEVERAL = pytest.param(2, marks=pytest.mark.parallel)
#: Lines added to the deck of loading, and what the message then says.
UNSOUND = {
    # 0.5 of the critical step is 1e-7 s; what the checks of a case would refuse is set behind them.
    "a step beyond the limit": (["timestep 2.1e-7"], ["than they had and than walls and fluid gave them", "lower loading.time_step_fraction, 0.5"]),
    "grains pressed into each other": (["fix_modify x_left velocity 400."], ["two grains overlap by", "more than 0.2", "loading.time_step_fraction"]),
    "a grain through a wall": (["fix_modify y_back position 5e-3"], ["the centre of a grain has gone through the wall y_back"]),
    "no number": (["variable bad atom exp(1000.)-exp(1000.)", "fix bad gouge addforce v_bad 0. 0."], ["unbalanced_force_ratio", "is not a finite number"]),
}


@pytest.mark.parametrize("ranks", [1, SEVERAL])
@pytest.mark.parametrize("name", UNSOUND)
def test_an_unsound_run_ends(failing_fault, own_decks, name, ranks):
    lines, parts = UNSOUND[name]
    deck = own_decks / "in.load"
    deck.write_text(deck.read_text() + "\n".join(lines) + "\n")
    message = failing_fault(f"decks_directory={own_decks}", "output.history_interval_steps=10", status=3, run="dry", ranks=ranks)
    for part in parts:
        assert part in message


@pytest.mark.parametrize("run", ["wet", "dry"])
def test_a_sound_run_gains_no_energy(run_fault, run):
    """With the fluid's work counted; without it the pressures' rise would look like energy from nothing."""
    directory: Path = run_fault(run=run)
    gain = json.loads((directory / "report.json").read_text())["quasi_static_checks"]["energy_gain"]
    assert 0.0 <= gain < 1e-3
    energy = history(directory)["contact_energy_J"]
    assert (energy > 0.0).all() and energy[-1] != energy[0]


#: No friction that slides, no damping, no bond that breaks: nothing is lost.
ELASTIC = ("material.restitution=1.0", "material.local_damping=0.0", "material.friction=10.0", "bonds.strength_mean_Pa=1e12", "loading.time_step_fraction=0.2")


@pytest.mark.parametrize("ranks", [1, SEVERAL])
def test_the_work_of_the_supplements_shear_stress_counts(run_fault, upright_case, ranks):
    """Without it an elastic pack would seem to gain 6e-8 of its energy."""
    directory = run_fault(*ELASTIC, case=upright_case, run="dry", ranks=ranks)
    assert json.loads((directory / "report.json").read_text())["quasi_static_checks"]["energy_gain"] < 1e-10


def test_an_unsound_supplement_ends(poreslip, stage_cache, upright_case, own_decks, tmp_path):
    deck = own_decks / "in.load_supplement"
    deck.write_text(deck.read_text() + "timestep 2.1e-7\n")
    command = ["run", upright_case, "--only", "dry", "--out", tmp_path / "out", "--set", f"decks_directory={own_decks}"]
    assert "than they had and than walls and fluid gave them" in the_message(poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)}), 3)
