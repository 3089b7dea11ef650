"""On two ranks: what has to be the same on both is given otherwise on rank 1. Rank 0 prints case|message of rank 0|of rank 1. Run by test_flow_boundary.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_reference import random_pack
from mpi4py import MPI
from told_by_ranks import told

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

comm = MPI.COMM_WORLD
x, r = random_pack(60, (0.06, 0.1), seed=1)
own = np.arange(60)[comm.rank :: 2]
DRIVEN = Boundary({"ymin": 1.0, "ymax": 0.0})


def other(one: Any, two: Any) -> Any:
    return one if comm.rank == 0 else two


def network(periodic: tuple[bool, bool, bool] = (False, False, False), upper: float = 1.0) -> PoreNetwork:
    net = PoreNetwork(comm, [0.0] * 3, [upper] * 3, periodic)
    net.update(own, x[own], r[own])
    return net


net = network()
flow = PoreFlow(net, 1.0, compressibility=1e-9)
zero = np.zeros(net.pores)
CASES = {
    "periodic": lambda: network(other((False,) * 3, (True, False, False))),
    "upper": lambda: network(upper=other(1.0, 2.0)),
    "viscosity": lambda: PoreFlow(net, other(1.0, 2.0)),
    "conductance": lambda: PoreFlow(net, 1.0, conductance=other("duct", "hydraulic-radius")),
    "body_force": lambda: flow.refresh((0.0, 0.0, other(0.0, 1.0))),
    "boundary": lambda: flow.steady(other(DRIVEN, Boundary({"ymin": 1.0}))),
    "boundary of other values": lambda: flow.steady(Boundary({"ymin": other(1.0, 2.0), "ymax": 0.0})),
    "boundary of other points": lambda: flow.steady(Boundary({"ymin": 1.0}, sources=other([], [(0.5, 0.5, 0.5, 1.0)]))),
    "pressure": lambda: flow.steady(DRIVEN, other(None, zero)),
    "tolerance": lambda: flow.steady(DRIVEN, tolerance=other(1e-8, 1e-9)),
    "dt": lambda: flow.implicit(DRIVEN, zero, other(1.0, 2.0)),
    "dt of explicit steps": lambda: flow.explicit(DRIVEN, zero, other(1e-12, 2e-12)),
}
for case, call in CASES.items():
    everyone = told(call)
    if comm.rank == 0:
        print(case, *everyone, sep="|")
# A number is a number, and functions are each rank's own.
flow.refresh()
mixed = Boundary({"ymin": other(1.0, np.float64(1.0)), "ymax": lambda place: 0.0 * place[:, 0]}, points=other([(0.5, 0.5, 0.5, 0.5)], np.full((1, 4), 0.5)))
assert flow.steady(mixed).mass_residual < 1e-10
