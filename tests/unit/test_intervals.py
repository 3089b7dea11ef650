"""Intervals between two solves that follow their error, without an engine: how long the next one is, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from sample_runs import SQUEEZE

from coupling.case.files import load_case
from coupling.case.run_case import RunCase
from coupling.fluid.following_intervals import GROWTH, SAFETY, FollowingIntervals
from coupling.fluid.interval_error import IntervalError


@pytest.fixture
def case(tmp_path):
    """`case(*overrides)`: of 800 steps, with a line of the history every 160."""
    (tmp_path / "case.toml").write_text(SQUEEZE)

    def load(*overrides: str) -> RunCase:
        given = ("flow.split=predicted", "flow.interval_tolerance=0.02", "flow.interval_steps=100", "output.history_interval_steps=160", "output.checkpoint_every_steps=0")
        return load_case(tmp_path / "case.toml", (*given, *overrides)).runs[0]

    return load


def lengths(intervals: FollowingIntervals, case: RunCase, error_of, step: int = 0) -> list[int]:
    """Of all intervals up to the end of loading, if one of n steps errs by error_of(n)."""
    made = []
    while step < case.loading_steps:
        assert intervals.begins(step)
        intervals.begin(step)
        end = intervals.end_after(step)
        assert not any(intervals.begins(inside) or intervals.ends(inside) for inside in range(step + 1, end)) and intervals.ends(end)
        made.append(end - step)
        intervals.learn(error_of(end - step))
        step = end
    return made


@pytest.mark.parametrize(("split", "order"), [("predicted", 2), ("undrained", 1)])
def test_lengths_come_to_the_tolerance(case, split, order):
    """An error of 0.02 at 40 steps that grows with its order: as long as what the tolerance, with its margin, allows."""
    given = case(f"flow.split={split}")
    made = lengths(FollowingIntervals(given), given, lambda n: 0.02 * (n / 40.0) ** order)
    aim = SAFETY * 40.0
    assert made[0] == 12  # an eighth of the longest, shared out evenly over 160 steps
    assert all(later <= np.ceil(GROWTH * former) for former, later in zip(made, made[1:]))
    # The rest up to a line of the history is shared out evenly.
    assert all(0.6 * aim < n <= aim for n in made[4:-2])


def test_intervals_end_where_lines_of_the_history_are_due(case):
    given = case()
    ends = np.cumsum(lengths(FollowingIntervals(given), given, lambda n: 1e-9))
    assert set(range(160, given.loading_steps, 160)) <= set(ends) and ends[-1] == given.loading_steps
    # Those that no error holds back: two of 80, where one of 100 and one of 60 would do.
    assert list(np.diff(ends)[-5:-2]) == [80, 80, 80]


def test_a_large_error_shortens_at_once(case):
    given = case()
    intervals = FollowingIntervals(given)
    made = lengths(intervals, given, lambda n: 1e3 if n > 1 else 1e-5)
    assert made[:2] == [12, 1] and max(made) <= 12
    assert intervals.lengths == {"shortest_interval_steps": 1, "longest_interval_steps": max(made)}


def test_goes_on_from_its_state(case):
    given = case()
    one, other = FollowingIntervals(given), FollowingIntervals(given)
    made = lengths(one, given, lambda n: 0.02 * (n / 30.0) ** 2)
    half, step = FollowingIntervals(given), 0
    while step < 320:
        half.begin(step)
        end = half.end_after(step)
        half.learn(0.02 * ((end - step) / 30.0) ** 2)
        step = end
    other.resume(half.state())
    assert lengths(other, given, lambda n: 0.02 * (n / 30.0) ** 2, step) == made[-len([e for e in np.cumsum(made) if e > 320]):]
    assert other.lengths == one.lengths


def test_the_error_is_a_part_of_what_pressures_change_by():
    """Two pores of volumes 1 and 3; a third one's void is below 0."""
    error, volume = IntervalError(MPI.COMM_SELF, expected=0.0), np.array([1.0, 3.0])
    error.begin(np.array([5.0, 5.0]), volume)
    assert error.last == 0.0 and error.figures == {"worst": 0.0, "final": 0.0, "pressure_change_Pa": 0.0}
    error.take(np.array([5.0, 9.0]), np.array([0.0, -2.0]), volume)
    assert error.last == pytest.approx(0.5)
    error.take(np.array([5.0, 6.0]), np.array([0.0, 1.0]), volume)
    again = IntervalError(MPI.COMM_SELF, expected=0.0)
    again.resume(error.state())
    expected = {"worst": 0.5, "final": 0.25, "pressure_change_Pa": 4.0 * np.sqrt(0.75)}
    assert error.figures == again.figures == pytest.approx(expected)
    wider = IntervalError(MPI.COMM_SELF, expected=10.0)
    wider.begin(np.array([5.0, 5.0]), volume)
    wider.take(np.array([5.0, 9.0]), np.array([0.0, -2.0]), volume)
    assert wider.last == pytest.approx(2.0 * np.sqrt(0.75) / 10.0)
    wider.take(np.array([5.0, 9.0, 9.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 3.0, -1e-3]))
    assert 0.0 < wider.last < 1e-2
