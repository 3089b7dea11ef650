"""Which sources count as the code that made a run, and what their revision is called."""

from __future__ import annotations

import subprocess

import pytest

from coupling import __version__
from coupling.study.revision import revision


@pytest.fixture
def tree(tmp_path):
    for name in ("coupling/loading.py", "coupling/study/plan.py", "coupling/stability/scene.py", "flowsolver/flow/solve.cpp", "postproc/page.py",
                 "liggghts-inputs/styles/laws/bond.h", "liggghts-inputs/in.load", "coupling/notes.md"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    return tmp_path


def of(tree):
    revision.cache_clear()
    return revision(tree)


@pytest.mark.parametrize("name", ["coupling/loading.py", "flowsolver/flow/solve.cpp", "liggghts-inputs/styles/laws/bond.h"])
def test_sources_decide(tree, name):
    before = of(tree)
    (tree / name).write_text("2")
    assert of(tree).digest != before.digest


@pytest.mark.parametrize("name", ["coupling/study/plan.py", "coupling/stability/scene.py", "postproc/page.py", "liggghts-inputs/in.load", "coupling/notes.md"])
def test_what_starts_runs_or_reads_them_does_not(tree, name):
    before = of(tree)
    (tree / name).write_text("2")
    assert of(tree) == before


def test_names(tree):
    without = of(tree)
    assert without.name == f"{__version__}, sources {without.digest[:10]}"
    for arguments in (["init", "-q"], ["add", "."], ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "sources"]):
        subprocess.run(["git", "-C", str(tree), *arguments], check=True)
    commit = subprocess.run(["git", "-C", str(tree), "rev-parse", "--short=10", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    assert (of(tree).name, of(tree).digest) == (commit, without.digest)
    (tree / "coupling/study/plan.py").write_text("2")
    assert of(tree).name == commit
    (tree / "coupling/loading.py").write_text("2")
    assert of(tree).name == f"{commit}+{of(tree).digest[:10]}"
