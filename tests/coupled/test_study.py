"""`poreslip study` on real runs: its table, figure and page, runs that are kept, runs that fail, and an interrupt in the middle."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from processes import REPOSITORY, environment, the_message

from coupling.study.revision import revision

#: Rates of the tiny fault; the last is so fast that loading has too few steps, and is refused.
RATES = """\
title = "Loading rate of the tiny fault"
about = "What is read from it."
tolerance = 0.05

[run]
case = "tiny.toml"
only = "dry"

[[parameter]]
key = "loading.strain_rate_per_s"
values = [10.0, 20.0, 1e4]
label = "strain rate, 1/s"

[observable]
name = "history"
column = "sigma_n_Pa"
over = "strain"

[reference]
settings = { "loading.strain_rate_per_s" = 5.0 }
"""
FLOW = """\
tolerance = 1e-6

[run]
poreflow = "pack.txt --box 0 1 0 1 0 1 --face ymin=1 --face ymax=0 --viscosity 10"

[[parameter]]
key = "--tolerance"
values = [1e-3, 1e-9]

[[parameter]]
key = "--conductance"
values = ["duct", "of-pipes"]

[observable]
name = "permeability"

[reference]
settings = { "--tolerance" = 1e-12, "--conductance" = "duct" }
"""


@pytest.fixture
def study(poreslip, tiny_case, tmp_path, stage_cache):
    """`study(text, *arguments)`: carry out a study; what it printed, and the directory of its results."""

    def run(text: str, *arguments: str):
        path = tmp_path / "study.toml"
        path.write_text(text)
        return poreslip("study", path, "--out", tmp_path / "out", *arguments, env={"PORESLIP_CACHE": str(stage_cache)}), tmp_path / "out" / "study"

    run.directory = tmp_path
    return run


def lines(directory) -> list[dict[str, str]]:
    with open(directory / "error_time.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_rates_of_a_fault(study, tmp_path):
    done, results = study(RATES)
    assert done.returncode == 0, done.stderr
    reference, *rows = lines(results)
    assert reference["reason"] == "the reference" and float(reference["steps"]) == 396
    assert [row["stable"] for row in rows] == ["yes", "yes", "no"]
    assert "too few to follow the grains" in rows[2]["reason"] and rows[2]["error"] == ""
    assert 0.0 < float(rows[0]["error"]) < float(rows[1]["error"])
    assert 0.0 < float(rows[0]["cpu_s"]) < 60.0 and float(rows[0]["steps"]) == 198
    # One line for each run, the reference's first.
    told = [line for line in done.stdout.splitlines() if " CPU s" in line and line.startswith("study  ") and "/" in line.split()[1]]
    assert len(told) == 4 and "the reference" in told[0] and "error" in told[1]
    assert (results / "error_time.png").read_bytes()[:4] == b"\x89PNG"
    page = (results / "study.md").read_text()
    assert "What is read from it." in page and "too few to follow the grains" in page
    # The error is that of the curves themselves.
    curves = [np.genfromtxt(path, delimiter=",", names=True) for path in (tmp_path / "out" / "runs").glob("*/tiny/dry/history.csv")]
    assert len(curves) == 3
    fine = max(curves, key=lambda curve: curve["step"][-1])
    middle = sorted(curves, key=lambda curve: curve["step"][-1])[1]
    wanted = np.interp(middle["strain"], fine["strain"], fine["sigma_n_Pa"])[middle["strain"] <= fine["strain"].max()]
    value = middle["sigma_n_Pa"][: len(wanted)]
    expected = np.sqrt(((value - wanted) ** 2).mean() / (wanted**2).mean())
    assert float(rows[0]["error"]) == pytest.approx(expected, rel=1e-5)

    assert {row["revision"] for row in lines(results)} == {revision().name} and f"Carried out by revision {revision()}." in page
    assert str(tmp_path) not in (results / "error_time.csv").read_text()

    # Again: nothing is repeated. Another value: only that.
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").glob("*/finished.json")}
    again, _ = study(RATES.replace("[10.0, 20.0, 1e4]", "[5.0, 10.0, 20.0, 40.0]"))
    assert again.returncode == 0, again.stderr
    # One of the settings is the reference, and is not told twice.
    assert [line.split()[1] for line in again.stdout.splitlines() if " CPU s" in line and "/" in line.split()[1]] == ["1/4", "2/4", "3/4", "4/4"]
    after = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").glob("*/finished.json")}
    assert len(after) == 4 and made.items() <= after.items()
    assert lines(results)[1] == rows[0]


def test_runs_of_another_revision_are_made_again_or_told_of(study, tmp_path):
    text = RATES.replace("[10.0, 20.0, 1e4]", "[20.0]")
    _, results = study(text)
    records = {path: json.loads(path.read_text()) for path in (tmp_path / "out" / "runs").glob("*/finished.json")}
    (path,) = (path for path in records if len(list(csv.reader(open(path.with_name("tiny") / "dry" / "history.csv")))) < 10)
    path.write_text(json.dumps(records[path] | {"sources": "0" * 64, "revision": "older"}))
    planned, _ = study(text, "--dry-run")
    assert planned.stdout.count("to be run again: made by revision older") == planned.stdout.count("kept from before") == 1
    kept, _ = study(text, "--keep")
    assert "1 of 2 runs from before are of revision older and are taken as they are" in kept.stdout
    assert [row["revision"] for row in lines(results)] == [revision().name, "older"]
    assert "Carried out by 2 revisions" in (results / "study.md").read_text()
    again, _ = study(text)
    assert f"1 of 2 runs from before are of revision older and are made again by {revision()}" in again.stdout
    assert [row["revision"] for row in lines(results)] == [revision().name] * 2
    assert "older" not in (results / "study.md").read_text() and "sources" in json.loads(path.read_text())


def test_a_plan_runs_nothing(study, tmp_path):
    done, results = study(RATES, "--dry-run")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("to be run") == 3 and done.stdout.count("refused: ") == 1
    assert not (tmp_path / "out").exists()


def test_flow_through_a_pack(study, tmp_path):
    np.savetxt(tmp_path / "pack.txt", np.load(REPOSITORY / "tests" / "data" / "peer_pack_1000.npz")["spheres"], fmt="%.17g")
    done, results = study(FLOW)
    assert done.returncode == 0, done.stderr
    reference, loose, _, tight, refused = lines(results)
    assert float(loose["error"]) > 1e-6 > float(tight["error"])
    assert int(loose["iterations"]) < int(tight["iterations"]) < int(reference["iterations"])
    assert refused["stable"] == "no" and "invalid choice: 'of-pipes'" in refused["reason"]
    assert "Recommended, the cheapest within 1e-06: --tolerance = 1e-09, --conductance = duct" in done.stdout
    wrong, _ = study(FLOW.replace('"--tolerance"', '"--tolerence"'))
    assert "did you mean --tolerance" in the_message(wrong, 2)


def test_a_number_of_a_report_against_a_file(study, tmp_path):
    """And the steps of a command that has them beside its parameters."""
    np.savetxt(tmp_path / "pack.txt", np.load(REPOSITORY / "tests" / "data" / "peer_pack_1000.npz")["spheres"], fmt="%.17g")
    text = FLOW.replace("--viscosity 10", "--viscosity 10 --dt 1e-3 --steps 2").replace('name = "permeability"', 'name = "report"\nkey = "outflow.ymax"')
    text = text.replace('settings = { "--tolerance" = 1e-12, "--conductance" = "duct" }', 'file = "wanted.csv"')
    (tmp_path / "wanted.csv").write_text("note,value\nby hand,2.0\n")
    done, results = study(text)
    assert done.returncode == 0, done.stderr
    row = lines(results)[0]
    assert float(row["error"]) == pytest.approx(1 - float(row["value"]) / 2, rel=1e-5) and row["steps"] == "2"
    for content, message in (("flow\n2.0\n", "has no column value; its columns: flow"), ("value\n1\n2\n", "has 2 lines below its names: the observable report is one number")):
        (tmp_path / "wanted.csv").write_text(content)
        assert message in the_message(study(text)[0], 2)


def test_a_reference_that_fails_ends_the_study(study):
    done, _ = study(RATES.replace("= 5.0", "= 1e5"))
    assert "the reference" in the_message(done, 3)


def test_a_reference_without_the_observable_ends_the_study(study):
    """Before its other runs, all of which would lack it as well."""
    text = RATES.replace('name = "history"\ncolumn = "sigma_n_Pa"\nover = "strain"', 'name = "report"\nkey = "last.sigma_Pa"')
    message = the_message(study(text)[0], 2)
    assert "does not show what [observable] asks for: the report has no last.sigma_Pa" in message


@pytest.mark.parametrize("arguments", [[], ["--dry-run"]])
def test_a_column_that_no_run_writes_ends_the_study_before_its_runs(study, arguments):
    text = RATES.replace('column = "sigma_n_Pa"', 'column = "sigma_Pa"').replace('over = "strain"', "").replace('settings = { "loading.strain_rate_per_s" = 5.0 }', "value = 1.0")
    done, results = study(text, *arguments)
    message = the_message(done, 2)
    assert 'column = "sigma_Pa" in [observable]' in message and "columns: step, " in message and "kinetic_energy_J" in message
    assert not results.parent.exists()


def test_lists_of_numbers_are_values_like_others(study):
    """Sizes of grains, as far apart as the box allows, against a file."""
    text = RATES.replace('key = "loading.strain_rate_per_s"\nvalues = [10.0, 20.0, 1e4]', 'key = "pack.diameter_m"\nvalues = [[1.8e-3, 2.2e-3], [1.0, 2.0]]')
    text = text.replace('settings = { "loading.strain_rate_per_s" = 5.0 }', 'file = "wanted.csv"')
    (study.directory / "wanted.csv").write_text("strain,sigma_n_Pa\n0,1e7\n2e-4,1.5e7\n")
    done, results = study(text)
    assert done.returncode == 0, done.stderr
    fits, refused = lines(results)
    assert fits["pack.diameter_m"] == "[0.0018, 0.0022]" and float(fits["error"]) > 0.0
    assert "each side must hold three of the largest grains" in refused["reason"] and (results / "error_time.png").is_file()


@pytest.mark.parametrize(("content", "message"), [
    ("", "cannot be read as a table"), ("strain,sigma_n_Pa\n", "line 2: its column sigma_n_Pa holds no finite number"),
    ("strain,sigma_n_Pa\n0,1e7\n1e-4,\n", "line 3: its column sigma_n_Pa holds no finite number"), ("strain,sigma_n_Pa\n0,much\n", "line 2: its column"),
    ("strain,sigma\n0,1e7\n", "has no column sigma_n_Pa; its columns: strain, sigma"), ("strain,sigma_n_Pa\n1e-4,1e7\n0,2e7\n", "strain does not grow throughout"),
])  # fmt: skip
def test_a_reference_file_that_is_none_ends_the_study_before_its_runs(study, content, message):
    (study.directory / "wanted.csv").write_text(content)
    done, results = study(RATES.replace('settings = { "loading.strain_rate_per_s" = 5.0 }', 'file = "wanted.csv"'))
    assert message in the_message(done, 2)
    assert not (results.parent / "runs").exists()


def test_a_study_without_any_error_to_tell_has_failed(study):
    text = RATES.replace('name = "history"\ncolumn = "sigma_n_Pa"\nover = "strain"', 'name = "report"\nkey = "sigma_Pa"').replace('settings = { "loading.strain_rate_per_s" = 5.0 }', "value = 1.0")
    done, results = study(text)
    assert done.returncode == 3 and "No setting has an error to judge by" in done.stdout
    assert (results / "study.md").is_file()


def test_not_under_mpirun(tiny_case, mpirun, tmp_path):
    (tmp_path / "study.toml").write_text(RATES)
    done = mpirun(2, ["-m", "coupling", "study", tmp_path / "study.toml", "--out", tmp_path / "out"])
    assert "without mpirun" in the_message(done, 2)


@pytest.fixture
def begun(tiny_case, tmp_path, stage_cache):
    """`begun(text)`: start a study in the background; its process once its second run writes."""

    def start(text: str) -> subprocess.Popen:
        (tmp_path / "study.toml").write_text(text)
        command = [sys.executable, "-m", "coupling", "study", tmp_path / "study.toml", "--out", tmp_path / "out"]
        process = subprocess.Popen([str(part) for part in command], env=environment(PORESLIP_CACHE=str(stage_cache)), stdout=subprocess.PIPE, text=True,
                                   start_new_session=True)  # fmt: skip
        assert "the reference" in process.stdout.readline()
        end = time.monotonic() + 60.0
        while not list((tmp_path / "out" / "runs").glob("*/tiny/dry/history.csv"))[1:]:
            assert time.monotonic() < end
            time.sleep(0.05)
        return process

    return start


def running(part: str) -> list[str]:
    """Processes with this in their command lines."""
    return [pid for pid in os.listdir("/proc") if pid.isdigit() and part.encode() in _command_line(pid)]


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow), signal.SIGKILL])
def test_an_interrupt_and_the_rest_later(study, begun, tmp_path, number):
    """Stopped in the second run: the first is kept, nothing of the second counts, no process is left, and the same command ends it."""
    text = RATES.replace("[10.0, 20.0, 1e4]", "[0.02]")  # 99 000 steps
    process = begun(text)
    process.send_signal(number)
    rest = process.communicate(timeout=60)[0]
    assert len(list((tmp_path / "out" / "runs").glob("*/finished.json"))) == 1
    if number == signal.SIGKILL:
        end = time.monotonic() + 30.0
        while running(str(tmp_path)) and time.monotonic() < end:
            time.sleep(0.05)
    else:
        assert process.returncode == 130 and "the same command goes on" in rest
        assert [row["reason"] for row in lines(tmp_path / "out" / "study")] == ["the reference"]
    assert not running(str(tmp_path))
    done, results = study(text.replace("[0.02]", "[10.0]"))
    assert done.returncode == 0, done.stderr
    assert len(lines(results)) == 2


def test_two_studies_at_once_share_their_runs(study, begun, tmp_path):
    """The second waits for what the first carries out, and takes it."""
    text = RATES.replace("[10.0, 20.0, 1e4]", "[0.3]")  # 6 600 steps
    first = begun(text)
    done, results = study(text)
    assert done.returncode == 0, done.stderr
    said = first.communicate(timeout=120)[0]
    assert first.returncode == 0 and "refused" not in said + done.stdout, said
    assert [row["stable"] for row in lines(results)] == ["yes", "yes"] and len(list((tmp_path / "out" / "runs").glob("*/finished.json"))) == 2
    # To the last digit that they tell, CPU seconds included.
    assert [line for line in said.splitlines() if "2/2" in line] == [line for line in done.stdout.splitlines() if "2/2" in line]


def _command_line(pid: str) -> bytes:
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            return file.read()
    except OSError:
        return b""


@pytest.mark.slow
def test_a_run_that_takes_too_long_gets_more_time_when_asked(study, tmp_path):
    text = RATES.replace("[10.0, 20.0, 1e4]", "[0.02]").replace("tolerance", "limit_s = 6.0\ntolerance")  # 99 000 steps
    done, results = study(text)
    assert done.returncode == 3 and "No setting has an error to judge by" in done.stdout, done.stderr
    (row,) = lines(results)[1:]
    assert row["stable"] == "no" and row["reason"] == "took longer than 6 s"
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").glob("*/finished.json")}
    study(text)
    assert made == {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").glob("*/finished.json")}
    study(text.replace("6.0", "7.0"))
    assert lines(results)[1]["reason"] == "took longer than 7 s"
