"""Error against run time: the Pareto front, the setting to recommend, settings spread over packs, the table."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

from postproc.error_time import Cost, Row, error_of, gathered, order_of, pareto_front, recommended, write_table
from postproc.observables import NotObserved, Observed


def row(name: str, error: float, cpu_s: float, *, seed: int = 0, stable: bool = True, reference: bool = False, value: float = 1.0) -> Row:
    return Row({"setting": name}, {"seed": seed} if seed else {}, value, error, Cost(cpu_s, 2 * cpu_s, 10, 3), stable, "" if stable else "it broke", "abc", reference)


ROWS = [
    row("quick", 0.5, 1.0), row("dominated", 0.6, 1.5), row("good", 0.01, 2.0), row("slow", 0.02, 5.0), row("best", 0.001, 9.0),
    row("broken", math.nan, 0.1, stable=False), row("reference", 0.0, 0.05, reference=True), row("no onset", math.nan, 0.2),
]  # fmt: skip


def names(points) -> list[str]:
    return [point.options["setting"] for point in points]


def test_the_front_holds_what_nothing_else_beats():
    assert names(pareto_front(gathered(ROWS))) == ["quick", "good", "best"]


def test_equal_costs_and_errors():
    same = [row("a", 0.1, 1.0), row("b", 0.05, 1.0), row("c", 0.05, 2.0)]
    assert names(pareto_front(gathered(same))) == ["b"]
    assert pareto_front([]) == []


@pytest.mark.parametrize(("tolerance", "expected"), [(1.0, "quick"), (0.5, "quick"), (0.1, "good"), (0.0099, "best"), (1e-9, None)])
def test_the_cheapest_within_the_tolerance(tolerance, expected):
    found = recommended(gathered(ROWS), tolerance)
    assert (found.options["setting"] if found else None) == expected


def test_packs_count_together_with_the_worst_error_and_the_mean_cost():
    rows = [row("a", 0.01, 1.0, seed=1, value=4.0), row("b", 0.02, 1.0, seed=1), row("a", 0.05, 3.0, seed=2, value=6.0), row("b", math.nan, 1.0, seed=2, stable=False)]
    a, b = gathered(rows)
    assert (a.error, a.smallest_error, a.cpu_s, a.wall_s) == (0.05, 0.01, 2.0, 4.0)
    assert a.value == pytest.approx((5.0, math.sqrt(2.0)))
    assert a.counts and not b.stable and not b.counts and math.isnan(b.error)
    assert recommended([a, b], 0.03) is None


def test_one_pack_without_an_error_leaves_none():
    (point,) = gathered([row("a", 0.01, 1.0, seed=1), row("a", math.nan, 1.0, seed=2)])
    assert math.isnan(point.error) and not point.counts


def test_error_of_numbers_and_curves():
    assert error_of(Observed.number(1.1), Observed.number(1.0), relative=True) == pytest.approx(0.1)
    assert error_of(Observed.number(-3.0), Observed.number(-2.0), relative=False) == pytest.approx(1.0)
    fine = np.linspace(0.0, 1.0, 101)
    line, parabola = Observed(2 * fine, fine), Observed(np.array([0.0, 1.0, 2.0, 9.0]), np.array([0.0, 0.5, 1.0, 1.5]))
    # What lies past the end of the reference does not count.
    assert error_of(parabola, line, relative=True) == pytest.approx(0.0, abs=1e-12)
    # Nor what lies before its beginning.
    late = Observed(2 * fine[50:], fine[50:])
    assert error_of(Observed(np.array([7.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0])), late, relative=True) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("observed", "expected", "message"), [
    (Observed(np.zeros(3)), Observed(np.ones(2)), "3 values cannot be held against 2"),
    (Observed(np.zeros(3), np.arange(3.0)), Observed.number(1.0), "3 values cannot be held against 1"),
    (Observed.number(1.0), Observed.number(0.0), "the reference is 0, so no error is relative to it; set relative = false"),
    (Observed(np.ones(2), np.array([0.0, 1.0])), Observed(np.ones(2), np.array([2.0, 3.0])), "the reference goes from 2 to 3, and no point from 0 to 1 lies within"),
    # numpy would read a falling abscissa off as if it grew.
    (Observed(np.ones(2), np.array([0.0, 1.0])), Observed(np.arange(3.0), np.array([1.0, 0.5, 0.0])), "abscissa does not grow"),
])  # fmt: skip
def test_what_has_no_error(observed, expected, message):
    with pytest.raises(NotObserved, match=message):
        error_of(observed, expected, relative=True)


def test_order_of_convergence():
    size = np.array([0.1, 0.05, 0.025])
    assert order_of(size, 3.0 * size**2) == pytest.approx(2.0)


def test_the_table_has_a_line_for_each_row(tmp_path):
    write_table(ROWS, tmp_path / "t.csv")
    with open(tmp_path / "t.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["setting"] for line in lines] == [one.options["setting"] for one in ROWS]
    assert (lines[0]["error"], lines[0]["cpu_s"], lines[0]["wall_s"], lines[0]["steps"], lines[0]["iterations"], lines[0]["stable"]) == ("0.5", "1", "2", "10", "3", "yes")
    assert (lines[5]["error"], lines[5]["stable"], lines[5]["reason"]) == ("", "no", "it broke")
    assert lines[6]["reason"] == "the reference"
    assert {line["revision"] for line in lines} == {"abc"}
