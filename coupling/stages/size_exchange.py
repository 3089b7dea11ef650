"""Exchange of sizes between grains: what makes a pack of given grains dense.

Where grains lie, and which size lies where, are both free in a pack; moving grains alone gets stuck at the porosity of a random close
packing, with 2 to 3 % of the grains loose in their cages. The elastic energy E of overlapping spheres falls along
dE/dR_i = sum of the normal forces on grain i, so every radius takes a step down that gradient, and the step is then
carried back to the sizes that there are: the smallest size goes to the smallest wanted radius, and so on, which is the
permutation nearest to the wanted radii. Squeezed grains become smaller and loose ones larger; the size distribution stays as it was.
"""

from __future__ import annotations

import numpy as np

from coupling.engine.interface import Engine
from coupling.scene.walls import wall_positions

#: Steps are in standard deviations of the radius, but of at most this part of the mean radius: the room between neighbours, and not the spread of
#: the sizes, then limits them.
WIDEST_STEP = 0.08


def exchange_sizes(engine: Engine, comm, walls, step: float) -> None:
    """Give every grain another of the grains' sizes; collective.

    walls: fix ids of the pack's walls. step: root mean square of the wanted change of radius, in standard deviations of the radius.
    """
    ids, radius = engine.atom("id"), engine.atom("radius")
    length = max(comm.allgather(int(ids.max(initial=0)))) + 1
    own = np.zeros((3, length))  # of the grains by id: is there, radius, sum of its overlaps
    own[0, ids], own[1, ids] = 1.0, radius
    own[2, ids] = _wall_overlaps(engine, walls)
    contacts = engine.contacts()
    for end in (0, 1):
        own[2] += np.bincount(contacts.id[:, end], weights=contacts.overlap, minlength=length)
    everywhere = comm.allreduce(own)
    there = np.flatnonzero(everywhere[0])
    sizes, squeeze = everywhere[1:, there]
    if squeeze.std() == 0.0 or sizes.std() == 0.0:
        return
    wanted = sizes - step * min(sizes.std(), WIDEST_STEP * sizes.mean()) * (squeeze - squeeze.mean()) / squeeze.std()
    new = np.zeros(length)
    new[there[np.argsort(wanted, kind="stable")]] = np.sort(sizes)
    engine.atom("rmass")[:] *= (new[ids] / radius) ** 3
    radius[:] = new[ids]


def _wall_overlaps(engine: Engine, walls) -> np.ndarray:
    """Sum of the overlaps of this rank's grains with the walls, (n,) m."""
    position, radius = engine.atom("x"), engine.atom("radius")
    total = np.zeros(len(radius))
    for name, at in wall_positions(engine, walls).items():
        inwards = 1.0 if name in ("x_left", "y_front", "z_bottom") else -1.0
        total += np.maximum(radius - inwards * (position[:, "xyz".index(name[0])] - at), 0.0)
    return total
