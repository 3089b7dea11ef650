"""The stability map: every scene ends as it may, and what crashes, hangs or is wrong without a word is seen."""

from __future__ import annotations

import csv
import dataclasses
import signal
import sys
from pathlib import Path

import pytest
from processes import the_message

from coupling.stability.grain_scenes import loaded
from coupling.stability.small_cases import SAMPLE
from coupling.stability.program_run import in_time, judged, run
from coupling.stability.scene import FAILED, STABLE, Outcome, bisected, limit
from coupling.stability.table import Line, page


def lines_of(out: Path) -> dict[str, dict[str, str]]:
    with open(out / "stability.csv", newline="") as file:
        return {row["scene"]: row for row in csv.DictReader(file)}


def assert_as_it_may(done, out: Path) -> dict[str, dict[str, str]]:
    assert done.returncode == 0, done.stdout + done.stderr
    lines = lines_of(out)
    assert {line["as_it_may"] for line in lines.values()} == {"True"}
    assert FAILED not in {line["ended"] for line in lines.values()}
    assert f"{len(lines)} scenes" in (out / "stability.md").read_text()
    assert str(out) not in (out / "stability.md").read_text() + (out / "stability.csv").read_text(), "paths of the machine"
    return lines


def test_some_scenes(poreslip, stage_cache, tmp_path):
    done = poreslip("stability", "--quick", "--out", tmp_path / "map", env={"PORESLIP_CACHE": str(stage_cache)}, timeout=400)
    lines = assert_as_it_may(done, tmp_path / "map")
    assert len(lines) > 15 and {line["ended"] for line in lines.values()} == {"stable", "refused", "stopped"}
    # Between what the formula holds for safe and what it may lose by that.
    step = lines["grains/limit/1.2"]
    assert float(step["limit_predicted"]) < float(step["limit_found"]) < 1.25 * float(step["limit_predicted"])


@pytest.mark.parallel
def test_several_ranks_come_to_the_same_verdicts(poreslip, stage_cache, tmp_path):
    """A network in the scene's own process, a run that is refused and one that is stopped; what looks at whole matrices stays on one rank."""
    names = ("flow/lattice/sc", "grains/step/1.2/0.9", "grains/step_of_deck/1.2", "flow/explicit/1")
    verdicts = {}
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        only = [part for name in names for part in ("--only", name)]
        done = poreslip("stability", *only, "--ranks", str(ranks), "--out", out, env={"PORESLIP_CACHE": str(stage_cache)}, timeout=400)
        verdicts[ranks] = assert_as_it_may(done, out)
    assert {name: line["ended"] for name, line in verdicts[1].items()} == {name: line["ended"] for name, line in verdicts[2].items()}
    assert [verdicts[2][name]["ranks"] for name in names] == ["2", "2", "2", "1"]
    assert "3 of them on 2 ranks" in (tmp_path / "2" / "stability.md").read_text()


@pytest.mark.slow
def test_all_scenes(poreslip, stage_cache, tmp_path):
    done = poreslip("stability", "--out", tmp_path / "map", env={"PORESLIP_CACHE": str(stage_cache)}, timeout=3600)
    assert len(assert_as_it_may(done, tmp_path / "map")) > 90


def test_arguments(poreslip):
    for pattern in ("flow/lattice/*", "flow/lattice", "*/lattice/"):
        listed = poreslip("stability", "--list", "--only", pattern)
        assert listed.returncode == 0 and [line.split()[0] for line in listed.stdout.splitlines()] == [f"flow/lattice/{k}" for k in ("sc", "bcc", "fcc", "fcc_shaken")]
    assert "no scene has such a name" in the_message(poreslip("stability", "--only", "grians/*"), 2)
    assert "no whole number above 0" in the_message(poreslip("stability", "--jobs", "0"), 2)


def test_crashes_and_hangs_are_seen():
    assert in_time([sys.executable, "-c", "import os; os.kill(os.getpid(), 11)"], 30.0)[0] == -signal.SIGSEGV
    status, said = in_time([sys.executable, "-c", "import time; time.sleep(60)"], 0.5)
    assert status is None and "0.5 s" in said


def test_a_wrong_answer_without_a_word_is_a_failure(tmp_path, stage_cache, monkeypatch):
    """A run that ends well by its status, and bears a tenth less than what its scene looks for."""
    monkeypatch.setenv("PORESLIP_CACHE", str(stage_cache))
    ran = run(tmp_path / "scene", SAMPLE, 'sample.walls={ z_top = "fixed" }', "sample.loading_time_s=2e-5")
    assert ran.status == 0
    outcome = judged(ran, loaded)
    assert outcome.ended == FAILED and "ended without a word" in outcome.figure
    assert judged(dataclasses.replace(ran, status=-11), loaded).figure.startswith("signal 11")
    assert judged(dataclasses.replace(ran, status=None), loaded).figure.startswith("hung")
    assert judged(dataclasses.replace(ran, status=3, said="Traceback (most recent call last)"), loaded).ended == FAILED
    assert "Not as they may end: a/b" in page([Line("a/b", "a scene", (STABLE,), outcome, 1.0)])


def test_bisection_and_limits():
    assert bisected(lambda x: x < 1.234, 0.5, 2.0) == pytest.approx(1.234, rel=0.01)
    assert bisected(lambda x: False, 0.5, 2.0) == 0.5 and bisected(lambda x: True, 0.5, 2.0) == 2.0
    assert limit(1.1, 1.0, "s", "", 0.2).ended == STABLE
    # Unsafe, and needlessly short.
    assert limit(0.9, 1.0, "s", "", 0.2).ended == limit(1.3, 1.0, "s", "", 0.2).ended == FAILED
    assert limit(1.1, 1.0, "s", "words", 0.2) == Outcome(STABLE, "words", 1.1, 1.0, "s")
