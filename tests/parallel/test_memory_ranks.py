"""Ranks: 2. A thousand meshes and solves take no more memory than three hundred, with walls and with periods."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.mark.parallel
def test_a_thousand_meshes_and_solves_take_no_more_memory(mpirun):
    done = mpirun(2, [Path(__file__).with_name("memory_ranks_case.py")])
    assert done.returncode == 0, done.stderr
    growth = [[int(word) for word in line.partition(")")[2].split()] for line in done.stdout.splitlines()]
    assert len(growth) == 2 and all(len(ranks) == 2 for ranks in growth)
    assert max(map(max, growth)) < 2048, growth  # kB
