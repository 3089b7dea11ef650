"""Move after move, a mesh that is repaired beside one made anew: the same cells, volumes, rates and forces, and the same flow; the fluid is
carried from mesh to mesh. Run by test_repair_ranks.py.

Arguments: pack (npz with x, r), periodic directions (letters), number of moves, displacement of each grain in a move (m). Grains change
rank on the way. Prints how often the mesh was kept, repaired and rebuilt.
"""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.transfer import carry_pressure

comm = MPI.COMM_WORLD
pack = np.load(sys.argv[1])
x, r = pack["x"], pack["r"]
periodic = np.array([axis in sys.argv[2] for axis in "xyz"])
moves, step = int(sys.argv[3]), float(sys.argv[4])


def new_network() -> PoreNetwork:
    return PoreNetwork(comm, [0] * 3, [1] * 3, periodic)


def cells(net: PoreNetwork) -> list[tuple[int, ...]]:
    """Of all ranks, each as often as it is owned."""
    parts = comm.allgather(np.sort(net.grains_of_pore[net.owned], axis=1))
    return sorted(map(tuple, np.concatenate(parts)))


def total(values: np.ndarray) -> np.ndarray:
    return comm.allreduce(values)


net = new_network()
net.remember_previous()
flow, carried = None, np.zeros(0)
faces = Boundary(pressure={"xmin": 1e3, "xmax": 0.0})
rng = np.random.default_rng(3)
rank_of = np.minimum((x[:, 0] * comm.size).astype(int), comm.size - 1)
velocity = step * rng.normal(size=x.shape) / np.sqrt(3)
outcomes = []
for move in range(moves):
    x = x + velocity + 0.3 * step * rng.normal(size=x.shape)
    x = np.where(periodic, np.mod(x, 1.0), np.clip(x, 0.02, 0.98))
    if move % 10 == 9:  # grains change rank
        rank_of = np.where(rng.random(len(x)) < 0.002, rng.integers(comm.size, size=len(x)), rank_of)
    own = np.flatnonzero(rank_of == comm.rank)
    pores = net.pores
    outcomes.append(net.update(own, x[own], r[own]))
    if move == 0:
        carried = 1.0 + net.pore_centre[:, 1]
    elif outcomes[-1] != "kept":
        _, volume, index = net.native.previous()
        held = total(volume @ carried[index])
        carried = carry_pressure(net, carried, pores)
        assert abs(total((net.pore_volume * carried)[net.owned].sum()) - held) < 1e-12 * held
    fresh = new_network()
    fresh.update(own, x[own], r[own])
    assert cells(net) == cells(fresh), (move, outcomes)
    results = []
    for one in (net, fresh):
        centre, owned = one.pore_centre, one.owned
        assert abs(total(one.cell_volume[owned].sum()) - 1.0) < 1e-12
        pressure = np.sin(2 * np.pi * centre).sum(axis=1) + np.cos(2 * np.pi * centre[:, 0] + 4 * np.pi * centre[:, 2])
        rate = one.volume_rate(np.cos(3 * x[own] + 1))
        counts = [one.report()[name] for name in ("grains", "pores", "throats")]
        results.append((*one.forces(pressure), total((rate * pressure)[owned].sum()), total(np.abs(rate[owned]).sum()), counts))
    for a, b in zip(*results):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12, err_msg=str((move, outcomes)))
    if move % 10 > 1 or periodic[0]:
        continue
    # The preconditioner is that of an earlier mesh, of which this one has been made by flips.
    if flow is None:
        flow = PoreFlow(net, 1e-3)
    else:
        flow.refresh()
    again = PoreFlow(fresh, 1e-3)
    solved, anew = (one.steady(faces, tolerance=1e-12) for one in (flow, again))
    for a, b in zip(net.forces(solved.pressure), fresh.forces(anew.pressure)):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8 * np.abs(anew.pressure).max(initial=0.0) * r.max() ** 2, err_msg=str((move, outcomes)))
if comm.rank == 0:
    print(*(outcomes.count(kind) for kind in ("kept", "repaired", "rebuilt")))
