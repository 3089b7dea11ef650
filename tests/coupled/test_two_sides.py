"""The quick version of the paper's scene, from the case file to the claims: minutes, so marked slow."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest
from processes import REPOSITORY, Completed


@pytest.mark.slow
def test_the_quick_version_shows_the_side_of_slip_and_the_order_of_onsets(
    poreslip: Callable[..., Completed], stage_cache: Path, tmp_path: Path
) -> None:
    done = poreslip("run", REPOSITORY / "cases" / "two_sides" / "quick.toml", "--out", tmp_path, timeout=3000.0, env={"PORESLIP_CACHE": str(stage_cache)})
    assert done.returncode == 0, done.stderr
    done = poreslip("plot", tmp_path / "quick", timeout=600.0)
    assert done.returncode == 0, done.stderr

    with open(tmp_path / "quick" / "plots" / "claims.csv", newline="") as file:
        verdicts = {row["claim"]: row["verdict"] for row in csv.DictReader(file)}
    assert verdicts["a"] == "reproduced"

    with open(tmp_path / "quick" / "plots" / "table.csv", newline="") as file:
        onset = {row["case"]: float(row["onset_strain"] or "inf") for row in csv.DictReader(file)}
    assert onset["1"] < onset["4"] < onset["5"]
    assert onset["1"] < min(onset["2"], onset["3"]) and max(onset["2"], onset["3"]) < onset["4"]
