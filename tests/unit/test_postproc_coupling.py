"""Pairs of runs, one-way and two-way: found among others, their differences as they were made up, and the verdicts that follow from them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import synthetic_run as synthetic  # noqa: E402
from postproc.claims_coupling import pair_findings  # noqa: E402
from postproc.command_line import main  # noqa: E402
from postproc.coupling_pairs import split_off_pairs  # noqa: E402
from postproc.errors import RunFileError  # noqa: E402
from postproc.run_sets import find_runs  # noqa: E402

#: Horizontal stress at the end of the made-up loading, mean of both walls.
STRESS = 1.005 * (1e7 + 2e10 * 1.4e-3)


def write_solved(parent: Path, name: str, two_way: bool, shift_m: float = 0.0, change_Pa: float = 0.0, viscosity: float = 1e-3) -> Path:
    """A run with a solved flow; at the end its grains have moved `shift_m` further along x, and one grain's pressure is off by `change_Pa`."""
    directory = synthetic.write_run(parent, synthetic.Synthetic(number=1, grains=600), name)
    case = json.loads((directory / "case.json").read_text())
    case["flow"] |= {"kind": "solve", "two_way": two_way}
    case["fluid"] = {"viscosity_Pa_s": viscosity}
    (directory / "case.json").write_text(json.dumps(case))
    for path in (directory / "snapshots").glob("grains_*.vtu"):
        mesh = meshio.read(path)
        pressure = np.full(len(mesh.points), 1e6)
        if path.stem != "grains_0":
            mesh.point_data["displacement"] = mesh.point_data["displacement"] + np.array([shift_m, 0.0, 0.0])
            pressure[7] += change_Pa
        mesh.point_data["pressure"] = pressure
        mesh.write(path)
    return directory


def pairs_of(*directories: Path):
    return split_off_pairs(find_runs(directories)[0])


def verdicts(*directories: Path) -> dict[str, str]:
    return {finding.claim: finding.verdict for finding in pair_findings(pairs_of(*directories)[0])}


def test_differences_are_those_that_were_made(tmp_path: Path) -> None:
    one, two = write_solved(tmp_path, "one", False), write_solved(tmp_path, "two", True, shift_m=3e-6, change_Pa=-700.0)
    (pair,), rest = pairs_of(two, one)
    assert not rest and pair.label == "" and (pair.one_way.directory, pair.two_way.directory) == (one, two)
    (only,) = pair.differences
    displacement = np.linalg.norm(only.one_way.displacement, axis=1)
    assert only.displacement_share == pytest.approx(3e-6 / np.sqrt((displacement**2).mean()), rel=1e-9)
    assert only.worst_displacement_share == pytest.approx(3e-6 / displacement.max(), rel=1e-9)
    assert pair.largest_pressure == pytest.approx(700.0, rel=1e-9)
    assert pair.horizontal_stress == pytest.approx(STRESS, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "claim"),
    [({}, None), ({"shift_m": 3e-5}, "i, displacements"), ({"change_Pa": 1200.0}, "i, pressure"), ({"change_Pa": 0.01 * STRESS}, "i, orders")],
)
def test_verdicts(tmp_path: Path, changes: dict, claim: str | None) -> None:
    found = verdicts(write_solved(tmp_path, "one", False), write_solved(tmp_path, "two", True, **({"shift_m": 1e-6, "change_Pa": 900.0} | changes)))
    wrong = {claim} if claim else set()
    # A change of a hundredth of the stress is above 1 kPa too.
    wrong |= {"i, pressure"} if claim == "i, orders" else set()
    assert {name for name, verdict in found.items() if verdict == "not reproduced"} == wrong
    assert set(found) == {"i, displacements", "i, pressure", "i, orders"}


def test_pairs_are_told_apart_and_single_runs_stay(tmp_path: Path) -> None:
    for name, two_way, viscosity in (("a1", False, 1e-3), ("a2", True, 1e-3), ("b1", False, 2e-6), ("b2", True, 2e-6), ("c2", True, 5.0)):
        write_solved(tmp_path, name, two_way, viscosity=viscosity)
    prescribed = synthetic.write_run(tmp_path, synthetic.Synthetic(number=2), "prescribed")
    pairs, rest = pairs_of(*(tmp_path / name for name in ("a1", "a2", "b1", "b2", "c2")), prescribed)
    assert [(pair.one_way.name, pair.two_way.name, pair.label) for pair in pairs] == [
        ("a1", "a2", "fluid.viscosity_Pa_s = 0.001"), ("b1", "b2", "fluid.viscosity_Pa_s = 2e-06")]  # fmt: skip
    assert [run.name for run in rest] == ["c2", "prescribed"]


def test_two_runs_of_one_kind_are_refused(tmp_path: Path) -> None:
    runs = [write_solved(tmp_path, name, two_way) for name, two_way in (("one", False), ("two", True), ("again", True))]
    with pytest.raises(RunFileError, match="it is the same case as"):
        pairs_of(*runs)


def test_snapshots_that_do_not_meet_are_named(tmp_path: Path) -> None:
    one, two = write_solved(tmp_path, "one", False), write_solved(tmp_path, "two", True)
    index = two / "snapshots" / "index.csv"
    table = pd.read_csv(index)
    table["step"] += 1
    table.to_csv(index, index=False)
    with pytest.raises(RunFileError, match="no snapshot of a step at which"):
        pairs_of(one, two)[0][0].differences


@pytest.mark.parametrize("beside", [False, True])
def test_the_page_shows_the_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str], beside: bool) -> None:
    runs = [write_solved(tmp_path, "one", False), write_solved(tmp_path, "two", True, change_Pa=1200.0)]
    runs += [synthetic.write_run(tmp_path, synthetic.Synthetic(number=2), "case2")] * beside
    assert main([*map(str, runs), "--out", str(tmp_path / "plots"), "--dpi", "60"]) == 0
    told = capsys.readouterr().out
    assert "(i, pressure) The pressure changes by less than 1 kPa: not reproduced" in told
    page = (tmp_path / "plots" / "page.html").read_text()
    assert 'src="coupling.png"' in page and "two-way less one-way" in page and "1.2 kPa" in page
    assert (tmp_path / "plots" / "coupling.png").stat().st_size > 10_000
    assert ("Onset of slip on the faster interface" in page) == beside == (tmp_path / "plots" / "table.csv").exists()
    assert len(pd.read_csv(tmp_path / "plots" / "claims.csv").query("claim.str.startswith('i')")) == 3
