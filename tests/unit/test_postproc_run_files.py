"""Files of runs: read when whole, readable when the last line is torn, refused with one message when they are not usable."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import synthetic_run as synthetic  # noqa: E402
from postproc.command_line import main  # noqa: E402
from postproc.errors import ForeignFile, MissingFile, TruncatedFile  # noqa: E402
from postproc.run_files import read_contacts, read_grains, read_run  # noqa: E402
from postproc.samples import COLUMNS  # noqa: E402
from postproc.run_sets import find_runs, sort_runs  # noqa: E402


def test_a_sample_without_a_line_is_refused(tmp_path, capsys):
    (tmp_path / "case.json").write_text('{"scene": "sample"}')
    (tmp_path / "history.csv").write_text(",".join(COLUMNS) + "\n")
    assert main([str(tmp_path)]) == 2
    assert "no line of the run was written" in capsys.readouterr().err


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    return synthetic.write_run(tmp_path, synthetic.Synthetic(samples=40, bonds_broken=5))


def test_a_whole_run_has_no_warnings(directory: Path) -> None:
    run = read_run(directory)
    assert len(run.history) == 40 and len(run.bonds) == 5 and run.report and not run.warnings


@pytest.mark.parametrize("cut", [1, 5, 30, 120])
def test_a_torn_last_line_is_left_out_with_a_warning(directory: Path, cut: int) -> None:
    path = directory / "history.csv"
    path.write_bytes(path.read_bytes()[:-cut])
    run = read_run(directory)
    assert len(run.history) == 39
    assert len(run.warnings) == 1 and "torn" in run.warnings[0] and str(path) in run.warnings[0]


def test_a_torn_line_that_ends_within_a_number_is_not_taken_for_whole(directory: Path) -> None:
    path = directory / "history.csv"
    lines = path.read_text().splitlines()
    lines[-1] = lines[-1].rsplit(",", 1)[0] + ",1"  # all fields are there, but no line end: the number may be cut
    path.write_text("\n".join(lines))
    assert len(read_run(directory).history) == 39


def test_a_torn_bond_list_stays_readable(directory: Path) -> None:
    path = directory / "bonds.csv"
    path.write_bytes(path.read_bytes()[:-10])
    assert len(read_run(directory).bonds) == 4


def replace_cell(path: Path, line: int, column: str, value: str) -> None:
    rows = [row.split(",") for row in path.read_text().splitlines()]
    rows[line][rows[0].index(column)] = value
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")


def drop_column(path: Path, column: str) -> None:
    rows = [row.split(",") for row in path.read_text().splitlines()]
    index = rows[0].index(column)
    path.write_text("\n".join(",".join(row[:index] + row[index + 1:]) for row in rows) + "\n")


def edit_case(directory: Path, section: str, key: str, value: object) -> None:
    content = json.loads((directory / "case.json").read_text())
    content[section][key] = value
    (directory / "case.json").write_text(json.dumps(content))


DAMAGE = {
    "no history": (lambda d: (d / "history.csv").unlink(), MissingFile, "history.csv"),
    "no case": (lambda d: (d / "case.json").unlink(), MissingFile, "case.json"),
    "empty history": (lambda d: (d / "history.csv").write_text(""), TruncatedFile, "header"),
    "torn header": (lambda d: (d / "history.csv").write_text("step,time_s,str"), TruncatedFile, "header"),
    "two samples": (lambda d: (d / "history.csv").write_text("\n".join((d / "history.csv").read_text().splitlines()[:3]) + "\n"),
                    TruncatedFile, "2 whole samples"),
    "missing column": (lambda d: drop_column(d / "history.csv", "slip_left_m"), ForeignFile, "slip_left_m"),
    "foreign history": (lambda d: (d / "history.csv").write_text("x,y\n1,2\n3,4\n5,6\n"), ForeignFile, "more"),
    "binary history": (lambda d: (d / "history.csv").write_bytes(bytes(range(128, 256)) * 9), ForeignFile, "text"),
    "word for a number": (lambda d: replace_cell(d / "history.csv", 7, "sigma_n_Pa", "high"), ForeignFile, "line 8: sigma_n_Pa is 'high'"),
    "not a number": (lambda d: replace_cell(d / "history.csv", 7, "slip_right_m", "nan"), ForeignFile, "line 8: slip_right_m"),
    "infinite": (lambda d: replace_cell(d / "history.csv", 9, "sigma_n_Pa", "inf"), ForeignFile, "line 10: sigma_n_Pa"),
    "time goes back": (lambda d: replace_cell(d / "history.csv", 12, "time_s", "0.0"), ForeignFile, "line 13: time_s does not grow"),
    "short line inside": (lambda d: (d / "history.csv").write_text((d / "history.csv").read_text().replace("\n300,", "\n3\n300,", 1)),
                          ForeignFile, "1 fields"),
    "torn case": (lambda d: (d / "case.json").write_text((d / "case.json").read_text()[:90]), TruncatedFile, "JSON"),
    "case is a list": (lambda d: (d / "case.json").write_text("[1, 2]"), ForeignFile, "list"),
    "no diameter": (lambda d: edit_case(d, "pack", "diameter_m", None), ForeignFile, "pack.diameter_m"),
    "negative diameter": (lambda d: edit_case(d, "pack", "diameter_m", [-1.0, 2.0]), ForeignFile, "2 positive numbers"),
    "no pressures": (lambda d: edit_case(d, "pressure", "left_target_Pa", None), ForeignFile, "left_target_Pa"),
    "name and pressures disagree": (lambda d: edit_case(d, "pressure", "left_target_Pa", 0.0), ForeignFile, "are those of case 3"),
    "foreign bonds": (lambda d: (d / "bonds.csv").write_text("a,b\n1,2\n"), ForeignFile, "bonds.csv"),
    "torn report": (lambda d: (d / "report.json").write_text('{"a": '), TruncatedFile, "report.json"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_file_gives_one_message_and_exit_status_2(directory: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    damage, kind, words = DAMAGE[name]
    damage(directory)
    with pytest.raises(kind, match=None) as caught:
        sort_runs(find_runs([directory])[0])
    assert words in str(caught.value) and str(directory) in str(caught.value)
    assert main([str(directory)]) == 2
    message = capsys.readouterr().err
    assert message.startswith("poreslip plot: ") and message.count("\n") == 1 and words in message
    assert not (directory / "plots").exists()


@pytest.mark.parametrize("arguments, words", [
    (["/no/such/directory"], "no such directory"), ([], "DIR"), (["--dpi", "9", "."], "50 to 1200"), (["--colour", "."], "--colour"),
])
def test_bad_command_lines(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


def test_a_directory_that_holds_no_run_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 2
    assert "neither history.csv (a run) nor runs.json (a case)" in capsys.readouterr().err


def test_a_pack_that_is_not_there(directory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(directory), "--pack", "7"]) == 2
    assert "the seeds are 1" in capsys.readouterr().err


def test_runs_of_a_case_that_have_not_started_are_passed_over(tmp_path: Path) -> None:
    case = synthetic.write_case(tmp_path / "case", numbers=(1, 2), samples=30)
    (case / "runs.json").write_text(json.dumps({"case": "case", "runs": ["case1-seed1", "case4-seed1"]}))
    runs, passed_over = find_runs([case])
    assert [run.name for run in runs] == ["case1-seed1", "case2-seed1"]  # case 2 is of an earlier command
    assert len(passed_over) == 1 and "case4-seed1" in passed_over[0]


def test_a_run_given_twice_is_read_once_but_two_runs_of_one_kind_are_refused(tmp_path: Path) -> None:
    first = synthetic.write_run(tmp_path, synthetic.Synthetic(samples=30))
    assert len(find_runs([first, first])[0]) == 1
    second = synthetic.write_run(tmp_path, synthetic.Synthetic(samples=30), name="case1-again")
    with pytest.raises(ForeignFile, match="same case, pack and parameters"):
        sort_runs(find_runs([first, second])[0])


def test_runs_are_sorted_into_variants_packs_and_cases(tmp_path: Path) -> None:
    directories = [synthetic.write_case(tmp_path / "a", seeds=(2, 10), samples=30),
                   synthetic.write_case(tmp_path / "b", numbers=(1, 2), samples=30, parameter=0.3)]
    variants = sort_runs(find_runs(directories)[0])
    assert [variant.label for variant in variants] == ["material.friction = 0.5", "material.friction = 0.3"]
    assert [pack.seed for pack in variants[0].packs] == ["2", "10"]
    assert list(variants[0].packs[0].runs) == [1, 2, 3, 4, 5] and list(variants[1].packs[0].runs) == [1, 2]


def test_one_dry_run_serves_variants_that_differ_in_the_fluid(tmp_path: Path) -> None:
    directories = [synthetic.write_case(tmp_path / "a", samples=30), synthetic.write_case(tmp_path / "b", numbers=(1, 2), samples=30, forces="pressure")]
    variants = sort_runs(find_runs(directories)[0])
    assert [list(variant.packs[0].runs) for variant in variants] == [[1, 2, 3, 4, 5], [1, 2, 5]]
    assert variants[1].label == "flow.forces = pressure"


def test_case_number_without_a_telling_name(tmp_path: Path) -> None:
    for number in (1, 4):
        directory = synthetic.write_run(tmp_path, synthetic.Synthetic(number=number, samples=30), name=f"r{number}")
        content = json.loads((directory / "case.json").read_text())
        (directory / "case.json").write_text(json.dumps(content | {"group": f"r{number}"}))
    variants = sort_runs(find_runs([tmp_path / "r4", tmp_path / "r1"])[0])
    assert {number: run.name for number, run in variants[0].packs[0].runs.items()} == {1: "r1", 4: "r4"}


def test_snapshots_are_read_and_damage_in_them_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = synthetic.write_run(tmp_path, synthetic.Synthetic(samples=30, grains=200))
    run = read_run(directory)
    grains, contacts = read_grains(run, -1), read_contacts(run, -1)
    assert grains.position.shape == grains.displacement.shape == (len(grains.radius), 3) and set(grains.part) == {1, 2, 3}
    assert contacts.ends.shape == (len(contacts.force_normal), 2, 3) and contacts.of_gouge.any() and contacts.bonded.any()
    path = directory / "snapshots" / "grains_3000.vtu"
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(TruncatedFile, match="grains_3000.vtu"):
        read_grains(run, -1)
    assert main([str(directory)]) == 2
    path.unlink()
    with pytest.raises(MissingFile, match="grains_3000.vtu"):
        read_grains(run, -1)
    assert main([str(directory), "--no-snapshots", "--dpi", "50"]) == 0


def test_postprocessing_stands_alone() -> None:
    command = "import postproc.command_line, sys; print(sorted({name.split('.')[0] for name in sys.modules} & {'coupling', 'flowsolver', 'mpi4py'}))"
    shown = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert shown.stdout.strip() == "[]"
