"""The command `poreflow`: what it reports, what it reads, what it refuses."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from flowsolver.command.command_line import main

BOX = ["--box", "0", "1", "0", "1", "0", "1"]
DRIVEN = ["--face", "ymin=1", "--face", "ymax=0", "--viscosity", "10"]
KEYS = [
    "grains", "pores", "throats", "porosity", "permeability", "outflow", "mass_residual", "momentum_residual", "limited_pores", "limited_throats",
    "steps", "iterations", "ksp_reason", "seconds", "cpu_seconds", "cpu_seconds_files", "peak_memory_bytes", "ranks",
]  # fmt: skip


@pytest.fixture(scope="module")
def pack(tmp_path_factory) -> Path:
    """The peer's pack as text."""
    spheres = np.load(Path(__file__).resolve().parent.parent / "data" / "peer_pack_1000.npz")["spheres"]
    path = tmp_path_factory.mktemp("pack") / "pack.txt"
    np.savetxt(path, spheres, fmt="%.17g", header="x y z r")
    return path


def report_of(tmp_path: Path, *arguments: str | Path) -> dict:
    out = tmp_path / "out.json"
    assert main([*map(str, arguments), "--json", str(out)]) == 0
    return json.loads(out.read_text())


def test_steady_report(pack, tmp_path):
    report = report_of(tmp_path, pack, *BOX, *DRIVEN, "--forces", tmp_path / "forces.npz", "--vtu", tmp_path / "out.vtu")
    assert (report["grains"], report["pores"], report["throats"]) == (1000, 5579, 11154)
    assert report["porosity"] == pytest.approx(0.3643280438, abs=1e-9)
    assert report["permeability"] == pytest.approx(10 * report["outflow"]["ymax"], rel=1e-9)
    assert list(report) == KEYS
    assert report["mass_residual"] < 1e-10 and report["momentum_residual"] < 1e-10
    seconds = report["seconds"]
    assert set(seconds) == {"tessellate", "geometry", "assemble", "setup", "solve", "forces", "files", "total"}
    assert seconds["total"] > sum(spent for name, spent in seconds.items() if name != "total") > seconds["files"] > 0.0
    assert 0.0 < report["cpu_seconds_files"] < report["cpu_seconds"] < float("inf")
    forces = np.load(tmp_path / "forces.npz")
    assert forces["force"].shape == (1000, 3) and forces["force"][:, 1].sum() == pytest.approx(1.0, abs=1e-9)
    assert forces["wall_force"][2] == pytest.approx(1.0, abs=1e-12)

    import meshio

    assert len(meshio.read(tmp_path / "out.vtu").points) == 5579


def test_a_body_force_and_a_pressure_drop_give_a_like_permeability(pack, tmp_path):
    driven = report_of(tmp_path, pack, *BOX, *DRIVEN, "--periodic", "xz")
    body = report_of(tmp_path, pack, *BOX, "--periodic", "xyz", "--body-force", "0", "1", "0", "--viscosity", "10", "--forces", tmp_path / "forces.npz")
    assert body["permeability"] == pytest.approx(driven["permeability"], rel=0.15)
    # what pushes the fluid is borne by the grains
    assert body["momentum_residual"] < 1e-10
    solid = (4 / 3 * np.pi * np.loadtxt(pack)[:, 3] ** 3).sum()
    np.testing.assert_allclose(np.load(tmp_path / "forces.npz")["force"].sum(axis=0), [0, 1 - solid, 0], atol=1e-9)


def test_fluid_at_rest_lifts_grains_by_their_own_weight_of_it(pack, tmp_path):
    """Archimedes; and grains and walls bear together what the fluid weighs."""
    weight = 9810.0
    report = report_of(tmp_path, pack, *BOX, "--body-force", "0", "0", -weight, "--forces", tmp_path / "forces.npz")
    forces, radius = np.load(tmp_path / "forces.npz"), np.loadtxt(pack)[:, 3]
    buoyancy = weight * 4 / 3 * np.pi * radius[forces["id"]] ** 3
    np.testing.assert_allclose(forces["force"], buoyancy[:, None] * [0, 0, 1], atol=1e-4 * buoyancy.min())
    borne = forces["force"][:, 2].sum() + forces["wall_force"][5] - forces["wall_force"][4]
    assert borne == pytest.approx(-weight * (1 - (4 / 3 * np.pi * radius**3).sum()), rel=1e-9)
    assert report["outflow"] == {}


def test_a_weighty_fluid_that_flows_drags_as_one_without_weight(pack, tmp_path):
    """Pressures that differ by the hydrostatic one drive the same flow, and the same drag beside the buoyancy."""
    for name, faces, more in (("light", ("zmin=1000", "zmax=0"), ()), ("heavy", ("zmin=1000 - 9810 * z", "zmax=-9810 * z"), ("--body-force", 0, 0, -9810))):
        report_of(tmp_path, pack, *BOX, "--face", faces[0], "--face", faces[1], *more, "--tolerance", "1e-11", "--forces", tmp_path / f"{name}.npz")
    light, heavy, radius = np.load(tmp_path / "light.npz"), np.load(tmp_path / "heavy.npz"), np.loadtxt(pack)[:, 3]
    buoyancy = 9810 * 4 / 3 * np.pi * radius[heavy["id"], None] ** 3 * [0, 0, 1]
    np.testing.assert_allclose(heavy["force"] - buoyancy, light["force"], atol=1e-6 * np.abs(light["force"]).max())


def test_flow_in_time_tends_to_the_steady_state(pack, tmp_path):
    steady = report_of(tmp_path, pack, *BOX, *DRIVEN)
    late = report_of(tmp_path, pack, *BOX, *DRIVEN, "--dt", "10", "--steps", "2", "--initial", "0.5")
    early = report_of(tmp_path, pack, *BOX, *DRIVEN, "--dt", "1e-9", "--initial", "0.5")
    assert late["outflow"]["ymax"] == pytest.approx(steady["outflow"]["ymax"], rel=1e-6)
    assert early["outflow"]["ymax"] > 1.5 * steady["outflow"]["ymax"]
    slow = ["--dt", "1e-9", "--initial", "0.5", "--compressibility", "1e-3"]
    implicit, explicit = report_of(tmp_path, pack, *BOX, *DRIVEN, *slow), report_of(tmp_path, pack, *BOX, *DRIVEN, *slow, "--explicit")
    assert explicit["outflow"] == pytest.approx(implicit["outflow"], rel=1e-3) and max(implicit["mass_residual"], explicit["mass_residual"]) < 1e-12
    # water at these sizes is too quick to follow explicitly
    assert main([str(pack), *BOX, *DRIVEN, "--dt", "1", "--explicit"]) == 2


@pytest.mark.parallel
@pytest.mark.parametrize("law", ["duct", "hydraulic-radius"])
def test_two_ranks_give_the_same(pack, tmp_path, mpirun, law):
    """Two ranks, at the default tolerance."""
    arguments = [pack, *BOX, *DRIVEN, "--conductance", law]
    one = report_of(tmp_path, *arguments, "--forces", tmp_path / "one.npz")
    out = tmp_path / "two.json"
    done = mpirun(2, ["-m", "flowsolver", *arguments, "--json", out, "--forces", tmp_path / "two.npz"])
    assert done.returncode == 0, done.stderr
    two = json.loads(out.read_text())
    assert two["ranks"] == 2 and two["pores"] == one["pores"]
    assert two["permeability"] == pytest.approx(one["permeability"], rel=1e-9)
    forces = [np.load(tmp_path / f"{name}.npz") for name in ("one", "two")]
    np.testing.assert_array_equal(forces[1]["id"], forces[0]["id"])
    np.testing.assert_allclose(forces[1]["force"], forces[0]["force"], rtol=0, atol=1e-9 * np.abs(forces[0]["force"]).max())


def test_reads_a_dump(pack, tmp_path):
    spheres = np.loadtxt(pack)
    dump = tmp_path / "dump.grains"
    with open(dump, "w") as file:
        for step in (0, 100):
            file.write(f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n1000\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n")
            file.write("ITEM: ATOMS id type x y z vx radius \n")
            for k, (x, y, z, r) in enumerate(spheres):
                file.write(f"{1000 - k} 1 {x:.17g} {y:.17g} {z:.17g} 0 {r if step else 0.5 * r:.17g}\n")
    assert report_of(tmp_path, dump, *DRIVEN)["permeability"] == pytest.approx(report_of(tmp_path, pack, *BOX, *DRIVEN)["permeability"], rel=1e-9)


def test_a_dumps_own_box_and_periods(pack, tmp_path, capsys):
    """They hold unless the command line says otherwise, which is told."""
    spheres = np.loadtxt(pack)
    dump = tmp_path / "dump.grains"
    rows = "".join(f"{k} {x:.17g} {y:.17g} {z:.17g} {r:.17g}\n" for k, (x, y, z, r) in enumerate(spheres))
    dump.write_text(f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1000\nITEM: BOX BOUNDS pp ff pp\n0 1\n0 1\n0 1\nITEM: ATOMS id x y z radius\n{rows}")
    wrapped = report_of(tmp_path, pack, *BOX, *DRIVEN, "--periodic", "xz")["permeability"]
    assert report_of(tmp_path, dump, *DRIVEN)["permeability"] == pytest.approx(wrapped, rel=1e-9)
    assert report_of(tmp_path, dump, *DRIVEN, "--periodic", "zx", *BOX)["permeability"] == pytest.approx(wrapped, rel=1e-9)
    assert capsys.readouterr().err == ""
    walled = report_of(tmp_path, pack, *BOX, *DRIVEN)["permeability"]
    assert report_of(tmp_path, dump, *DRIVEN, "--periodic", "")["permeability"] == pytest.approx(walled, rel=1e-9)
    assert capsys.readouterr().err == f"poreflow: {dump} is periodic in xz (BOX BOUNDS pp ff pp): taken is --periodic of none\n"
    report_of(tmp_path, dump, *DRIVEN, "--box", "0", "1", "0", "1.1", "0", "1")
    assert capsys.readouterr().err == f"poreflow: {dump} has a box of its own, 0 1 0 1 0 1 m: taken is --box\n"


@pytest.mark.parametrize("columns", ["xs ys zs diameter", "radius id yu xu zu", "vx id z y x diameter radius"])
def test_a_dump_of_other_columns(pack, tmp_path, columns):
    """Scaled by the box, without ids; unwrapped, some grains periods away; both sizes. A line of the maker's own stands first."""
    spheres = np.loadtxt(pack)
    away = np.random.default_rng(1).integers(-2, 3, (1000, 2)) * [1.0, 2.0]
    value = {"id": np.arange(1000), "radius": spheres[:, 3], "diameter": 2 * spheres[:, 3], "vx": np.full(1000, np.nan)}
    for k, axis in enumerate("xyz"):
        low, period = (0.0, 1.0, 0.0)[k], (1.0, 1.0, 2.0)[k]
        plain = low + period * spheres[:, k]
        value |= {axis: plain, f"{axis}s": spheres[:, k], f"{axis}u": plain + (away[:, k // 2] if axis != "y" else 0.0)}
    rows = "".join(" ".join(f"{value[name][k]:.17g}" for name in columns.split()) + "\n" for k in range(1000))
    dump, text = tmp_path / "dump.grains", tmp_path / "text"
    dump.write_text(f"# of mine\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1000\nITEM: BOX BOUNDS pp ff pp\n0 1\n1 2\n0 2\nITEM: ATOMS {columns}\n{rows}")
    np.savetxt(text, np.column_stack([value["x"], value["y"], value["z"], value["radius"]]), fmt="%.17g")
    forces = [tmp_path / "dump.npz", tmp_path / "text.npz"]
    found = report_of(tmp_path, dump, *DRIVEN, "--forces", forces[0])
    expected = report_of(tmp_path, text, "--box", "0", "1", "1", "2", "0", "2", "--periodic", "xz", *DRIVEN, "--forces", forces[1])
    assert found["permeability"] == pytest.approx(expected["permeability"], rel=1e-9)
    np.testing.assert_array_equal(np.load(forces[0])["id"], np.arange(1000))
    np.testing.assert_allclose(np.load(forces[0])["force"], np.load(forces[1])["force"], rtol=0, atol=1e-9 * np.abs(np.load(forces[1])["force"]).max())


def history_of(path: Path) -> dict[str, np.ndarray]:
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_fourier_decay_from_the_command_line(pack, tmp_path):
    """A periodic box, from a cosine along z: each step of backward Euler divides its amplitude by 1 + k (2 pi)^2 dt / (viscosity phi beta)."""
    box = [pack, *BOX, "--periodic", "xyz"]
    permeability = report_of(tmp_path, *box, "--body-force", "0", "0", "1", "--viscosity", "1e-3")["permeability"]
    report = report_of(tmp_path, *box, "--dt", "5e-10", "--steps", "4", "--initial", f"5 + 3 * cos({2 * np.pi!r} * z)", "--history", tmp_path / "h.csv")
    history = history_of(tmp_path / "h.csv")
    rate = permeability * (2 * np.pi) ** 2 / (1e-3 * report["porosity"] * 4.5e-10)
    np.testing.assert_allclose(history["time"], 5e-10 * np.arange(5))
    # A wave of ten grains' length in an uneven pack.
    assert 1 / history["amplitude"][1] - 1 == pytest.approx(rate * 5e-10, rel=0.1)
    assert (np.diff(history["amplitude"]) < 0).all()
    np.testing.assert_allclose(history["pressure_mean"], history["pressure_mean"][0], rtol=1e-8)
    assert (np.diff(history["pressure_max"]) < 0).all()


def test_pressures_by_place_and_time(pack, tmp_path):
    """A linear pressure on all walls returns; a pressure that rises with time is that of the step's end."""
    linear = [part for face in ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax") for part in ("--face", f"{face}=1e5 * (t < 3) * z")]
    report_of(tmp_path, pack, *BOX, *linear, "--dt", "1", "--steps", "3", "--history", tmp_path / "h.csv")
    history = history_of(tmp_path / "h.csv")
    assert history["pressure_max"][0] == 0.0
    assert history["pressure_mean"][1] == pytest.approx(5e4, rel=0.02) and history["pressure_mean"][2] == pytest.approx(history["pressure_mean"][1], rel=1e-6)
    assert abs(history["pressure_max"][3]) < 1e-3


@pytest.mark.parametrize(("value", "time"), [("1e5 / 3", []), ("7 * t", ["--dt", "1e3", "--steps", "2"]), ("2 + 0 * x", None)])
def test_pressures_even_over_a_wall_tell_a_permeability(pack, tmp_path, value, time):
    found = report_of(tmp_path, pack, *BOX, "--face", f"ymin={value}", "--face", "ymax=0", "--viscosity", "10", *(time or []))["permeability"]
    expected = report_of(tmp_path, pack, *BOX, *DRIVEN)["permeability"]
    assert found is None if time is None else found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("other", [("--face", "xmin=1"), ("--point", "0.5", "0.5", "0.5", "0"), ("--source", "0.5", "0.5", "0.5", "1e-3"), ("--inflow", "xmin=1e-3")])
def test_a_flow_with_other_ways_in_or_out_tells_no_permeability(pack, tmp_path, other):
    alone = report_of(tmp_path, pack, *BOX, *DRIVEN)
    assert alone["permeability"] > 0
    more = report_of(tmp_path, pack, *BOX, *DRIVEN, *other)
    assert more["permeability"] is None and abs(more["outflow"]["ymax"] / alone["outflow"]["ymax"] - 1) > 1e-6


def test_what_enters_at_a_point_leaves(pack, tmp_path):
    report = report_of(tmp_path, pack, *BOX, "--face", "zmax=0", "--source", "0.5", "0.5", "0.5", "2e-6", "--inflow", "xmin=1e-6 * (y < 0.5)")
    half = report["outflow"]["xmin"]
    assert half == pytest.approx(-0.5e-6, rel=0.2) and report["outflow"]["points"] == -2e-6
    assert report["outflow"]["zmax"] == pytest.approx(2e-6 - half, rel=1e-8)
    given = report_of(tmp_path, pack, *BOX, "--face", "zmax=0", "--point", "0.5", "0.5", "0.5", "1e3")["outflow"]
    assert given["zmax"] == pytest.approx(-given["points"], rel=1e-8) and given["zmax"] > 0


def test_negative_numbers_in_any_notation(pack, tmp_path):
    sources = ["--source", "0.5", "0.5", "0.2", "1e-3", "--source", "0.5", "0.5", "0.8"]
    report = report_of(tmp_path, pack, *BOX, *sources, "-1e-3", "--viscosity", "10")
    assert report["mass_residual"] < 1e-10
    assert main([str(pack), *BOX, *DRIVEN, "--dt", "1", "--initial", "-1.5E+5", "--json", str(tmp_path / "out.json")]) == 0


def test_petsc_takes_its_own_options(pack, tmp_path, capfd):
    report_of(tmp_path, pack, *BOX, *DRIVEN)
    report = tmp_path / "jacobi.json"
    assert main([str(pack), *BOX, *DRIVEN, "--json", str(report), "-flow_pc_type", "jacobi", "-flow_ksp_converged_reason"]) == 0
    assert "converged due to CONVERGED_RTOL" in capfd.readouterr().out
    assert json.loads(report.read_text())["iterations"] > 60
    # and of one run only: the next has the defaults again
    assert report_of(tmp_path, pack, *BOX, *DRIVEN)["iterations"] < 30
    assert "converged due to" not in capfd.readouterr().out


REFUSED = {
    "no file": (["/no/such/pack", *BOX], "cannot read /no/such/pack"),
    "no box": (["PACK"], "give --box"),
    "short lines": (["SHORT", *BOX], "short, line 1: '1 2 3' .3 words.: expected four numbers"),
    "no grains": (["EMPTY", *BOX], "^poreflow: .*empty holds no grains"),
    "words": (["WORDS", *BOX], "words, line 1: 'grain here there' .* expected four numbers on each line, x y z r"),
    "binary": (["BINARY", *BOX], "cannot read .*binary: it is no text"),
    "cut dump": (["CUT"], "cut ends after 1 of 2 grains"),
    "face": (["PACK", *BOX, "--face", "top=1"], "expected FACE=VALUE"),
    "face value": (["PACK", *BOX, "--face", "xmin=high"], "'high' is not a number"),
    "viscosity": (["PACK", *BOX, *DRIVEN[:4], "--viscosity", "0"], "viscosity is 0.0"),
    "axes": (["PACK", *BOX, "--periodic", "w"], "--periodic is 'w'"),
    "periodic face": (["PACK", *BOX, *DRIVEN, "--periodic", "y"], "face 'ymin' is periodic"),
    "both times": (["PACK", *BOX, *DRIVEN, "--steady", "--dt", "1"], "exclude each other"),
    "steps": (["PACK", *BOX, *DRIVEN, "--dt", "1", "--steps", "0"], "--steps is 0"),
    "small box": (["PACK", "--box", "0", "1", "0", "0.5", "0", "1", *DRIVEN], "outside the box"),
    "flat box": (["PACK", "--box", "0", "1", "0", "0", "0", "1", *DRIVEN], "is not a box"),
    "unknown option": (["PACK", *BOX, "--fast"], "unrecognized arguments: --fast"),
    "nan place": (["NAN", *BOX, *DRIVEN], "grain 7 has position .*nan"),
    "infinite place": (["INFINITE", *BOX, *DRIVEN], "grain 7 has position .*inf"),
    "zero radius": (["ZERO", *BOX, *DRIVEN], "grain 7 has radius 0"),
    "negative radius": (["NEGATIVE", *BOX, *DRIVEN], "grain 7 has radius -"),
    "duplicate grain": (["TWICE", *BOX, *DRIVEN], "grains (7 and 400|400 and 7) have the same centre"),
    "nothing drives": (["PACK", *BOX], "nothing drives a steady flow"),
    "other name": (["PACK", *BOX, "--face", "xmin=1e5*q"], "may name only x, y, z and t, not q"),
    "no formula": (["PACK", *BOX, "--face", "xmin=1e5*"], "neither a number nor a formula"),
    "infinite initial": (["PACK", *BOX, *DRIVEN, "--dt", "1", "--initial", "1/(z-z)"], "--initial does not yield a finite pressure"),
    "infinite face": (["PACK", *BOX, "--face", "xmin=1/(x-x)"], "the pressure of face 'xmin' is not a finite number"),
    "nan inflow": (["PACK", *BOX, "--inflow", "xmin=nan"],  "the inflow of face 'xmin' is not a finite"),
    "face twice": (["PACK", *BOX, "--face", "xmin=1", "--face", "xmin=2"], "--face xmin is given more than once"),
    "point outside": (["PACK", *BOX, "--point", "2", "0", "0", "1"], "--point 2 0 0 1: the point is outside the box"),
    "two pressures in a pore": (["PACK", *BOX, "--point", "0.5", "0.5", "0.5", "1", "--point", "0.5", "0.5", "0.5", "2"], "another pressure"),
    "history of no time": (["PACK", *BOX, *DRIVEN, "--history", "h.csv"], "give --dt"),
    "no time step": (["PACK", *BOX, *DRIVEN, "--dt", "-1"], "dt is -1.0 s"),
    "tolerance": (["PACK", *BOX, *DRIVEN, "--tolerance", "2"], "tolerance is 2.0"),
    "after petsc": (["PACK", *BOX, "-flow_ksp_monitor", "--dt", "1"], "those come last"),
    "petsc tolerance": (["PACK", *BOX, *DRIVEN, "-flow_ksp_rtol", "1e-3"], "give --tolerance"),
    "misspelt petsc": (["PACK", *BOX, *DRIVEN, "-flow_ksp_tpye", "cg"], "-flow_ksp_tpye is no option .*did you mean -flow_ksp_type"),
    "other solver's option": (["PACK", *BOX, *DRIVEN, "-flow_pc_type", "jacobi", "-flow_pc_hypre_boomeramg_P_max", "2"], "-flow_pc_hypre_boomeramg_P_max is no"),
    "solver that looks at nothing": (["PACK", *BOX, *DRIVEN, "-flow_ksp_type", "preonly", "-flow_pc_type", "lu"], "give -flow_pc_type cholesky alone"),
    "without prefix": (["PACK", *BOX, *DRIVEN, "--petsc", "-ksp_type gmres"], "-ksp_type is no option .*did you mean -flow_ksp_type"),
    "petsc value": (["PACK", *BOX, *DRIVEN, "-flow_pc_type", "hyper"], "has a value that it does not take: .*hyper"),
    "petsc of no solve": (["PACK", *BOX, *DRIVEN, "--dt", "1e-13", "--explicit", "-flow_pc_type", "jacobi"], "explicit steps have no linear solver"),
    "shrunk dump": (["SHRUNK"], "the box of .*shrunk is shrunk onto its grains in xz .BOX BOUNDS ss ff sf.* give --box"),
    "tilted dump": (["TILTED"], "^poreflow: [^ ]*tilted: its box is tilted .BOX BOUNDS xy xz yz pp pp pp., which"),
    "dump tilted in general": (["GENERAL"], "its box is tilted .BOX BOUNDS abc origin., which"),
    "dump without radius": (["BARE"], "^poreflow: [^ ]*bare has no column radius: expected a dump custom with x y z, .* and radius or diameter; it has id x y z"),
    "face of a dump's period": (["WRAPPED", *DRIVEN], "face 'ymin' is periodic"),
    "nowhere to write": (["PACK", *BOX, *DRIVEN, "--json", "/no/such/place/out.json"], "--json /no/such/place/out.json: there is no directory /no/such/place"),
    "onto a directory": (["PACK", *BOX, *DRIVEN, "--vtu", "/"], "--vtu /: it is a directory"),
    "onto the pack": (["PACK", *BOX, *DRIVEN, "--forces", "PACK"], "--forces .* would overwrite the pack"),
    "onto each other": (["PACK", *BOX, *DRIVEN, "--forces", "a", "--vtu", "./a"], "--vtu a would overwrite what --forces writes"),
    "too big": (["BIG", *BOX, *DRIVEN], "grain 7 has radius 2 m: it is too big for the box"),
    "no void": (["PRESSED", *BOX, *DRIVEN], "the pack leaves .* of the box to the fluid"),
    "code": (["PACK", *BOX, "--face", "xmin=__import__('os').abort()"], "as a formula may hold only numbers"),
    "attribute": (["PACK", *BOX, "--face", "xmin=x.__class__"], "as a formula may hold only numbers"),
    "unknown function": (["PACK", *BOX, "--face", "xmin=open(x)"], "'open.x.' cannot be evaluated"),
    "endless power": (["PACK", *BOX, "--face", "xmin=9**9**9**9"], "cannot be evaluated"),
    "over all places": (["PACK", *BOX, "--face", "xmin=sum(x)"], "other ones on each rank"),
    "complex": (["PACK", *BOX, "--face", "xmin=sqrt(-1+0*x)*1j"], "as a formula may hold only numbers"),
    "endless formula": (["PACK", *BOX, "--face", f"xmin={'+'.join(['x'] * 5000)}"], "'x.x.x.*[.]{3}'"),
    "pressure of some time": (["PACK", *BOX, "--face", "xmin=1/(t-1)", "--dt", "0.5", "--steps", "3"], "the pressure of face 'xmin' is not a finite number"),
    "sealed": (["PACK", *BOX, "--source", "0.5", "0.5", "0.5", "1e-6"], "the sources do not balance"),
    "empty dump": (["NOBODY", *DRIVEN], "there are no grains in the last step of .*nobody"),
    "dump of other places": (["ODD", *DRIVEN], "odd has no column x y z: expected a dump custom with"),
    "box of no size": (["PACK", "--box", "0", "1e-50", "0", "1e-50", "0", "1e-50", *DRIVEN], "the box is 1e-50 m long in x: expected 1e-40 to 1e.40 m; look at its unit"),
    "box of every size": (["PACK", "--box", "0", "1", "0", "1e80", "0", "1", *DRIVEN], "the box is 1e.80 m long in y"),
    "same id": (["SAME", *DRIVEN], "id 3 occurs more than once"),
    "no whole id": (["HALF_ID", *DRIVEN], "a grain has id 2.5: expected whole numbers"),
    "no such id": (["NEGATIVE_ID", *DRIVEN], "id -3 is negative"),
}


# dumps of one grain: how many they say they hold, their box's letters, their columns
DUMPS = {
    "CUT": (2, "ff ff ff", "id x y z radius"),
    "SHRUNK": (1, "ss ff sf", "id x y z radius"),
    "TILTED": (1, "xy xz yz pp pp pp", "id x y z radius"),
    "GENERAL": (1, "abc origin", "id x y z radius"),
    "BARE": (1, "ff ff ff", "id x y z"),
    "ODD": (1, "ff ff ff", "id x yu z radius"),
    "WRAPPED": (1, "ff pp ff", "id x y z radius"),
    "NOBODY": (0, "ff ff ff", "id x y z radius"),
    "SAME": (2, "ff ff ff", "id x y z radius"),
    "HALF_ID": (1, "ff ff ff", "id x y z radius"),
    "NEGATIVE_ID": (1, "ff ff ff", "id x y z radius"),
}


def refused_files(directory: Path, pack: Path) -> dict[str, Path]:
    """The packs that REFUSED names, written to a directory."""
    files = {name: directory / name.lower() for name in (*DUMPS, "SHORT", "WORDS", "BINARY", "NAN", "INFINITE", "ZERO", "NEGATIVE", "TWICE", "EMPTY", "BIG", "PRESSED")}
    files["SHORT"].write_text("1 2 3\n")
    files["EMPTY"].write_text("")
    files["WORDS"].write_text("grain here there\n")
    files["BINARY"].write_bytes(bytes(range(256)))
    for name, (count, bounds, columns) in DUMPS.items():
        line = {"id": {"SAME": "3", "NEGATIVE_ID": "-3", "HALF_ID": "2.5"}.get(name, "1"), "radius": ".1"}
        grain = " ".join(line.get(column, ".5") for column in columns.split())
        grain = {"NOBODY": "", "SAME": f"{grain}\n{grain.replace(' .5', ' .2')}"}.get(name, grain)
        files[name].write_text(
            f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{count}\nITEM: BOX BOUNDS {bounds}\n0 1\n0 1\n0 1\nITEM: ATOMS {columns}\n{grain}\n"
        )
    sound = np.loadtxt(pack)
    for name, column, value in (("NAN", 1, np.nan), ("INFINITE", 0, np.inf), ("ZERO", 3, 0.0), ("BIG", 3, 2.0), ("NEGATIVE", 3, -0.01), ("TWICE", slice(0, 3), sound[400, :3])):
        spheres = sound.copy()
        spheres[7, column] = value
        np.savetxt(files[name], spheres, fmt="%.17g")
    np.savetxt(files["PRESSED"], sound * [1, 1, 1, 2], fmt="%.17g")
    return files | {"PACK": pack}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case, pack, tmp_path, capsys):
    arguments, message = REFUSED[case]
    files = refused_files(tmp_path, pack)
    assert main([str(files.get(a, a)) for a in arguments]) == 2
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parallel
def test_two_ranks_refuse_together(pack, tmp_path, mpirun):
    """Two ranks: every fault ends both with the same status, and one message."""
    refused_files(tmp_path, pack)
    done = mpirun(2, [Path(__file__).with_name("poreflow_refused_ranks.py"), tmp_path, pack])
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"{case} [2, 2]" for case in REFUSED]
    said = re.findall(r"(?m)^poreflow: .*", done.stderr)
    assert len(said) == len(REFUSED)
    for (_, message), line in zip(REFUSED.values(), said):
        assert re.search(message, line), line
