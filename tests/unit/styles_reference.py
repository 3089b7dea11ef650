"""The contact bond's law written once more, in Python and from its definition, to check the compiled one against.

Sources: Potyondy & Cundall (2004) for the bond, Cundall & Strack (1979) for the frictional contact; the hash is splitmix64.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

MASK = (1 << 64) - 1


def mix_bits(word: int) -> int:
    word = (word + 0x9E3779B97F4A7C15) & MASK
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & MASK
    return word ^ (word >> 31)


def pair_normal(id_i: int, id_j: int, seed: int) -> float:
    """Standard normal number of a pair of grains."""
    low, high = sorted((id_i, id_j))
    key = mix_bits(mix_bits(mix_bits(seed) ^ low) ^ high)
    u1 = ((mix_bits(key) >> 11) + 0.5) / 2**53
    u2 = ((mix_bits(key ^ 0xD1B54A32D192ED03) >> 11) + 0.5) / 2**53
    return math.sqrt(-2 * math.log(u1)) * math.cos(2 * math.pi * u2)


def strength(id_i: int, id_j: int, mean: float, deviation: float, floor: float, seed: int) -> float:
    """Bond strength, Pa."""
    return max(floor, mean + deviation * pair_normal(id_i, id_j, seed))


@dataclass
class Body:
    """One grain at the moment of a force evaluation. x, v, omega: (3,) float64."""

    number: int
    x: np.ndarray
    v: np.ndarray
    omega: np.ndarray
    radius: float
    mass: float


@dataclass
class BondedPair:
    """History of one contact: shear displacement (3,), and the bond's state, limits (N) and stress-free overlap (m)."""

    kn: float
    kt: float
    gamman: float
    gammat: float
    friction: float
    shear: np.ndarray = field(default_factory=lambda: np.zeros(3))
    state: str = "never bonded"
    tension_limit: float = 0.0
    shear_limit: float = 0.0
    offset: float = 0.0
    touched: set[str] = field(default_factory=set)  # branches of the law that were met

    def bond(self, overlap: float, stress: float, shear_ratio: float, radius: float) -> None:
        self.state, self.offset = "bonded", min(overlap, 0.0)
        self.tension_limit = stress * math.pi * radius**2
        self.shear_limit = shear_ratio * self.tension_limit

    def step(self, i: Body, j: Body, dt: float, bond_with: tuple[float, float, float] | None):
        """Advance by one step. bond_with: (stress Pa, shear ratio, gap m) while bonding is armed.

        Returns force on i (3,), torque on i and on j (3,) and None or the break: (mode, point (3,), F_n, F_s, energy).
        """
        separation = i.x - j.x
        distance = float(np.sqrt(separation @ separation))
        n = separation / distance
        overlap = i.radius + j.radius - distance
        arm_i, arm_j = i.radius - overlap / 2, j.radius - overlap / 2
        at_contact = i.v - j.v - np.cross(i.omega, arm_i * n) - np.cross(j.omega, arm_j * n)
        normal_velocity = float(at_contact @ n)
        tangent_velocity = at_contact - normal_velocity * n
        mass = i.mass * j.mass / (i.mass + j.mass)
        zero = np.zeros(3)

        if bond_with is not None and self.state == "never bonded" and (overlap > 0 or -overlap <= bond_with[2]):
            if overlap <= 0:
                self.touched.add("bonded across a gap")
            self.bond(overlap, bond_with[0], bond_with[1], min(i.radius, j.radius))
        if overlap <= 0 and self.state != "bonded":
            self.shear[:] = 0
            return zero, zero, zero, None

        self.shear += tangent_velocity * dt
        self.shear -= (self.shear @ n) * n
        spring_shear = self.kt * float(np.linalg.norm(self.shear))
        total_unbonded = self.kn * overlap - self.gamman * mass * normal_velocity
        event = None
        if self.state == "bonded":
            normal = self.kn * (overlap - self.offset)
            broken = "tension" if -normal > self.tension_limit else "shear" if spring_shear > self.shear_limit else None
            if broken is None:
                self.touched.add("bonded in tension" if normal < 0 else "bonded in compression")
                if overlap > 0 and spring_shear > self.friction * abs(total_unbonded):
                    self.touched.add("bonded beyond friction")
                force = (normal - self.gamman * mass * normal_velocity) * n - self.kt * self.shear - self.gammat * mass * tangent_velocity
                return force, -arm_i * np.cross(n, force), -arm_j * np.cross(n, force), None
            self.state = f"broken in {broken}"
            kept_normal = max(self.kn * overlap, 0.0)
            kept_shear = min(spring_shear, self.friction * abs(total_unbonded)) if overlap > 0 else 0.0
            if broken == "shear":
                self.touched.add("shear break, " + ("shear lost" if overlap <= 0 else "shear kept" if kept_shear == spring_shear else "shear cut"))
            energy = (normal**2 - kept_normal**2) / (2 * self.kn) + (spring_shear**2 - kept_shear**2) / (2 * self.kt)
            event = (broken, i.x - arm_i * n, normal, spring_shear, energy)
        if overlap <= 0:
            self.shear[:] = 0
            return zero, zero, zero, event
        if self.state != "never bonded":
            self.touched.add("frictional after a break")
        limit = self.friction * abs(total_unbonded)
        if spring_shear > limit:
            self.touched.add("slip")
            self.shear *= limit / spring_shear
            tangential = -self.kt * self.shear
        else:
            self.touched.add("stick")
            tangential = -self.kt * self.shear - self.gammat * mass * tangent_velocity
        force = total_unbonded * n + tangential
        return force, -arm_i * np.cross(n, force), -arm_j * np.cross(n, force), event
