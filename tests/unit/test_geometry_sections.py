"""Throats one by one, (6), against the plain formulas: sectors and circular segments by arc cosines, centroids of cells."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from geometry_reference import NORMALS, beads, random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork


def half_chord(radius: float, distance: float) -> float:
    return np.sqrt(max(radius**2 - distance**2, 0.0))


def section(x: np.ndarray, radius: np.ndarray, vertices: np.ndarray) -> tuple[float, float, float]:
    """Area of a facet in the unit box, its open area and that one's perimeter; pairs of overlaps are counted each for itself."""
    grains, walls = [v for v in vertices if v >= 0], [-1 - v for v in vertices if v < 0]
    to = {g: [x[o] - x[g] for o in grains if o != g] + [NORMALS[w] for w in walls] for g in grains}
    gap = {(g, w): NORMALS[w].sum() * ((1.0 if w % 2 else 0.0) - x[g, w // 2]) for g in grains for w in walls}
    if len(grains) == 3:
        area = np.linalg.norm(np.cross(*to[grains[0]])) / 2
    elif len(grains) == 2:
        edge, normal = to[grains[0]]
        area = np.linalg.norm(np.cross(edge, normal)) * sum(gap.values()) / 2
    else:
        area = np.prod(list(gap.values()))
    angle = {g: np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)) for g, (a, b) in to.items()}
    open_area, arcs = area, dict(angle)
    perimeter = 0.0

    def cut(grain: int, distance: float) -> None:
        """A chord at this distance takes an arc off the grain's sector, and gives back half its segment."""
        nonlocal open_area
        half_arc = np.arccos(np.clip(distance / radius[grain], -1, 1))
        arcs[grain] -= half_arc
        open_area += (radius[grain] ** 2 * half_arc - distance * half_chord(radius[grain], distance)) / 2

    for p, q in combinations(grains, 2):
        length = np.linalg.norm(x[p] - x[q])
        from_p = (length**2 + radius[p] ** 2 - radius[q] ** 2) / (2 * length)
        if length < radius[p] + radius[q]:
            cut(p, from_p)
            cut(q, length - from_p)
        perimeter += max(length - radius[p] - radius[q], 0.0)
    for (g, w), distance in gap.items():
        cut(g, distance)
        perimeter += max(distance - radius[g], 0.0)
    # Along a wall, between the feet of the grains or up to the next wall.
    for w in walls:
        line = np.linalg.norm(np.cross(*to[grains[0]])) if len(grains) == 2 else gap[grains[0], next(v for v in walls if v != w)]
        perimeter += max(line - sum(half_chord(radius[g], gap[g, w]) for g in grains), 0.0)
    open_area -= sum(radius[g] ** 2 * angle[g] for g in grains) / 2
    return area, open_area, perimeter + sum(radius[g] * arcs[g] for g in grains)


def pressed() -> tuple[np.ndarray, np.ndarray]:
    x, r = random_pack(200, (0.04, 0.09), seed=8)
    return x, 1.06 * r


@pytest.mark.parametrize("pack", [pressed, beads])
def test_each_throat_against_the_reference(pack):
    x, r = pack()
    network = PoreNetwork(MPI.COMM_SELF, (0, 0, 0), (1, 1, 1))
    network.update(np.arange(len(r)), x, r)
    sections, grains = network.throat_sections(), network.grains_of_throat
    area, open_area, perimeter = np.array([section(x, r, vertices) for vertices in grains]).T
    walls = (grains < 0).sum(axis=1)
    overlapping = np.array([any(np.linalg.norm(x[p] - x[q]) < r[p] + r[q] for p, q in combinations(v[v >= 0], 2)) for v in grains])
    assert np.all(np.bincount(walls) > 10) and np.all(np.bincount(walls[overlapping]) > 10)
    np.testing.assert_allclose(sections["facet_area"], area, rtol=1e-10)
    # At the least overlaps the chord is a root of what rounding leaves.
    np.testing.assert_allclose(sections["open_area"], open_area, atol=1e-12)
    np.testing.assert_allclose(sections["perimeter"], perimeter, atol=1e-9)


@pytest.mark.parametrize("periodic", [(False, False, False), (True, True, False)])
def test_lengths_are_between_centroids(periodic):
    """With periods no cell has more than one wall, and those at it have none off their facets."""
    x, r = pressed()
    network = PoreNetwork(MPI.COMM_SELF, (0, 0, 0), (1, 1, 1), periodic)
    network.update(np.arange(len(r)), x, r)
    left, right = network.native.unwrapped_centre()[network.pores_of_throat].transpose(1, 0, 2)
    np.testing.assert_allclose(network.throat_sections()["length"], np.linalg.norm(right - left, axis=1), rtol=1e-9, atol=1e-15)
