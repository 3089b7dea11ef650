"""The grains that a pack starts from: random positions and sizes, as a LIGGGHTS data file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coupling.case_schema import Pack

#: Room around the box for the walls to move in, as a fraction of its longest side.
MARGIN = 0.1
#: Solid fraction that in.pack reaches in an endless pack, and the part of a diameter by which a smooth wall's face is moved
#: inwards by the looser grains at it: fitted to boxes of 5 and of 10 diameters' depth. They set the number of grains, so that the settled
#: box has the size asked for.
DENSEST_SOLID, WALL_GAP_DIAMETERS = 0.652, 0.063


def starting_porosity(pack: Pack, periodic_z: bool) -> float:
    """Porosity of the closed box: the one aimed at, or what the protocol can reach between these walls."""
    sides = pack.box_m[:2] if periodic_z else pack.box_m
    walls = sum(2.0 / side for side in sides) * sum(pack.diameter_m) / 2.0
    return max(pack.porosity, 1.0 - DENSEST_SOLID * (1.0 - WALL_GAP_DIAMETERS * walls))


def write_grains(pack: Pack, path: Path, periodic_z: bool) -> int:
    """Write as many grains as fill the box at `starting_porosity`, at random places in it, overlapping; return their number.

    The same for any number of ranks: made from the seed alone. Ids are 1 to the number of grains, the type is 1.
    """
    random = np.random.default_rng(pack.seed)
    box = np.array(pack.box_m)
    smallest, largest = pack.diameter_m
    mean_volume = np.pi / 6.0 * (smallest**2 + largest**2) * (smallest + largest) / 4.0
    count = max(1, int(box.prod() * (1.0 - starting_porosity(pack, periodic_z)) / mean_volume))
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
