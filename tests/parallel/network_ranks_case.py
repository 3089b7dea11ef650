"""Forces of a fixed pressure field on a pack, from however many ranks; the result goes to a file. Run by test_network_ranks.py.

Arguments: pack (npz with x, r), periodic directions (letters), output file. The grains are split into slabs along x. They then
move a little and some change rank, so that the mesh is kept with strays on it; and a great many change rank.
"""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork

comm = MPI.COMM_WORLD
pack = np.load(sys.argv[1])
x, r = pack["x"], pack["r"]
periodic = [axis in sys.argv[2] for axis in "xyz"]
net = PoreNetwork(comm, [0] * 3, [1] * 3, periodic)
result: dict[str, np.ndarray] = {}
outcomes = []


def take(name: str, x: np.ndarray, rank_of: np.ndarray) -> None:
    own = np.flatnonzero(rank_of == comm.rank)
    own = np.random.default_rng(comm.rank).permutation(own)
    outcomes.append(net.update(own, x[own], r[own]))
    centre = net.pore_centre
    pressure = np.sin(2 * np.pi * centre).sum(axis=1) + np.cos(2 * np.pi * centre[:, 0] + 4 * np.pi * centre[:, 2])
    velocity = np.cos(3 * x + 1)
    rate = net.volume_rate(velocity[own])
    work = np.array([(rate * pressure)[net.owned].sum()])
    comm.Allreduce(MPI.IN_PLACE, work)
    result[f"{name} work"] = work
    for law in ("total", "pressure"):
        own_force, wall_force = net.forces(pressure, law)
        force = np.zeros_like(x)
        force[own] = own_force
        comm.Allreduce(MPI.IN_PLACE, force)
        result[f"{name} {law}"], result[f"{name} {law} wall"] = force, wall_force
    report = net.report()
    result[f"{name} counts"] = np.array([report["grains"], report["pores"], report["throats"]])
    volume = np.array([net.cell_volume[net.owned].sum(), net.pore_volume[net.owned].sum()])
    comm.Allreduce(MPI.IN_PLACE, volume)
    result[f"{name} volume"] = volume


slab = np.minimum((x[:, 0] * comm.size).astype(int), comm.size - 1)
take("slabs", x, slab)
moved = x + 1e-9 * np.sin(np.arange(x.size)).reshape(x.shape)
strays = slab.copy()
strays[:: len(x) // 20] = (strays[:: len(x) // 20] + 1) % comm.size
take("strays", moved, strays)
assert outcomes[-1] == "kept", outcomes
take("back", moved, slab)
assert outcomes[-1] == "kept", outcomes
take("other slabs", moved, np.minimum((x[:, 1] * comm.size).astype(int), comm.size - 1))
assert outcomes[-1] == ("rebuilt" if comm.size > 1 else "kept"), outcomes
take("all on the last", x, np.full(len(x), comm.size - 1))
# The ranks without grains take part in what becomes of the mesh.
take("all on the last, moved", x + 2e-4 * np.sin(np.arange(x.size)).reshape(x.shape), np.full(len(x), comm.size - 1))
assert outcomes[-1] == "repaired", outcomes
if comm.rank == 0:
    np.savez(sys.argv[3], **result)
