"""Solve after solve, all grains on the last rank: those without a pore take part in each. Run by test_flow_ranks.py. Argument: output file."""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

comm = MPI.COMM_WORLD
rng = np.random.default_rng(4)
x = (np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) + 0.5 + rng.uniform(-0.1, 0.1, (64, 3))) / 4
r = np.full(64, 0.11)
own = np.arange(64) if comm.rank == comm.size - 1 else np.arange(0)
network = PoreNetwork(comm, [0] * 3, [1] * 3)
network.update(own, x[own], r[own])
result = []
for law in ("duct", "hydraulic-radius"):
    flow = PoreFlow(network, viscosity=1e-3, compressibility=5e-10, conductance=law)
    pressure = np.zeros(network.pores)
    for top in (1e5, 1e5, 2e5):
        solved = flow.implicit(Boundary(pressure={"zmax": top, "zmin": 0.0}), pressure, 1e-9)
        pressure = solved.pressure
        result.append(solved.outflow["zmin"])
    result += [flow.steady(Boundary(pressure={"zmax": top}, inflow={"zmin": 1e-3}), pressure).outflow["zmax"] for top in (1.0, 2.0)]
# What is refused leaves nothing behind for the next mesh.
flow = PoreFlow(network, viscosity=1e-3)
for _ in range(2):
    try:
        flow.steady(Boundary(sources=[(0.5, 0.5, 0.5, 1e-9)]))
    except InputError:
        result.append(0.0)
    x = x + 0.05 * rng.uniform(-0.1, 0.1, x.shape)
    network.update(own, x[own], r[own], rebuild=True)
    flow.refresh()
    result.append(flow.steady(Boundary(pressure={"zmax": 1.0, "zmin": 0.0})).outflow["zmin"])
if comm.rank == 0:
    np.save(sys.argv[1], result)
