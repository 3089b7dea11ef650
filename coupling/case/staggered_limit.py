"""The longest interval with which flow.split = "staggered" stays stable, known before a run is made.

Pressures that stand still between solves push grains away from where they were, not from where they are. A mass m on a skeleton of
stiffness k_s with a fluid of stiffness k_f that is late by T / 2 on average, T = interval_steps * dt, moves by

    m x'' + c x' + k_s x = -k_f x(t - T / 2)  ~  -k_f x + k_f T / 2 x'

so the delay is a damping of -k_f T / 2: without any other damping every interval is unstable, and it grows as exp(k_f T t / 4 m). What
holds against it: dashpots and local damping; and drainage, which at the interval's end takes a share 1 - 1 / (1 + D Q^2 T) off a pressure wave,
so that fine waves drain within the interval and the drained limit is one of the fluid's stiffness beside the skeleton's, whatever T.

Here this is not left at the estimate: for waves along a pack of layers one diameter apart, from the finest, pi / d, to that of a box
drained on one side, pi / 2 L, with Q = 2 / d sin(q d / 2), an interval of velocity Verlet steps with its solve is a matrix, of which no
eigenvalue may be larger than 1. The waves' stiffnesses are M Q^2 and Q^2 / (porosity beta), with M the skeleton's for uniaxial strain,
K + 4 G / 3 of an even packing with Z contacts a grain (Walton 1987): K = Z (1 - phi) k_n / (6 pi d), G = Z (1 - phi) (k_n + 3/2 k_s) / (10 pi d). D = k /
(viscosity porosity beta), with k of (6) in dense packs, 1.0e-9 m^2 at porosity 0.35 and d = 2 mm. Local damping is a damping ratio alpha / pi.

Held against runs: of 138 grains between fixed walls by `poreslip stability --only 'coupling/staggered/*'` (docs/stability.md), and of a box of consolidation by
`poreslip test --all -k staggered_limit`, where the limit lies within a factor of two of the estimate. It is near the estimate where the fluid is stiffer
than the skeleton and short waves decide, and further up where long waves do, which grow slowly.
A servo that holds a stress has a limit of its own: coupling/fluid/servo_checks.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from coupling.case.run_case import RunCase

#: Contacts a grain in a dense pack under stress.
COORDINATION = 6.0
#: Permeability, m^2, at a porosity and a diameter, m: the paper's k0; elsewhere by Kozeny and Carman.
PERMEABILITY, AT_POROSITY, AT_DIAMETER = 1.0e-9, 0.35, 2.0e-3
WAVES = 40
#: Intervals found to become unstable over the estimate: near 1 where the fluid is stiffer than the skeleton and short waves decide, more where long
#: waves do, which grow slowly.
FOUND = (1.0, 4.0)
#: By how much the estimate may be short: longer intervals are refused, those in between are told of.
MARGIN = 2
#: Growth in an interval that counts as none.
ROUNDING = 1e-9
#: Intervals longer than this are not looked at.
LONGEST = 1 << 16


@dataclass(frozen=True)
class Layers:
    """Pack and fluid as waves see them. modulus: of the skeleton, Pa. storage: porosity times compressibility, 1/Pa. density: of the pack,
    kg/m^3. mobility: k / viscosity, m^2/(Pa s). spacing, length: m. local_damping: alpha. relaxation: c_n / k_n of the contacts, s. time_step: s."""

    modulus: float
    storage: float
    density: float
    mobility: float
    spacing: float
    length: float
    local_damping: float
    relaxation: float
    time_step: float

    def growth(self, steps: int) -> float:
        """Largest factor by which a wave grows in an interval of so many steps."""
        wave = np.linspace(math.pi / 2.0 / self.length, math.pi / self.spacing, WAVES)
        square = (2.0 / self.spacing * np.sin(0.5 * wave * self.spacing)) ** 2
        skeleton = self.modulus * square / self.density
        dt, time = self.time_step, steps * self.time_step
        # Acceleration by pressure for a displacement since the last solve, and what is left of it before, at the next solve.
        drained = self.storage + self.mobility * square * time
        fluid, left = square / drained / self.density, self.storage / drained
        damping = 2.0 * self.local_damping / math.pi * np.sqrt(skeleton + fluid) + self.relaxation * skeleton

        # x, v, acceleration, that by pressure, x at the last solve.
        x, v, a, p, x0 = np.broadcast_to(np.eye(5), (WAVES, 5, 5)).transpose(1, 0, 2)
        middle = v + 0.5 * dt * a
        moved = x + dt * middle
        pulled = p - skeleton[:, None] * moved - damping[:, None] * middle
        step = np.stack([moved, middle + 0.5 * dt * pulled, pulled, p, x0], axis=1)
        solved = left[:, None] * p - fluid[:, None] * (x - x0)
        solve = np.stack([x, v, a + solved - p, solved, x], axis=1)
        return float(np.abs(np.linalg.eigvals(solve @ np.linalg.matrix_power(step, steps))).max())

    def longest_interval(self) -> int:
        """Steps between two solves up to which no wave grows; 0 if there are none, LONGEST if there is no end."""
        low, high = 0, 1
        while high <= LONGEST and self.growth(high) <= 1.0 + ROUNDING:
            low, high = high, 2 * high
        while high - low > 1 and low < LONGEST:
            middle = (low + high) // 2
            low, high = (middle, high) if self.growth(middle) <= 1.0 + ROUNDING else (low, middle)
        return low


def range_text(longest: int) -> str:
    """The estimate with the range in which limits were found, for messages."""
    return f"{longest} steps by estimate (limits found: {FOUND[0]:g} to {FOUND[1]:g} times that)"


def layers_of(case: RunCase) -> Layers:
    """Estimates of a case's pack and fluid, from its inputs alone."""
    porosity, spacing = case.pack.porosity, 2.0 * case.mean_radius_m
    mass = case.pack.density_kg_m3 * math.pi / 6.0 * spacing**3
    contacts = COORDINATION * (1.0 - porosity) / (math.pi * spacing)
    bulk = contacts * case.normal_stiffness_N_per_m / 6.0
    shear = contacts * (case.normal_stiffness_N_per_m + 1.5 * case.shear_stiffness_N_per_m) / 10.0
    looser = (porosity / AT_POROSITY) ** 3 * ((1.0 - AT_POROSITY) / (1.0 - porosity)) ** 2
    return Layers(
        modulus=bulk + 4.0 / 3.0 * shear,
        storage=porosity * case.fluid.compressibility_per_Pa,
        density=(1.0 - porosity) * case.pack.density_kg_m3,
        mobility=PERMEABILITY * looser * (spacing / AT_DIAMETER) ** 2 / case.fluid.viscosity_Pa_s,
        spacing=spacing,
        length=max(case.pack.box_m),
        local_damping=case.material.local_damping,
        relaxation=0.5 * mass * case.normal_damping_per_s / case.normal_stiffness_N_per_m,
        time_step=case.time_step_s,
    )
