"""The grains that a pack starts from: random positions and sizes, as a LIGGGHTS data file; and what porosities can be had of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from coupling.case.schema import Pack

#: Room around the box for the walls to move in, as a fraction of its longest side.
MARGIN = 0.1
#: Solid fraction of an endless pack: random without friction, and as dense as exchanges of sizes make it in the rounds that in.pack gives
#: them. The latter grows with the spread of the sizes (standard deviation over mean) up to that of Table I. Fitted to this protocol.
RANDOM_SOLID, DENSEST_SOLID, FULL_SPREAD = 0.64, 0.672, 0.0577
#: Part of a diameter by which a smooth wall seems to stand further in, for the looser grains at it.
WALL_GAP_DIAMETERS = 0.1
#: Largest and smallest first step of the exchange of sizes, in standard deviations of the radius: for the densest pack and for a
#: random one.
LARGEST_STEP, SMALLEST_STEP = 1.5, 0.05
#: Part of the grains that end without contacts in packs without friction: the densest, and those whose porosity is larger by
#: FLOATER_RANGE or more.
FEWEST_FLOATERS, FLOATERS, FLOATER_RANGE = 0.003, 0.012, 0.007
#: With friction the forces rest on fewer grains: floaters = LOOSE_FLOATERS + FLOATERS_PER_FRICTION * coefficient, for a pack that
#: came to rest at LOOSE_START of the random solid fraction. Measured for coefficients up to 0.2.
LOOSE_FLOATERS, FLOATERS_PER_FRICTION, LOOSE_START = 0.026, 0.8, 0.985


def random_porosity(pack: Pack, periodic_z: bool) -> float:
    """Porosity of a random pack without friction between the box's walls."""
    return 1.0 - RANDOM_SOLID * _wall_factor(pack, periodic_z)


def densest_porosity(pack: Pack, periodic_z: bool) -> float:
    """Porosity of the densest pack that the exchange of sizes makes between the box's walls."""
    smallest, largest = pack.diameter_m
    spread = (largest - smallest) / (largest + smallest) / math.sqrt(3.0)
    gained = (DENSEST_SOLID - RANDOM_SOLID) * min(1.0, spread / FULL_SPREAD)
    return 1.0 - (RANDOM_SOLID + gained) * _wall_factor(pack, periodic_z)


def aimed_porosity(pack: Pack, periodic_z: bool) -> float:
    """The porosity asked for, or the densest."""
    return max(pack.porosity, densest_porosity(pack, periodic_z))


def is_loose(pack: Pack, periodic_z: bool) -> bool:
    """Whether the pack is made with friction: the case asks for it, or for a porosity that no pack without friction has."""
    return pack.friction > 0.0 or _loose_floaters(pack, periodic_z) > LOOSE_FLOATERS


def packing_friction(pack: Pack, periodic_z: bool) -> float:
    """Coefficient of friction while the pack is made: given, or what leaves as many floaters as the porosity asked for needs."""
    if pack.friction > 0.0 or not is_loose(pack, periodic_z):
        return pack.friction
    return (_loose_floaters(pack, periodic_z) - LOOSE_FLOATERS) / FLOATERS_PER_FRICTION


def _loose_floaters(pack: Pack, periodic_z: bool) -> float:
    """Part of the grains of a loose random pack that has to go for the porosity asked for."""
    return 1.0 - (1.0 - pack.porosity) / (LOOSE_START * (1.0 - random_porosity(pack, periodic_z)))


def exchange_step(pack: Pack, periodic_z: bool) -> float:
    """First step of the exchange of sizes: the longer the denser the pack is to become."""
    random, densest = random_porosity(pack, periodic_z), densest_porosity(pack, periodic_z)
    effort = (random - pack.porosity) / (random - densest) if random > densest else 0.0
    return min(max(LARGEST_STEP * effort, SMALLEST_STEP), LARGEST_STEP)


def _floaters(pack: Pack, periodic_z: bool) -> float:
    if is_loose(pack, periodic_z):
        return LOOSE_FLOATERS + FLOATERS_PER_FRICTION * packing_friction(pack, periodic_z)
    looser = (aimed_porosity(pack, periodic_z) - densest_porosity(pack, periodic_z)) / FLOATER_RANGE
    return FEWEST_FLOATERS + (FLOATERS - FEWEST_FLOATERS) * min(1.0, looser)


def _wall_factor(pack: Pack, periodic_z: bool) -> float:
    sides = pack.box_m[:2] if periodic_z else pack.box_m
    mean_diameter = sum(pack.diameter_m) / 2.0
    return 1.0 - WALL_GAP_DIAMETERS * mean_diameter * sum(2.0 / side for side in sides)


def write_grains(pack: Pack, path: Path, periodic_z: bool) -> int:
    """Write as many grains as fill the box at the porosity aimed at, or at the densest, at random places; return their number.

    The same for any number of ranks: made from the seed alone. Ids are 1 to the number of grains, the type is 1.
    """
    random = np.random.default_rng(pack.seed)
    box = np.array(pack.box_m)
    smallest, largest = pack.diameter_m
    mean_volume = np.pi / 6.0 * (smallest**2 + largest**2) * (smallest + largest) / 4.0
    solid = (1.0 - aimed_porosity(pack, periodic_z)) / (1.0 - _floaters(pack, periodic_z))
    count = max(1, int(box.prod() * solid / mean_volume))
    diameter = random.uniform(smallest, largest, count)
    inset = np.array([smallest / 2.0] * 3)
    if periodic_z:
        inset[2] = 0.0
    position = inset + random.random((count, 3)) * (box - 2.0 * inset)

    margin = np.full(3, MARGIN * box.max())
    if periodic_z:
        margin[2] = 0.0
    lines = [f"poreslip pack, seed {pack.seed}", "", f"{count} atoms", "3 atom types", ""]
    lines += [f"{-m:.17g} {side + m:.17g} {axis}lo {axis}hi" for axis, side, m in zip("xyz", box, margin)]
    lines += ["", "Atoms", ""]
    lines += [
        f"{i + 1} 1 {d:.17g} {pack.density_kg_m3:.17g} {x:.17g} {y:.17g} {z:.17g}" for i, (d, (x, y, z)) in enumerate(zip(diameter, position))
    ]
    path.write_text("\n".join(lines) + "\n")
    return count
