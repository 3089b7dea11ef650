"""The longest stable time step of a pack, from its contacts: what the steps that are found to be stable are compared with.

With displacements q of all grains (rotations too), stiffness K and damping C of the contacts as they are, and masses M, the engine's
velocity Verlet, whose damping forces are those of the velocities half a step back, makes M (q+ - 2 q + q-) / dt^2 = -K q - C (q - q-) / dt.
Its fastest mode goes unstable by changing sign at every step, q+ = -q: where the largest eigenvalue of M^-1 (dt^2 K + 2 dt C) reaches 4.
Sliding contacts have no shear stiffness; bonds, and all other contacts, have. For one rank.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from flowsolver.lanczos import largest_eigenvalue
from numpy.typing import NDArray

from coupling.engine.interface import Engine

#: Of the shear limit from which a contact counts as sliding.
SLIDING = 0.999

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contacts:
    """Contacts of a pack at rest, as the spectrum needs them.

    first, second: (M,) indices of the grains; second is -1 for a wall. normal: (M, 3) from the first to the second.
    normal_stiffness, shear_stiffness: (M,) N/m, the latter 0 where a contact slides. normal_damping: (M,) N s/m.
    mass, radius: (n,) kg, m.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    normal: Array
    normal_stiffness: Array
    shear_stiffness: Array
    normal_damping: Array
    mass: Array
    radius: Array

    @property
    def coordination(self) -> float:
        """Mean number of contacts of a grain with others."""
        return 2.0 * float((self.second >= 0).sum()) / len(self.mass)


def contacts_of(engine: Engine, walls: dict[str, tuple[int, int]], kn: float, ks: float, gamma: float, friction: float) -> Contacts:
    """Contacts of an engine's grains. walls: axis and inward direction (1, -1) by fix id. gamma: 1/s, F = -gamma m_eff v."""
    found = engine.contacts()
    x, radius, mass, ids = (engine.atom(name).copy() for name in ("x", "radius", "rmass", "id"))
    place = np.full(int(ids.max()) + 1, -1)
    place[ids] = np.arange(len(ids))
    first, second = place[found.id[:, 0]], place[found.id[:, 1]]
    apart = x[second] - x[first]
    normal = apart / np.linalg.norm(apart, axis=1)[:, None]
    slides = ~found.bonded & (np.linalg.norm(found.shear_force, axis=1) >= SLIDING * friction * np.maximum(found.normal_force, 0.0))
    damping = gamma * mass[first] * mass[second] / (mass[first] + mass[second])
    rows = [(first, second, normal, np.where(slides, 0.0, ks), damping)]
    for name, (axis, inward) in walls.items():
        touching = np.flatnonzero(radius - inward * (x[:, axis] - engine.wall(name).position) > 0.0)
        towards = np.zeros((len(touching), 3))
        towards[:, axis] = -inward
        # The walls are smooth, and without dashpots in the decks.
        rows.append((touching, np.full(len(touching), -1), towards, np.zeros(len(touching)), np.zeros(len(touching))))
    first, second, normal, shear, damping = (np.concatenate(column) for column in zip(*rows))
    return Contacts(first, second, normal, np.full(len(first), kn), shear, damping, mass, radius)


def stable_time_step(contacts: Contacts) -> float:
    """The longest stable time step, s."""
    start = np.random.default_rng(1).normal(size=(len(contacts.mass), 6))
    stiffness = largest_eigenvalue(lambda q: _forces(contacts, q, contacts.normal_stiffness, contacts.shear_stiffness), start)
    longest = 2.0 / math.sqrt(stiffness)
    if not contacts.normal_damping.any():
        return longest
    shortest = 0.0
    while longest - shortest > 1e-4 * longest:
        dt = 0.5 * (shortest + longest)
        normal = dt**2 * contacts.normal_stiffness + 2.0 * dt * contacts.normal_damping
        value = largest_eigenvalue(lambda q: _forces(contacts, q, normal, dt**2 * contacts.shear_stiffness), start)
        shortest, longest = (dt, longest) if value < 4.0 else (shortest, dt)
    return shortest


def _forces(c: Contacts, q: Array, normal_stiffness: Array, shear_stiffness: Array) -> Array:
    """M^-1/2 K M^-1/2 q for displacements and rotations q = M^1/2 (u, theta), (n, 6)."""
    n = len(c.mass)
    weight = np.repeat(np.sqrt(np.column_stack([c.mass, 0.4 * c.mass * c.radius**2])), 3, axis=1)
    # A wall stands still: a grain more, that does not move.
    moved = np.vstack([q / weight, np.zeros(6)])
    radius = np.append(c.radius, 0.0)
    u, turn = moved[:, :3], moved[:, 3:] * radius[:, None]
    apart = u[c.second] - u[c.first]
    along = (apart * c.normal).sum(axis=1)[:, None] * c.normal
    slip = apart - along - np.cross(turn[c.first] + turn[c.second], c.normal)
    shear = shear_stiffness[:, None] * slip
    force = normal_stiffness[:, None] * along + shear
    moment = np.cross(c.normal, shear)
    result = np.zeros((n + 1, 6))
    for column in range(3):
        result[:, column] = np.bincount(c.second % (n + 1), force[:, column], n + 1) - np.bincount(c.first, force[:, column], n + 1)
        turned = np.bincount(c.first, moment[:, column], n + 1) + np.bincount(c.second % (n + 1), moment[:, column], n + 1)
        result[:, 3 + column] = -turned * radius
    return result[:n] / weight
