"""Two-way coupling against what is known: permeability, undrained loading, consolidation; 1177 grains, ten across the box."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from sample_runs import CASES, Result, terzaghi
from tiny_fault import settings

from coupling.case.files import load_case
from coupling.case.staggered_limit import layers_of

STRESS_STEP = 1e6
#: Faster than the case file's, with T_v up to 0.75 in 1600 steps.
QUICK = ("fluid.viscosity_Pa_s=5.0", "sample.loading_time_s=1.1e-4", "loading.time_step_fraction=0.35", "flow.interval_steps=5", "flow.interval_tolerance=0",
         "output.history_interval_steps=40")  # fmt: skip


@pytest.fixture(scope="module")
def run(poreslip, stage_cache, tmp_path_factory):
    """`run(case, name, *overrides, ranks=1)`: carry out one run of a case file; each only once."""
    done: dict = {}

    def carry_out(case: str, name: str, *overrides: str, ranks: int = 1) -> Result:
        key = (case, name, overrides, ranks)
        if key not in done:
            out = tmp_path_factory.mktemp("sample")
            command = ["run", CASES / case / f"{case}.toml", "--only", name, "--out", out, *settings(*overrides)]
            ended = poreslip(*command, ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})
            assert ended.returncode == 0, ended.stderr
            done[key] = Result(out / case / name)
        return done[key]

    return carry_out


def permeability(run) -> float:
    return run("darcy", "run").report["pore_network_by_rank"][0]["permeability_m2"]


def oedometric_modulus(run) -> float:
    last = run("undrained", "uniaxial_dry").report["last"]
    assert last["strain_x"] == last["strain_y"] == 0.0
    return STRESS_STEP / last["strain_z"]


def storage(result: Result) -> float:
    """Porosity times compressibility, 1/Pa."""
    return result.history["porosity"][0] * result.case["fluid"]["compressibility_per_Pa"]


def assert_balanced(result: Result) -> None:
    report = result.report
    assert 0.0 <= report["work_residual"] < 1e-10
    assert report["momentum_residual"] < 1e-10
    assert report["mass_residual"] < 1e-8
    assert report["remesh_mass_residual"] < 1e-12


def test_permeability(run):
    result = run("darcy", "run")
    last = result.history
    # Steady: what comes in goes out, but for 40 diffusion times' worth of grains that still settle.
    assert last["outflow_zmin_m3_per_s"][-1] == pytest.approx(-last["outflow_zmax_m3_per_s"][-1], rel=1e-5)
    # 1.0e-9 m^2 at porosity 0.35 (the paper), by Kozeny and Carman at that of this pack's inside; more at the looser walls.
    inside = result.report["pack"]["porosity_bulk"]
    expected = 1.0e-9 * (inside / 0.35) ** 3 * (0.65 / (1 - inside)) ** 2
    assert permeability(run) == pytest.approx(expected, rel=0.15)
    assert_balanced(result)
    assert 1e-8 < result.report["pore_network_by_rank"][0]["pressure_diffusion_time_s"] < 1e-6


def test_uniaxial_undrained_loading(run):
    result = run("undrained", "uniaxial")
    share = result.report["last"]["pressure_mean_Pa"] / STRESS_STEP
    # The rest of the waves and the uneven pack leave 0.3 per cent.
    assert share == pytest.approx(1 / (1 + storage(result) * oedometric_modulus(run)), rel=0.01)
    assert_balanced(result)


def test_skempton(run):
    result, dry = run("undrained", "isotropic"), run("undrained", "isotropic_dry").report["last"]
    bulk_modulus = STRESS_STEP / sum(dry[f"strain_{axis}"] for axis in "xyz")
    share = result.report["last"]["pressure_mean_Pa"] / STRESS_STEP
    assert share == pytest.approx(1 / (1 + storage(result) * bulk_modulus), rel=0.01)
    assert_balanced(result)


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_terzaghi(run, ranks):
    result = run("consolidation", "two_way", *QUICK, ranks=ranks)
    history, sample, stiffness = result.history, result.case["sample"], oedometric_modulus(run)
    height = result.report["reference"]["height"]
    diffusivity = permeability(run) / result.case["fluid"]["viscosity_Pa_s"] / (1 / stiffness + storage(result))
    # The load rises linearly: by linearity the mean of sudden loads at all times of the rise.
    since = history["time_s"][:, None] - sample["ramp_time_s"] * (np.arange(40) + 0.5) / 40
    borne = (since > 0).mean(axis=1)
    analytic = np.mean([terzaghi(diffusivity * time / height**2) for time in since.T], axis=0)
    at_once, finally_ = STRESS_STEP / (stiffness + 1 / storage(result)), STRESS_STEP / stiffness
    settled = (history["strain_z"] - at_once * borne) / (finally_ - at_once)
    drained = borne - history["pressure_mean_Pa"] * (1 + storage(result) * stiffness) / STRESS_STEP
    later = history["time_s"] > sample["ramp_time_s"]
    # The pores at the drained top are a twentieth of the height thick and have its pressure from the start, grains ten across the
    # box are no continuum, and waves of the load are still about: measured 0.020 and 0.009, 0.052 and 0.019.
    assert np.abs(settled - analytic)[later].max() < 0.03
    assert np.sqrt(((settled - analytic)[later] ** 2).mean()) < 0.013
    assert np.abs(drained - analytic)[later].max() < 0.075
    assert np.sqrt(((drained - analytic)[later] ** 2).mean()) < 0.03
    assert analytic[-1] > 0.75
    # The servo holds the total stress: the grains take over what the fluid loses.
    np.testing.assert_allclose(history["sigma_z_Pa"][later], 1.1e7, rtol=5e-3)
    assert_balanced(result)


def test_plots(run, poreslip, tmp_path):
    """Curve, slopes and permeability on one page, from the runs' files alone."""
    two_way = run("consolidation", "two_way", *QUICK)
    results = [two_way, run("darcy", "run"), *(run("undrained", name) for name in ("uniaxial", "uniaxial_dry", "isotropic", "isotropic_dry"))]
    done = poreslip("plot", *(result.directory for result in results), "--out", tmp_path / "plots", "--dpi", "60")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "plots").iterdir()} == {
        "page.html", *(f"{name}.{kind}" for name in ("consolidation", "undrained", "darcy") for kind in ("csv", "png"))}
    tables = {name: pd.read_csv(tmp_path / "plots" / f"{name}.csv") for name in ("consolidation", "undrained", "darcy")}
    assert tables["consolidation"]["settlement_rms"].item() < 0.013 and tables["consolidation"]["pressure_rms"].item() < 0.03
    assert tables["consolidation"]["oedometric_modulus_Pa"].item() == pytest.approx(oedometric_modulus(run), rel=1e-3)
    assert (tables["undrained"]["difference"].abs() < 0.01).all() and len(tables["undrained"]) == 2
    assert tables["darcy"]["permeability_m2"].item() == pytest.approx(permeability(run), rel=1e-12)
    assert "Balances" in (tmp_path / "plots" / "page.html").read_text()
    # What cannot be held against anything, or is of no known kind, is drawn as it is.
    alone = poreslip("plot", two_way.directory, "--out", tmp_path / "alone", "--dpi", "60")
    assert alone.returncode == 0 and "the stiffness is missing" in alone.stderr
    assert {path.name for path in (tmp_path / "alone").iterdir()} == {"page.html", "loading.csv", "loading.png"}
    last = pd.read_csv(tmp_path / "alone" / "loading.csv")
    assert last["strain_z"].item() == pytest.approx(two_way.history["strain_z"][-1], rel=1e-12)


def test_a_staggered_soft_fluid_gives_the_same(run):
    """A gas: the fluid's stiffness is a hundredth of the skeleton's, and either split is stable."""
    soft = ("fluid.compressibility_per_Pa=1e-8", "sample.loading_time_s=4e-5")
    undrained = run("undrained", "uniaxial", *soft).history["pressure_mean_Pa"]
    staggered = run("undrained", "uniaxial", *soft, 'flow.split="staggered"').history["pressure_mean_Pa"]
    # The staggered forces are on average half an interval late.
    np.testing.assert_allclose(staggered[-5:], undrained[-5:], rtol=0.02)


SMALL = ("flow.interval_tolerance=0", "pack.box_m=[0.014, 0.014, 0.014]", "sample.loading_time_s=5e-5", "sample.ramp_time_s=4e-6", "output.checkpoint_every_steps=0")


def staggered(poreslip, stage_cache, out, interval: int, *overrides: str):
    """A fluid of 2.5 times the skeleton's stiffness between small grains' steps, solved at intervals."""
    every = f"output.history_interval_steps={interval * max(1, 40 // interval)}"
    inputs = settings("flow.split=staggered", f"flow.interval_steps={interval}", every, *SMALL, *overrides)
    command = ["run", CASES / "consolidation" / "consolidation.toml", "--only", "two_way", "--out", out / str(interval), *inputs]
    return poreslip(*command, env={"PORESLIP_CACHE": str(stage_cache)})


@pytest.mark.parametrize("restitution", [0.5, pytest.param(0.9, marks=pytest.mark.slow)])
def test_the_staggered_limit(poreslip, stage_cache, tmp_path, restitution):
    """The interval at which the staggered split becomes unstable, by bisection, is within a factor of two of the estimate."""
    overrides = (f"material.restitution={restitution}",)
    case = load_case(CASES / "consolidation" / "consolidation.toml", [*SMALL, *overrides]).runs[0]
    estimate = layers_of(case).longest_interval()

    def stable(interval: int) -> bool:
        ended = staggered(poreslip, stage_cache, tmp_path, interval, *overrides)
        assert ended.returncode in (0, 3), ended.stderr
        assert ("limits found: 1 to 4 times that" in ended.stdout) == (interval > estimate)
        if ended.returncode == 3:
            assert "stiffer than the skeleton" in ended.stderr or "grains were lost" in ended.stderr
            return False
        # The waves of the load's rise have gone, or are about to come back.
        energy = Result(tmp_path / str(interval) / "consolidation" / "two_way").history["kinetic_energy_J"]
        return energy[-1] < 0.3 * energy.max()

    low, high = (estimate + 1) // 2, 2 * estimate
    assert stable(low) and not stable(high)
    while high - low > 2:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    assert estimate / 2 <= low and high <= 2 * estimate


def test_a_hopeless_staggered_interval_is_refused(poreslip, stage_cache, tmp_path):
    ended = staggered(poreslip, stage_cache, tmp_path, 40)
    assert ended.returncode == 2, ended.stderr
    assert "flow.interval_steps = 40" in ended.stderr and 'flow.split = "undrained"' in ended.stderr
