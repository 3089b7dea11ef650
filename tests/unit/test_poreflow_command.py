"""The command `poreflow`: what it reports, what it reads, what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from flowsolver.command_line import main

BOX = ["--box", "0", "1", "0", "1", "0", "1"]
DRIVEN = ["--face", "ymin=1", "--face", "ymax=0", "--viscosity", "10"]


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
    assert report["mass_residual"] < 1e-10 and report["momentum_residual"] < 1e-10
    assert set(report["seconds"]) == {"tessellate", "geometry", "assemble", "setup", "solve", "forces", "total"}
    forces = np.load(tmp_path / "forces.npz")
    assert forces["force"].shape == (1000, 3) and forces["force"][:, 1].sum() == pytest.approx(1.0, abs=1e-9)
    assert forces["wall_force"][2] == pytest.approx(1.0, abs=1e-12)

    import meshio

    assert len(meshio.read(tmp_path / "out.vtu").points) == 5579


def test_a_body_force_and_a_pressure_drop_give_a_like_permeability(pack, tmp_path):
    driven = report_of(tmp_path, pack, *BOX, *DRIVEN, "--periodic", "xz")
    body = report_of(tmp_path, pack, *BOX, "--periodic", "xyz", "--body-force", "0", "1", "0", "--viscosity", "10")
    assert body["permeability"] == pytest.approx(driven["permeability"], rel=0.15)


def test_flow_in_time_tends_to_the_steady_state(pack, tmp_path):
    steady = report_of(tmp_path, pack, *BOX, *DRIVEN)
    late = report_of(tmp_path, pack, *BOX, *DRIVEN, "--dt", "10", "--steps", "2", "--initial", "0.5")
    early = report_of(tmp_path, pack, *BOX, *DRIVEN, "--dt", "1e-9", "--initial", "0.5")
    assert late["outflow"]["ymax"] == pytest.approx(steady["outflow"]["ymax"], rel=1e-6)
    assert early["outflow"]["ymax"] > 1.5 * steady["outflow"]["ymax"]
    # water at these sizes is too quick to follow explicitly
    assert main([str(pack), *BOX, *DRIVEN, "--dt", "1", "--explicit"]) == 2


@pytest.mark.parallel
def test_two_ranks_give_the_same(pack, tmp_path, mpirun):
    """Two ranks."""
    one = report_of(tmp_path, pack, *BOX, *DRIVEN)
    out = tmp_path / "two.json"
    done = mpirun(2, ["-m", "flowsolver", pack, *BOX, *DRIVEN, "--json", out])
    assert done.returncode == 0, done.stderr
    two = json.loads(out.read_text())
    assert two["ranks"] == 2 and two["pores"] == one["pores"]
    assert two["permeability"] == pytest.approx(one["permeability"], rel=1e-9)


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


REFUSED = {
    "no file": (["/no/such/pack", *BOX], "cannot read /no/such/pack"),
    "no box": (["PACK"], "give --box"),
    "short lines": (["SHORT", *BOX], "expected four on each line"),
    "words": (["WORDS", *BOX], "expected four numbers x y z r"),
    "binary": (["BINARY", *BOX], "cannot read|expected four numbers"),
    "cut dump": (["CUT"], "expected a dump|ends after"),
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
    "nowhere to write": (["PACK", *BOX, *DRIVEN, "--json", "/no/such/place/out.json"], "cannot write"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case, pack, tmp_path, capsys):
    arguments, message = REFUSED[case]
    files = {"PACK": pack, "SHORT": tmp_path / "s", "WORDS": tmp_path / "w", "BINARY": tmp_path / "b", "CUT": tmp_path / "c"}
    files["SHORT"].write_text("1 2 3\n")
    files["WORDS"].write_text("grain here there\n")
    files["BINARY"].write_bytes(bytes(range(256)))
    files["CUT"].write_text("ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\nITEM: ATOMS id x y z radius\n1 .5 .5 .5 .1\n")
    assert main([str(files.get(a, a)) for a in arguments]) == 2
    assert re.search(message, capsys.readouterr().err)
