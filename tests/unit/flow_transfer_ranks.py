"""On two ranks: pressures carried to a new mesh are those that one rank carries. Run by test_flow_transfer.py."""

from __future__ import annotations

import numpy as np
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.transfer import carry_pressure

x, r = random_pack(200, (0.05, 0.08), seed=7)
moved = np.clip(x + np.random.default_rng(0).normal(scale=1e-3, size=x.shape), 0.01, 0.99)


def carried(comm: MPI.Comm) -> dict[tuple[int, ...], float]:
    net = PoreNetwork(comm, [0] * 3, [1] * 3)
    net.remember_previous()
    first = np.arange(200)[comm.rank :: comm.size]
    then = np.array_split(np.arange(200), comm.size)[comm.rank]
    net.update(first, x[first], r[first])
    pressure, pores = np.sin(9 * net.pore_centre).sum(axis=1), net.pores
    assert net.update(then, moved[then], r[then]) != "kept"
    after = carry_pressure(net, pressure, pores)
    owned = net.owned
    parts = comm.allgather([(tuple(sorted(v)), p) for v, p in zip(net.grains_of_pore[owned].tolist(), after[owned])])
    return dict(pair for part in parts for pair in part)


one, two = carried(MPI.COMM_SELF), carried(MPI.COMM_WORLD)
assert one.keys() == two.keys()
for key, p in one.items():
    assert abs(two[key] - p) < 1e-12, (key, p, two[key])
