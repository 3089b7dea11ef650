"""A body-centred lattice, some of whose grains are moved by steps that leave them in ties with others and with walls, again and again. After
each update the pores fill the box once, and the forces of a pressure with the box's period close. Run by test_repair_ranks.py.

Arguments: periodic directions (letters or -), moves. Prints how often the mesh was kept, repaired and rebuilt.
"""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork

comm = MPI.COMM_WORLD
periodic = np.array([axis in sys.argv[1] for axis in "xyz"])
corner = (np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) / 8
lattice = np.concatenate([corner - 1 / 32, corner + 1 / 32])
radius = np.full(len(lattice), 0.015)
own = np.flatnonzero(np.minimum((lattice[:, 0] * comm.size).astype(int), comm.size - 1) == comm.rank)
rng, net, outcomes = np.random.default_rng(1), PoreNetwork(comm, [0] * 3, [1] * 3, periodic), []
for move in range(int(sys.argv[2])):
    x = lattice.copy()
    moved = rng.random(len(x)) < rng.choice([0.01, 0.1, 0.5])
    x[moved] += rng.choice([2**-10, 2**-7, 2**-6, 1e-3, 1e-2]) * rng.integers(-1, 2, size=(moved.sum(), 3))
    x = np.where(periodic, np.mod(x, 1.0), x)
    outcomes.append(net.update(own, x[own], radius[own]))
    volume = comm.allreduce(net.cell_volume[net.owned].sum())
    force, wall = net.forces(np.sin(2 * np.pi * net.pore_centre + 1).sum(axis=1))
    resultant = comm.allreduce(force.sum(axis=0)) + (wall[:, 1::2] - wall[:, 0::2]).sum(axis=0)
    assert abs(volume - 1) < 1e-12 and np.abs(resultant).max() < 1e-12, (move, outcomes[-1], volume, resultant)
if comm.rank == 0:
    print(*(outcomes.count(kind) for kind in ("kept", "repaired", "rebuilt")))
