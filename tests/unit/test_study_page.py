"""The page and the figure of a study, for every kind of parameter that it may have, and where there is little to show."""

from __future__ import annotations

import math

import matplotlib.image
import numpy as np
import pytest

from postproc.error_time import Cost, Row, gathered, recommended_for_each
from postproc.study_page import choices, page, table, verdict
from postproc.work_precision import draw, number


def row(options: dict, error: float, cpu_s: float = 1.0, spread: dict | None = None, stable: bool = True, reference: bool = False) -> Row:
    return Row(options, spread or {}, math.nan, error, Cost(cpu_s, cpu_s, 5, 0), stable, "" if stable else "it broke | down", "abc", reference)


STUDIES = {
    "numbers": ([row({"interval": n, "split": s}, 1e-3 * n, 1 / n) for s in "ab" for n in (1, 10, 100)], []),
    "names": ([row({"law": name}, error) for name, error in (("duct", 0.6), ("radius", 0.2), ("none", math.nan))], []),
    "packs": ([row({"size": size}, 1 / size / seed, size, {"seed": seed}) for size in (10, 20) for seed in (1, 2)], []),
    "over packs": ([row({"law": law}, 0.1 * seed, 1.0, {"seed": seed}) for seed in (1, 2) for law in "ab"], []),
    "given": ([row({"dt": dt, "scheme": s}, error) for dt in (1e-9, 1e-3) for s, error in (("implicit", 0.1 * dt), ("steady", 1e-3))], ["dt"]),
    "broken": ([row({"interval": 1}, 0.0, reference=True), row({"interval": 2}, math.nan, stable=False)], []),
    "exact": ([row({"interval": 1}, 0.0), row({"interval": 2}, 0.0)], []),
}


@pytest.mark.parametrize("name", STUDIES)
def test_any_study_can_be_shown(name, tmp_path):
    rows, given = STUDIES[name]
    points = gathered(rows)
    best = recommended_for_each(points, given, 0.05)
    keys = dict.fromkeys([*rows[0].spread, *rows[0].options] if name == "over packs" else [*rows[0].options, *rows[0].spread])
    picture = draw(points, best, given, 0.05, "A title", "error", {key: key for key in keys}, tmp_path, "figure", dpi=60)
    image = matplotlib.image.imread(tmp_path / picture.name)
    # Something is drawn in it: ink besides the paper.
    assert image.shape[1] == 420 and 0.01 < np.mean(image[..., :3].min(axis=2) < 0.9) < 0.5
    text = page("A title", "About it.", "poreslip study a.toml", points, best, given, 0.05, "error", picture.name)
    assert text.count("\n|") == len(points) + 2 + sum(line.startswith("|") for line in choices(points, given)) and "About it." in text


def test_what_is_recommended_is_said():
    points = gathered(STUDIES["numbers"][0])
    assert verdict(points, recommended_for_each(points, [], 0.05), 0.05) == [
        "**Recommended, the cheapest within 0.05:** interval = 10, split = a (error 0.01, 0.1 CPU s)."]  # fmt: skip
    assert "No setting is within 1e-09; the nearest is interval = 1" in verdict(points, [], 1e-9)[0]
    given, key = STUDIES["given"]
    points = gathered(given)
    said = verdict(points, recommended_for_each(points, key, 0.05), 0.05)
    assert said[2:] == ["- dt = 1e-09, scheme = implicit (error 1e-10, 1 CPU s)", "- dt = 0.001, scheme = implicit (error 0.0001, 1 CPU s)"]
    broken = gathered(STUDIES["broken"][0])
    assert verdict(broken, [], 0.05) == ["No setting has an error to judge by, so none is recommended for 0.05."]
    assert "no: it broke / down" in table(broken, "error")[3] and "the reference" in table(broken, "error")[2]


def test_what_to_choose_for_a_wanted_error():
    """The Pareto front, the most exact first; by what is given."""
    assert choices(gathered(STUDIES["numbers"][0]), []) == [
        "To choose:", "", "| for an error of | take | CPU s |", "|---|---|---|",
        "| 0.001 | interval = 1, split = a | 1 |", "| 0.01 | interval = 10, split = a | 0.1 |", "| 0.1 | interval = 100, split = a | 0.01 |", "",
    ]  # fmt: skip
    given, key = STUDIES["given"]
    found = choices(gathered(given), key)
    assert [line for line in found if line.startswith("To choose")] == ["To choose, dt = 1e-09:", "To choose, dt = 0.001:"]
    assert found[4] == "| 1e-10 | scheme = implicit | 1 |"
    assert choices(gathered(STUDIES["broken"][0]), []) == []


def test_labels_that_are_numbers():
    assert (number("0.37"), number(5), number("duct"), number(True), number([1])) == (0.37, 5.0, None, None, None)
