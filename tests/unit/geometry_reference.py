"""A second, plain implementation of equations (4)-(5), to check the native one against; and small packs to check on."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
UNIT_BOX = np.array([[0.0, 1.0, 0.0, 1.0, 0.0, 1.0]])


def cap(radius: float, distance: float) -> float:
    """Volume of a sphere's cap beyond a plane at this distance from its centre."""
    if distance >= radius:
        return 0.0
    return np.pi * (radius - distance) ** 2 * (2 * radius + distance) / 3


def lens(ra: float, rb: float, length: float) -> float:
    """Volume common to two spheres."""
    if length >= ra + rb:
        return 0.0
    if length <= abs(ra - rb):
        return 4 / 3 * np.pi * min(ra, rb) ** 3
    da = (length**2 + ra**2 - rb**2) / (2 * length)
    return cap(ra, da) + cap(rb, length - da)


class Cell:
    """One cell: its vertices are rows of the arrays, or -1 to -6 for a wall."""

    def __init__(self, vertices: NDArray, planes: NDArray, group: NDArray) -> None:
        self.grains = [int(v) for v in vertices if v >= 0]
        self.walls = [-1 - int(v) for v in vertices if v < 0]
        self.planes, self.group = planes, group

    def gap(self, x: NDArray, grain: int, wall: int) -> float:
        sign = 1.0 if wall % 2 else -1.0
        return sign * (self.planes[self.group[grain], wall] - x[grain, wall // 2])

    def directions(self, x: NDArray, grain: int) -> list[NDArray]:
        return [x[o] - x[grain] for o in self.grains if o != grain] + [NORMALS[w] for w in self.walls]

    def volume(self, x: NDArray) -> float:
        g, w = self.grains, self.walls
        if not w:
            return abs(np.linalg.det(x[g[1:]] - x[g[0]])) / 6
        if len(w) == 1:
            a, b = x[g[1]] - x[g[0]], x[g[2]] - x[g[0]]
            return abs(np.cross(a, b) @ NORMALS[w[0]]) / 2 * np.mean([self.gap(x, k, w[0]) for k in g])
        if len(w) == 2:
            length = abs((x[g[1]] - x[g[0]]) @ np.cross(NORMALS[w[0]], NORMALS[w[1]]))
            (a1, a2), (b1, b2) = ([self.gap(x, k, q) for q in w] for k in g)
            return length * ((a1 * a2 + b1 * b2) / 3 + (a1 * b2 + a2 * b1) / 6)
        return float(np.prod([self.gap(x, g[0], q) for q in w]))

    def solid_angle(self, x: NDArray, grain: int) -> float:
        a, b, c = (d / np.linalg.norm(d) for d in self.directions(x, grain))
        return 2 * np.arctan2(abs(a @ np.cross(b, c)), 1 + a @ b + b @ c + c @ a)

    def edges(self, x: NDArray) -> list[tuple[int, NDArray, list[NDArray]]]:
        """Each edge that starts at a grain: (key, its direction, the directions to the two other vertices)."""
        found = []
        vertices = self.grains + [-1 - w for w in self.walls]
        for p, q in combinations(vertices, 2):
            if p < 0:
                continue
            to = lambda v: NORMALS[-1 - v] if v < 0 else x[v] - x[p]  # noqa: E731
            found.append(((p, q), to(q), [to(o) for o in vertices if o not in (p, q)]))
        return found

    def dihedral(self, edge: NDArray, others: list[NDArray]) -> float:
        e = edge / np.linalg.norm(edge)
        s, t = (d - (d @ e) * e for d in others)
        return float(np.arctan2(np.linalg.norm(np.cross(s, t)), s @ t))

    def lenses(self, x: NDArray, radius: NDArray) -> dict:
        out = {}
        for (p, q), edge, _ in self.edges(x):
            out[p, q] = cap(radius[p], self.gap(x, p, -1 - q)) if q < 0 else lens(radius[p], radius[q], np.linalg.norm(edge))
        return out

    def pore_volume(self, x: NDArray, radius: NDArray, frozen: dict | None = None) -> float:
        """(4)-(5). `frozen`: lens volumes to take in place of the present ones."""
        lenses = self.lenses(x, radius) if frozen is None else frozen
        solid = sum(self.solid_angle(x, g) * radius[g] ** 3 / 3 for g in self.grains)
        common = sum(self.dihedral(edge, others) / (2 * np.pi) * lenses[key] for key, edge, others in self.edges(x))
        return self.volume(x) - solid + common


def random_pack(count: int, radius: tuple[float, float], seed: int) -> tuple[NDArray, NDArray]:
    """Grains in the unit box that touch neither each other nor a wall: random sequential addition."""
    rng = np.random.default_rng(seed)
    x, r = np.empty((0, 3)), np.empty(0)
    for _ in range(200_000):
        new_r = rng.uniform(*radius)
        new_x = rng.uniform(1.01 * new_r, 1 - 1.01 * new_r, 3)
        if np.all(np.linalg.norm(x - new_x, axis=1) > 1.01 * (r + new_r)):
            x, r = np.vstack([x, new_x]), np.append(r, new_r)
            if len(r) == count:
                return x, r
    raise RuntimeError(f"no room for {count} grains")


def beads() -> tuple[NDArray, NDArray]:
    """Small grains with their centres inside large ones: some look out, some do not."""
    x, r = random_pack(60, (0.08, 0.12), seed=9)
    rng = np.random.default_rng(2)
    way = rng.normal(size=(60, 3))
    way *= (r * rng.uniform(0.55, 0.95, 60) / np.linalg.norm(way, axis=1))[:, None]
    return np.vstack([x, x + way]), np.append(r, 0.4 * r)


def gradient(function, x: NDArray, grain: int) -> NDArray:
    """Gradient with respect to one grain's position: central differences, extrapolated once."""
    out = np.empty(3)
    for axis in range(3):
        def central(h: float) -> float:
            step = np.zeros_like(x)
            step[grain, axis] = h
            return (function(x + step) - function(x - step)) / (2 * h)

        out[axis] = (4 * central(5e-5) - central(1e-4)) / 3
    return out
