"""What a case does not need is not imported, loaded, computed or written."""

from __future__ import annotations

import json
import sys

import pytest
from processes import environment, run_process
from sample_runs import SQUEEZE
from tiny_fault import settings

PROBE = """
import json, re, sys
from coupling.command_line import main
status = main(sys.argv[2:])
mapped = sorted({line.split()[-1] for line in open("/proc/self/maps") if line.split()[-1].startswith("/")})
with open(sys.argv[1], "w") as file:
    json.dump({"status": status, "modules": sorted(sys.modules), "mapped": mapped}, file)
"""


@pytest.fixture
def probe(run_fault, tiny_case, tmp_path, stage_cache):
    """`probe(*overrides, run="dry")`: run the tiny fault; the modules imported, the files mapped, and the directory of results."""

    def run(*overrides: str, run: str = "dry"):
        found, out = tmp_path / "found.json", tmp_path / "probed"
        arguments = ["run", tiny_case, "--only", run, "--out", out, *settings(*overrides)]
        done = run_process([sys.executable, "-c", PROBE, found, *arguments], 120.0, tmp_path, environment(PORESLIP_CACHE=str(stage_cache)))
        assert done.returncode == 0, done.stderr
        result = json.loads(found.read_text())
        assert result["status"] == 0
        return set(result["modules"]), " ".join(result["mapped"]).lower(), out / "tiny" / run

    return run


def test_a_dry_run_loads_no_flow(probe):
    modules, mapped, directory = probe()
    assert not modules & {"flowsolver", "poreslip_network", "poreslip_flow", "numexpr", "meshio", "matplotlib", "pandas", "postproc"}
    for library in ("poreslip_network", "poreslip_flow", "petsc", "cgal", "mpfr", "numexpr"):
        assert library not in mapped, library
    assert "libporeslip_liggghts.so" in mapped
    assert sorted(path.name for path in directory.iterdir()) == [
        "bonds.csv", "case.json", "history.csv", "log.liggghts", "report.json", "report.md"]  # fmt: skip


def test_no_flow_is_dry_too(probe):
    modules, mapped, directory = probe("flow.kind=none", "pressure.mode=none")
    assert "flowsolver" not in modules and "poreslip_network" not in mapped
    log = (directory / "log.liggghts").read_text()
    assert "pore_force all" not in log


def test_a_prescribed_pressure_loads_no_petsc(probe):
    modules, mapped, directory = probe(run="wet")
    assert "flowsolver" in modules and "poreslip_network" in mapped
    assert not modules & {"poreslip_flow", "numexpr", "meshio", "matplotlib", "pandas", "petsc4py"}
    assert "petsc" not in mapped and "poreslip_flow" not in mapped
    assert not (directory / "snapshots").exists()
    assert not list(directory.glob("checkpoint-*"))


#: A solved flow in the tiny fault: water, and what the phases of each kind of flow are beside those of the grains.
SOLVED = ("flow.kind=solve", "loading.time_step_fraction=0.25", "loading.horizontal_strain=2e-5")
GRAINS = {"stages", "engine", "measures", "output"}
MESHED = GRAINS | {"tessellation", "forces", "exchange"}
PHASES = {
    "dry": ("dry", (), GRAINS),
    "prescribed": ("wet", (), MESHED | {"pressure"}),
    "one-way": ("wet", (*SOLVED, "flow.two_way=false"), MESHED | {"geometry", "assembly", "solve", "flow"}),
    "two-way": ("wet", (*SOLVED, "flow.two_way=true"), MESHED | {"geometry", "assembly", "solve", "flow"}),
}


@pytest.mark.parametrize("kind", PHASES)
def test_only_the_phases_of_its_kind_are_entered(probe, kind):
    run, overrides, phases = PHASES[kind]
    modules, mapped, directory = probe(*overrides, run=run)
    report = json.loads((directory / "report.json").read_text())
    (entered,) = report["cpu_s_by_phase_and_rank"]
    assert set(entered) == phases
    assert ("poreforce/two_way" in (directory / "log.liggghts").read_text()) == (kind == "two-way")
    assert ("solver" in report and bool(report["solver"])) == (kind in ("one-way", "two-way"))
    assert ("coupling.fluid.two_way_flow" in modules) == (kind in ("one-way", "two-way"))
    # Two-way, the error of the intervals; nothing else of what makes them follow it.
    assert set(report.get("interval_error", {})) == ({"worst", "final", "pressure_change_Pa"} if kind == "two-way" else set())
    assert "coupling.fluid.following_intervals" not in modules


#: What the report of each kind tells of the fluid: balances, and counts.
BALANCES = {
    "dry": set(), "prescribed": {"momentum_residual"}, "one-way": {"momentum_residual", "mass_residual", "remesh_mass_residual"},
    "two-way": {"momentum_residual", "mass_residual", "remesh_mass_residual", "work_residual"},
}  # fmt: skip
OF_MESH = {"balances", "remeshes", "pore_network_by_rank"}
COUNTS = {"dry": set(), "prescribed": OF_MESH, "one-way": OF_MESH | {"solver"}, "two-way": OF_MESH | {"solver", "interval_error"}}


@pytest.mark.parametrize(("kind", "bonded"), [("dry", True), ("dry", False), ("prescribed", True), ("one-way", False), ("two-way", True)])
def test_the_report_tells_of_what_the_run_has(run_fault, kind, bonded):
    name, overrides, _ = PHASES[kind]
    run = run_fault(*overrides, *(() if bonded else ("bonds.enabled=false",)), run=name)
    report, page = json.loads((run / "report.json").read_text()), (run / "report.md").read_text()
    of_fluid, balances = COUNTS["two-way"], BALANCES["two-way"]
    assert of_fluid & set(report) == COUNTS[kind]
    for told in (report, report["quasi_static_checks"], report.get("balances", {})):
        assert balances & set(told) == BALANCES[kind]
    assert all(0.0 < report[name] < 1e-10 for name in BALANCES[kind] & {"momentum_residual", "work_residual"})
    assert ("mesh kept" in page, "momentum_residual" in page, "solver: " in page) == (kind != "dry", kind != "dry", "way" in kind)
    assert ("forces" in report["interpretations"]) == ("fluid force" in page) == (kind != "dry")
    assert {"p_left_Pa", "mesh_rebuilds"} & set(report["last"]) == (set() if kind == "dry" else {"p_left_Pa", "mesh_rebuilds"})
    assert ("outflow_m3_per_s" in report["last"]) == ("way" in kind)
    of_bonds = {"bonds", "bonds_broken"} & set(report) | {"bonds_intact", "bonds_broken_shear"} & set(report["last"])
    assert of_bonds == ({"bonds", "bonds_broken", "bonds_intact", "bonds_broken_shear"} if bonded else set())
    assert ("bonds formed" in page) == bonded and ("| count |" in page) == (bonded or kind != "dry")
    # What every run has.
    assert {"unbalanced_force_ratio", "energy_gain", "held_stress_error", "loading_rate"} <= set(report["quasi_static_checks"])
    assert {"strain", "slip_left_m", "kinetic_energy_J"} <= set(report["last"])


@pytest.mark.parametrize("kind", ["prescribed", "two-way"])
def test_forces_without_the_drag_have_no_balance_of_momentum(run_fault, kind):
    name, overrides, _ = PHASES[kind]
    report = json.loads((run_fault(*overrides, "flow.forces=pressure", run=name) / "report.json").read_text())
    assert set(report["balances"]) == BALANCES[kind] - {"momentum_residual", "work_residual"} and "momentum_residual" not in report["quasi_static_checks"]


def test_only_a_solved_flow_holds_its_memory(probe):
    peaks = []
    for kind in ("dry", "prescribed", "two-way"):
        run, overrides, _ = PHASES[kind]
        directory = probe(*overrides, run=run)[2]
        peaks.append(json.loads((directory / "report.json").read_text())["peak_memory_bytes_by_rank"][0])
    dry, prescribed, solved = peaks
    # At 467 grains the mesh is lost in the noise of a megabyte or two; the solver's libraries are not.
    assert max(dry, prescribed) + 1e7 < solved


def test_only_a_formula_loads_numexpr(probe):
    modules, _, _ = probe("pressure.mode=expression", "pressure.expression=1e6 * (s < 0)", run="wet")
    assert "numexpr" in modules


@pytest.mark.parametrize(("kind", "solved"), [("none", False), ("solve", True)])
def test_only_a_solved_flow_loads_petsc(tmp_path, stage_cache, kind, solved):
    path, found = tmp_path / "squeeze.toml", tmp_path / "found.json"
    path.write_text(SQUEEZE)
    inputs = settings(f"flow.kind={kind}", "sample.loading_time_s=2e-6")
    done = run_process([sys.executable, "-c", PROBE, found, "run", path, "--out", tmp_path, *inputs], 120.0, tmp_path, environment(PORESLIP_CACHE=str(stage_cache)))
    assert done.returncode == 0, done.stderr
    loaded = json.loads(found.read_text())
    assert ("flowsolver.flow" in loaded["modules"]) == ("petsc" in " ".join(loaded["mapped"]).lower()) == solved
    assert ("flowsolver" in loaded["modules"]) == solved


def test_snapshots_load_meshio(probe):
    modules, _, directory = probe("output.snapshots=1")
    assert "meshio" in modules
    assert len(list((directory / "snapshots").glob("grains_*.vtu"))) >= 1


def test_no_bonds_no_bond_style(run_fault, tiny_case, poreslip, tmp_path):
    cache = tmp_path / "cache"
    command = ["run", tiny_case, "--only", "dry", "--out", tmp_path / "out", *settings("bonds.enabled=false")]
    done = poreslip(*command, env={"PORESLIP_CACHE": str(cache)})
    assert done.returncode == 0, done.stderr
    assert sorted(path.name.split("-")[0] for path in cache.iterdir()) == ["pack", "stress"]
    logs = [path.read_text() for path in cache.glob("*/log.liggghts")] + [(tmp_path / "out" / "tiny" / "dry" / "log.liggghts").read_text()]
    assert not (tmp_path / "out" / "tiny" / "dry" / "bonds.csv").exists()
    for log in logs:
        assert "pair_style     gran model hooke/stiffness tangential history" in log
        assert "tangential bond" not in log and "\nfix bonds" not in log


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.parallel)])
def test_a_plan_writes_nothing(tiny_case, poreslip, tmp_path, ranks):
    done = poreslip("run", tiny_case, "--dry-run", "--out", tmp_path / "out", ranks=ranks, env={"PORESLIP_CACHE": str(tmp_path / "cache")})
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("nothing was run") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_a_period_has_no_walls(run_fault, upright_case):
    """Along z the upright fault has neither the pack's walls nor the plates that load the other one."""
    for run, has in ((run_fault(case=upright_case, out="upright"), False), (run_fault(out="plain"), True)):
        assert ("wall/plane normal 0 0 " in (run / "log.liggghts").read_text().replace("  ", " ")) == has
        report = json.loads((run / "report.json").read_text())
        assert any(name.startswith("z_") for name in report["pack"]["stress_Pa"]) == has
