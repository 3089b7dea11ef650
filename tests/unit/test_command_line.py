"""The command `poreslip`: what it accepts, and that an error is one message and the same exit status on every number of ranks."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from coupling import __version__
from coupling.case.files import load_case, select_runs
from coupling.command_line import main
from coupling.errors import ComputationError
from coupling.plan import plan

CASE = 'scene = "two_sides"\npressure.left_target_Pa = 1e7\n[[run]]\nname = "case1"\n[[run]]\nname = "case2"\n'


@pytest.fixture
def case(tmp_path: Path) -> Path:
    path = tmp_path / "fault.toml"
    path.write_text(CASE)
    return path


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """A driver that only notes what it was asked for."""
    asked: list[tuple] = []
    module = ModuleType("coupling.driver")
    module.run_case_file = lambda case_file, options: asked.append((case_file, options))
    monkeypatch.setitem(sys.modules, "coupling.driver", module)
    return asked


def test_what_run_hands_to_the_driver(case: Path, driver: list[tuple], tmp_path: Path) -> None:
    out = tmp_path / "results"
    arguments = ["run", str(case), "--set", "pack.seed=4", "--set", "pack.porosity=0.4", "--only", "case2", "--out", str(out), "--dry-run", "--checkpoint-every", "200"]
    assert main(arguments) == 0
    ((case_file, options),) = driver
    assert [run.name for run in case_file.runs] == ["case2"]
    assert (case_file.runs[0].pack.seed, case_file.runs[0].pack.porosity) == (4, 0.4)
    assert case_file.runs[0].output.checkpoint_every_steps == 200
    assert (options.output_root, options.dry_run, options.restart) == (out, True, None)


def test_a_plan_counts_its_runs(case: Path) -> None:
    case_file = load_case(case)
    assert plan(case_file, 2).startswith(f"fault: {len(case_file.runs)} runs on 2 ranks\n")
    assert plan(select_runs(case_file, ["case2"]), 1).startswith("fault: 1 run on 1 rank\n")


def test_results_go_to_out_by_default(case: Path, driver: list[tuple]) -> None:
    assert main(["run", str(case)]) == 0
    assert driver[0][1].output_root == Path("out")


def test_a_restart_takes_its_case_from_the_results(case: Path, driver: list[tuple], tmp_path: Path) -> None:
    run = load_case(case, ["pack.seed=6"]).runs[1]
    directory = tmp_path / "results" / "fault" / "case2"
    directory.mkdir(parents=True)
    (directory / "case.json").write_text(json.dumps(run.to_dict()))
    assert main(["run", "--restart", str(directory)]) == 0
    assert main(["run", "--restart", str(directory), "--checkpoint-every", "200"]) == 0
    (first, options), (second, _) = driver
    assert first.runs == (run,)
    assert (first.stem, options.output_root, options.restart) == ("fault", tmp_path / "results", directory)
    assert second.runs[0].output.checkpoint_every_steps == 200


def test_help_and_version(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for arguments in (["--help"], ["run", "--help"], ["test", "--help"], ["info", "--help"]):
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code == 0
        assert "usage: poreslip" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"poreslip {__version__}\n"
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    with pytest.raises(SystemExit):
        main(["--help"])
    assert capsys.readouterr().out == ""


def bad_commands(case: Path) -> dict[str, tuple[list[str], str]]:
    """Arguments that are refused, and a part of the message."""
    here = case.parent
    (here / "foreign").mkdir()
    (here / "foreign" / "case.json").write_text("[1, 2]")
    (here / "truncated").mkdir()
    (here / "truncated" / "case.json").write_text('{"case": "fa')
    (here / "several" / "case1").mkdir(parents=True)
    (here / "several" / "case1" / "case.json").write_text("{}")
    return {
        "unknown command": (["rum"], "invalid choice: 'rum'"),
        "unknown option": (["run", str(case), "--dryrun"], "--dryrun"),
        "shortened option": (["run", str(case), "--dry"], "--dry"),
        "no case": (["run"], "a case file is missing"),
        "two cases": (["run", str(case), "other.toml"], "unrecognized arguments: other.toml"),
        "missing case": (["run", str(here / "falt.toml")], "did you mean"),
        "a directory": (["run", str(here)], "TOML files there: fault.toml"),
        "option without its value": (["run", str(case), "--out"], "expected one argument"),
        "bad override": (["run", str(case), "--set", "pack.seed"], "section.key=value"),
        "unknown run": (["run", str(case), "--only", "case3"], "Its runs: case1, case2"),
        "checkpoints at no number": (["run", str(case), "--checkpoint-every", "often"], "a whole number"),
        "checkpoints at a negative number": (["run", str(case), "--checkpoint-every", "-5"], "a whole number"),
        "results in a file": (["run", str(case), "--out", str(case)], "is a file"),
        "results below a file": (["run", str(case), "--out", str(case / "out")], "is a file"),
        "restart with a case": (["run", str(case), "--restart", str(here)], "CASE cannot be given with it"),
        "restart with another input": (["run", "--restart", str(here), "--set", "pack.seed=2"], "--set cannot be given with it"),
        "restart of nothing": (["run", "--restart", str(here / "absent")], "there is no case.json in it"),
        "restart of several runs": (["run", "--restart", str(here / "several")], "several/case1"),
        "restart of a truncated case": (["run", "--restart", str(here / "truncated")], "cannot be read"),
        "restart of something else": (["run", "--restart", str(here / "foreign")], "holds no table of inputs"),
        "restart of an empty case": (["run", "--restart", str(here / "several" / "case1")], "the key 'case' is missing"),
    }


def test_bad_commands_are_refused_with_one_message(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, (arguments, expected) in bad_commands(case).items():
        assert main(arguments) == 2, name
        captured = capsys.readouterr()
        assert captured.out == "", name
        assert captured.err.startswith("poreslip: ") and captured.err.count("\n") == 1, name
        assert expected in captured.err, name


def test_no_command_prints_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "poreslip run cases/two_sides/quick.toml" in capsys.readouterr().out


def test_results_where_nothing_may_be_written(case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # the tests may run as root, who may write anywhere
    assert main(["run", str(case), "--out", str(tmp_path / "sealed")]) == 2
    assert "no permission to write" in capsys.readouterr().err


def test_a_failed_computation_has_its_own_status(case: Path, driver: list[tuple], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(case_file: object, options: object) -> None:
        raise ComputationError("step 120: grain 7 left the box")

    monkeypatch.setattr(sys.modules["coupling.driver"], "run_case_file", fail)
    assert main(["run", str(case)]) == 3
    assert capsys.readouterr().err == "poreslip: step 120: grain 7 left the box\n"


def test_a_full_disk_is_told_without_a_traceback(case: Path, driver: list[tuple], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(case_file: object, options: object) -> None:
        raise OSError(28, "No space left on device", "out/fault/case1/history.csv")

    monkeypatch.setattr(sys.modules["coupling.driver"], "run_case_file", fail)
    assert main(["run", str(case)]) == 2
    message = capsys.readouterr().err
    assert "No space left on device: 'out/fault/case1/history.csv'" in message and message.count("\n") == 1


@pytest.mark.parallel
@pytest.mark.parametrize("arguments", [["run", "absent.toml"], ["rum"], ["run", "fault.toml", "--set", "pack.seed=0"]], ids=" ".join)
def test_bad_input_on_two_ranks(poreslip: Callable, case: Path, arguments: list[str]) -> None:
    ended = poreslip(*arguments, ranks=2, cwd=case.parent, timeout=60)
    assert ended.returncode == 2
    assert ended.stderr.count("poreslip: ") == 1


@pytest.mark.parallel
@pytest.mark.parametrize(("late", "message"), [(2.0, "poreslip: there is no case file absent.toml"), (20.0, "(rank 1 alone)")])
def test_the_message_comes_although_one_rank_is_late(mpirun: Callable, tmp_path: Path, late: float, message: str) -> None:
    """mpirun ends all ranks with the first that fails, so the others wait for rank 0, but not for ever."""
    script = tmp_path / "late.py"
    script.write_text(
        "import os, time\n"
        "from coupling.command_line import main\n"
        f"time.sleep({late} if os.environ['OMPI_COMM_WORLD_RANK'] == '0' else 0)\n"
        "raise SystemExit(main(['run', 'absent.toml']))\n"
    )
    ended = mpirun(2, [script], cwd=tmp_path, timeout=60)
    assert ended.returncode == 2
    assert ended.stderr.count("poreslip: ") == 1 and message in ended.stderr


FAILING = """
import sys
from mpi4py import MPI
from types import ModuleType
from coupling.command_line import main
from coupling.errors import ComputationError, InputError
module = ModuleType("coupling.driver")
def run_case_file(case_file, options):
    if {which}:
        raise {error}
    MPI.COMM_WORLD.Barrier()
module.run_case_file = run_case_file
sys.modules["coupling.driver"] = module
raise SystemExit(main(["run", "fault.toml"]))
"""


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("which", "error", "status", "message"),
    [
        ("True", 'ComputationError("the worst grain is 7")', 3, "poreslip: the worst grain is 7\n"),
        ("True", 'InputError("no such deck")', 2, "poreslip: no such deck\n"),
        ("MPI.COMM_WORLD.rank == 1", 'ComputationError("the worst grain is 7")', 3, "poreslip: the worst grain is 7 (rank 1 alone)\n"),
        ("MPI.COMM_WORLD.rank == 1", 'ValueError("a defect")', 1, "ValueError: a defect\n"),
    ],
    ids=["computation on both", "input on both", "computation on one", "defect on one"],
)
def test_an_error_of_the_driver_ends_two_ranks(mpirun: Callable, case: Path, which: str, error: str, status: int, message: str) -> None:
    script = case.parent / "failing.py"
    script.write_text(FAILING.format(which=which, error=error))
    ended = mpirun(2, [script], cwd=case.parent, timeout=60)
    assert ended.returncode == status
    assert ended.stderr.count(message) == 1


def test_what_info_tells(poreslip: Callable) -> None:
    ended = poreslip("info")
    assert ended.returncode == 0
    told = dict(line.split("  ", 1) for line in ended.stdout.splitlines() if not line.startswith(" "))
    assert told["poreslip"].strip().startswith(__version__)
    assert {"Python", "numpy", "mpi4py", "MPI library", "LIGGGHTS", "LAMMPS", "PETSc", "CGAL", "native build", "machine"} <= set(told)
    assert "Open MPI" in told["MPI library"]


def test_a_bad_case_is_refused_without_loading_mpi_or_numpy(case: Path, poreslip: Callable) -> None:
    """So that the message comes at once."""
    code = "import sys; from coupling.command_line import main; main(['run', 'fault.toml', '--set', 'pack.seed=0']); print({'numpy', 'mpi4py', 'numexpr'} & set(sys.modules))"
    from conftest import run_process

    ended = run_process([sys.executable, "-c", code], timeout=30, cwd=case.parent)
    assert ended.stdout == "set()\n"


def test_the_tests_are_not_run_under_mpirun(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "1")
    assert main(["test"]) == 2
    assert "without it" in capsys.readouterr().err
