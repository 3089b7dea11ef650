"""A solved flow in the fault scenes: against the prescribed pressure, against what squeezing must do, on ranks, and from a checkpoint."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from tiny_fault import history, last_grains

# What is compared is compared more closely than solves are by default.
SOLVED = ("flow.kind=solve", "flow.split=staggered", "flow.solver_tolerance=1e-12", "bonds.strength_mean_Pa=1e9")
ONE_WAY = (*SOLVED, "flow.two_way=false")
BOTH_SIDES = ("pressure.left_target_Pa=1e7", "pressure.right_target_Pa=1e7")


def report(run) -> dict:
    return json.loads((run / "report.json").read_text())


def assert_close(one: dict, other: dict, share: float) -> None:
    """Every column, of its largest value; a mesh may be repaired in one run and made anew in the other."""
    for name in set(one) & set(other) - {"mesh_rebuilds"}:
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=share * np.abs(one[name]).max(), err_msg=name)


@pytest.mark.parametrize("held", ["faces", "blocks"])
def test_the_same_pressure_on_both_sides_is_the_prescribed_one(run_fault, held):
    """Steady flow between equal pressures is no flow: one-way, the run is that with this pressure prescribed."""
    prescribed = history(run_fault(*BOTH_SIDES, "bonds.strength_mean_Pa=1e9", out="prescribed"))
    solved = history(run_fault(*ONE_WAY, *BOTH_SIDES, f"fluid.held={held}", "fluid.compressibility_per_Pa=0", out="solved"))
    assert_close(prescribed, solved, 1e-7)
    np.testing.assert_allclose(solved["pressure_min_Pa"], solved["pressure_max_Pa"], rtol=1e-9)
    assert solved["p_left_Pa"][-1] == pytest.approx(1e7, rel=2e-2)


@pytest.mark.parametrize("scene", ["two_sides", "supplement"])
@pytest.mark.parametrize("split", ["staggered", "undrained"])
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_balances_close(run_fault, upright_case, scene, split, ranks):
    case = upright_case if scene == "supplement" else None
    # Pores that do not drain in a step bear a shorter one.
    done = report(run_fault(*SOLVED, f"flow.split={split}", "loading.time_step_fraction=0.4", case=case, ranks=ranks))
    assert 0.0 < done["work_residual"] < 1e-10 and 0.0 < done["momentum_residual"] < 1e-10
    assert 0.0 < done["mass_residual"] < 1e-8 and done["remesh_mass_residual"] < 1e-12
    network = done["pore_network_by_rank"][0]
    assert network["kept"] > 20 and network["solver"]["unknowns"] > 1000


def test_the_blocks_pressures_hold(run_fault):
    """Case 2: p_t in the left block, none in the right, and the gouge's pores between them."""
    rows = history(run_fault(*SOLVED, "fluid.held=blocks"))
    target = 2.5e7 * np.minimum(rows["strain"] / 2e-4, 1.0)
    np.testing.assert_allclose(rows["p_left_Pa"], target, rtol=1e-9)
    np.testing.assert_allclose(rows["p_right_Pa"], 0.0, atol=1e-6)
    grains = last_grains(run_fault(*SOLVED, "fluid.held=blocks", "output.snapshots=2", out="seen"))
    gouge, across = grains["type"] == 2, grains["position"] @ np.sqrt([0.5, 0.0, 0.5])
    assert grains["pressure"].min() >= 0.0 and grains["pressure"].max() <= 2.5e7 * (1 + 1e-9)
    # The field falls across the gouge, unevenly as its throats are; deep in the blocks it is what is given.
    assert np.corrcoef(across[gouge], grains["pressure"][gouge])[0, 1] < -0.9
    assert grains["pressure"][np.argmin(across)] == pytest.approx(2.5e7, rel=1e-9)


def test_with_two_pressures_the_faces_drive_a_flow(run_fault):
    """What enters at the left leaves at the right, and the blocks beside the gouge are no longer at the pressures of their faces."""
    result = run_fault(*ONE_WAY, "fluid.compressibility_per_Pa=0")
    rows, outflow = history(result), report(result)["pore_network_by_rank"][0]["outflow_m3_per_s"]
    assert set(outflow) == {"xmin", "xmax", "zmin", "zmax"}
    assert outflow["xmin"] < 0.0 < outflow["xmax"]
    assert abs(sum(outflow.values())) < 1e-9 * sum(abs(flow) for flow in outflow.values())
    assert 0.0 < rows["p_right_Pa"][-1] < rows["p_left_Pa"][-1] < 0.95 * 2.5e7


def test_squeezing_raises_the_pressure_as_the_viscosity_does(run_fault):
    """With nothing held but 0 the pressures are those of squeezing, which are in proportion to the viscosity; one-way there are none."""
    dry = ("pressure.mode=none", "fluid.compressibility_per_Pa=0")
    peak = [np.abs(history(run_fault(*SOLVED, *dry, f"fluid.viscosity_Pa_s={eta}", out=f"eta{eta}"))["pressure_max_Pa"]).max() for eta in (1e-3, 2e-3)]
    assert peak[0] > 1.0
    assert peak[1] / peak[0] == pytest.approx(2.0, rel=0.02)
    one_way = history(run_fault(*ONE_WAY, *dry, out="one-way"))
    assert np.abs(one_way["pressure_max_Pa"]).max() == 0.0


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_same_on_any_number_of_ranks(run_fault, ranks):
    one, several = (history(run_fault(*SOLVED, out=f"on{n}", ranks=n)) for n in (1, ranks))
    assert_close(one, several, 1e-7)


@pytest.mark.parametrize("two_way", ["true", "false"])
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_goes_on_from_a_checkpoint(run_fault, poreslip, ranks, two_way):
    result = run_fault(*SOLVED, f"flow.two_way={two_way}", ranks=ranks, options=("--checkpoint-every", "100"))
    before, told = (result / "history.csv").read_bytes(), report(result)
    shutil.rmtree(result / "checkpoint-000000000300")
    done = poreslip("run", "--restart", result, ranks=ranks, env={"PORESLIP_CACHE": "/dev/null"})
    assert done.returncode == 0, done.stderr
    assert (result / "history.csv").read_bytes() == before
    # Counts are those of the whole run, of 40 intervals.
    again = report(result)
    assert told["solver"] == again["solver"] and told["solver"]["solves"] == 40
    assert told["remeshes"] == again["remeshes"]
    assert (told["steps"], told["balances"].keys()) == (again["steps"], again["balances"].keys())


def test_a_formula_shows_its_pressure_beside_the_gouge(run_fault):
    """Prescribed, of one half of p_t on the left: what stands in the history is the field, not the targets."""
    rows = history(run_fault("bonds.strength_mean_Pa=1e9", "pressure.mode=expression", "pressure.expression=0.5 * p_left * (s < 0) + 1e5"))
    np.testing.assert_allclose(rows["p_right_Pa"], 1e5, rtol=1e-9)
    np.testing.assert_allclose(rows["p_left_Pa"], 0.5 * 2.5e7 * np.minimum(rows["strain"] / 2e-4, 1.0) + 1e5, rtol=1e-9)


def test_a_pair_of_runs_is_plotted(run_fault, poreslip, tmp_path):
    """What the driver writes is what `poreslip plot` sets side by side: equal to the grain, with a pressure change where grains squeeze."""
    runs = [run_fault(*SOLVED, f"flow.two_way={way}", "output.snapshots=2", out=f"two-way-{way}") for way in ("false", "true")]
    done = poreslip("plot", *runs, "--out", tmp_path / "plots", "--dpi", "60")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("(i, ") == 3
    with open(tmp_path / "plots" / "claims.csv", newline="") as file:
        values = {row["claim"]: float(row["value"]) for row in csv.DictReader(file)}
    one, two = (last_grains(run) for run in runs)
    assert values["i, pressure"] == pytest.approx(np.abs(two["pressure"] - one["pressure"]).max(), rel=1e-9)
    assert 1.0 < values["i, pressure"] < 1e6 and 0.0 < values["i, displacements"] < 1.0
