"""The benchmark's pack: a dense random pack of size ratio 1.2 at porosity 0.40, of any size, the same on any number of ranks.

1000 grains in a periodic cell are pushed apart until none overlaps by more than 1e-3 of its diameter; the pack is a block of such
cells, within walls that the outermost grains just reach.
"""

from __future__ import annotations

import functools

import numpy as np

POROSITY, SIZE_RATIO, CELL_GRAINS = 0.40, 1.2, 1000
LARGEST_OVERLAP = 1e-3
BLOCKS = {8_000: (2, 2, 2), 100_000: (4, 5, 5), 1_000_000: (10, 10, 10)}
"""Cells along x, y, z by number of grains."""


@functools.cache
def cell(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Positions (1000, 3) and radii (1000,) in a periodic cell of edge 1."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(1.0, SIZE_RATIO, CELL_GRAINS)
    radius *= ((1 - POROSITY) / (4 / 3 * np.pi * (radius**3).sum())) ** (1 / 3)
    x = rng.random((CELL_GRAINS, 3))
    reach = 2.4 * radius.max()
    first, second = np.triu_indices(CELL_GRAINS, 1)
    for step in range(10_000):
        if step % 10 == 0:
            apart = x[first] - x[second]
            apart -= np.round(apart)
            near = np.flatnonzero((apart**2).sum(axis=1) < reach**2)
            i, j = first[near], second[near]
        apart = x[i] - x[j]
        apart -= np.round(apart)
        distance = np.linalg.norm(apart, axis=1)
        overlap = radius[i] + radius[j] - distance
        if step % 10 == 0 and overlap.max() < LARGEST_OVERLAP * 2 * radius.min():
            break
        push = np.where(overlap > 0, 0.4 * overlap / distance, 0.0)[:, None] * apart
        for axis in range(3):
            x[:, axis] += np.bincount(i, push[:, axis], CELL_GRAINS) - np.bincount(j, push[:, axis], CELL_GRAINS)
    else:
        raise RuntimeError(f"the cell of the pack did not come to rest: overlap {overlap.max():g} m")
    return np.mod(x, 1.0), radius


def pack(blocks: tuple[int, int, int], part: int = 0, parts: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One of `parts` slabs of the pack along x: ids (n,), positions (n, 3), radii (n,), upper corner (3,) of a box from 0."""
    x, radius = cell()
    margin = radius.max()
    shifts = np.array([(i, j, k) for i in np.array_split(np.arange(blocks[0]), parts)[part] for j in range(blocks[1]) for k in range(blocks[2])], int)
    shifts = shifts.reshape(-1, 3)
    number = (shifts[:, 0] * blocks[1] + shifts[:, 1]) * blocks[2] + shifts[:, 2]
    ids = (number[:, None] * CELL_GRAINS + np.arange(CELL_GRAINS)).ravel()
    position = (shifts[:, None, :] + x + margin).reshape(-1, 3)
    return ids, position, np.tile(radius, len(shifts)), np.array(blocks, float) + 2 * margin


if __name__ == "__main__":
    import argparse

    parser = argparse.ArgumentParser(description="The pack as text, x y z r, and its box, for other codes.")
    parser.add_argument("grains", type=int, choices=BLOCKS)
    parser.add_argument("file")
    arguments = parser.parse_args()
    _, places, radii, top = pack(BLOCKS[arguments.grains])
    np.savetxt(arguments.file, np.column_stack([places, radii]), fmt="%.17g", header="box 0 0 0 " + " ".join(repr(float(t)) for t in top))
