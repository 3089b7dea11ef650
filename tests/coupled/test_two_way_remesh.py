"""A pack that is squeezed so far that its mesh changes all the time: balances, ranks, and going on from a checkpoint."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from sample_runs import SQUEEZE, Result
from tiny_fault import last_grains, settings


@pytest.fixture
def squeeze(poreslip, stage_cache, tmp_path):
    """`squeeze(*overrides, ranks=1, out="out")`: the squeezed pack."""
    path = tmp_path / "squeeze.toml"
    path.write_text(SQUEEZE)

    def run(*overrides: str, ranks: int = 1, out: str = "out") -> Result:
        done = poreslip("run", path, "--out", tmp_path / out, *settings(*overrides), ranks=ranks, env={"PORESLIP_CACHE": str(stage_cache)})
        assert done.returncode == 0, done.stderr
        return Result(tmp_path / out / "squeeze" / "run")

    return run


@pytest.mark.parametrize("split", ["undrained", "predicted", "staggered"])
def test_work_and_mass_close(squeeze, split):
    # Soft enough for either split.
    report = squeeze(f"flow.split={split}", "fluid.compressibility_per_Pa=1e-8").report
    assert report["remeshes"]["repaired"] + report["remeshes"]["rebuilt"] > 30
    assert report["work_residual"] < 1e-10
    assert report["mass_residual"] < 1e-8
    assert report["remesh_mass_residual"] < 1e-12


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_same_on_any_number_of_ranks(squeeze, ranks):
    exact = "flow.solver_tolerance=1e-10"
    one, several = squeeze(exact, out="one").history, squeeze(exact, out="several", ranks=ranks).history
    # Where flips get stuck depends on the order in which they are tried.
    for name in set(one) - {"mesh_rebuilds"}:
        np.testing.assert_allclose(several[name], one[name], rtol=0, atol=1e-7 * np.abs(one[name]).max(), err_msg=name)


@pytest.mark.parametrize("inputs", [("flow.split=predicted",), ("flow.solver_tolerance=1e-3",), ("flow.interval_tolerance=0.1",)], ids=["predicted", "loose", "following"])
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_goes_on_from_a_checkpoint(squeeze, poreslip, ranks, inputs):
    """To the last bit, whatever the linear solver leaves open."""
    result = squeeze(*inputs, "output.snapshots=2", ranks=ranks)
    table, told, grains = (result.directory / "history.csv").read_bytes(), result.report, last_grains(result.directory)
    assert [path.name for path in result.directory.glob("checkpoint-*")] == ["checkpoint-000000000400"]
    done = poreslip("run", "--restart", result.directory, ranks=ranks, env={"PORESLIP_CACHE": "/dev/null"})
    assert done.returncode == 0, done.stderr
    assert (result.directory / "history.csv").read_bytes() == table
    again = last_grains(result.directory)
    for name in {"velocity", "pressure", "pressure_force"} | grains.keys():
        assert again[name].tobytes() == grains[name].tobytes(), name
    for name in ("remeshes", "solver", "interval_error"):
        assert result.report[name] == told[name], name
    # Work up to the checkpoint is one sum, and after it another.
    assert result.report["quasi_static_checks"] == pytest.approx(told["quasi_static_checks"], rel=1e-9, abs=1e-12)


def test_a_damaged_checkpoint_is_told(squeeze, poreslip, tmp_path):
    result = squeeze()
    shutil.copytree(result.directory, tmp_path / "copy" / "squeeze" / "run")
    (tmp_path / "copy" / "squeeze" / "run" / "checkpoint-000000000400" / "flow.npz").write_bytes(b"torn")
    done = poreslip("run", "--restart", tmp_path / "copy" / "squeeze" / "run")
    assert done.returncode == 2
    assert "flow.npz is missing or damaged" in done.stderr
