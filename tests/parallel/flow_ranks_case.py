"""Steady, implicit and two-way flow through a pack on however many ranks; the result goes to a file. Run by test_flow_ranks.py.

Arguments: pack (npz with x, r), periodic directions (letters), output file.
"""

from __future__ import annotations

import sys

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.two_way import TwoWayCoupling

comm = MPI.COMM_WORLD
pack = np.load(sys.argv[1])
x, r = pack["x"], pack["r"]
periodic = [axis in sys.argv[2] for axis in "xyz"]
own = np.flatnonzero(np.minimum((x[:, 1] * comm.size).astype(int), comm.size - 1) == comm.rank)
net = PoreNetwork(comm, [0] * 3, [1] * 3, periodic)
net.update(own, x[own], r[own])
flow = PoreFlow(net, 1e-3, compressibility=4.5e-10)
flow.refresh(body_force=(100.0, 0.0, 50.0))
boundary = Boundary() if all(periodic) else Boundary(pressure={"xmin": 1e3, "xmax": lambda c: 100 * c[:, 1]})
result: dict[str, np.ndarray] = {}


def take(name: str, solved) -> None:
    force, wall_force = flow.forces(solved.pressure)
    everywhere = np.zeros_like(x)
    everywhere[own] = force
    comm.Allreduce(MPI.IN_PLACE, everywhere)
    borne = everywhere.sum(axis=0) + wall_force[0, 1::2] - wall_force[0, ::2]
    np.testing.assert_allclose(borne, (1 - (4 / 3 * np.pi * r**3).sum()) * flow.body_force, atol=1e-10 * np.abs(everywhere).sum())
    result[f"{name} force"], result[f"{name} wall"] = everywhere, wall_force
    owned = net.owned
    rows = np.column_stack([np.sort(net.grains_of_pore[owned], axis=1), solved.pressure[owned]])
    rows = np.concatenate(comm.allgather(rows))
    result[f"{name} pressure"] = rows[np.lexsort(rows.T[::-1])]
    result[f"{name} outflow"] = np.array(list(solved.outflow.values()))


steady = flow.steady(boundary, tolerance=1e-13)
assert steady.mass_residual < 1e-10, steady.mass_residual
take("steady", steady)
pressure, velocity = steady.pressure, np.cos(3 * x[own] + 1) * 1e-4
for _ in range(3):
    stepped = flow.implicit(boundary, pressure, 1e-8, net.volume_rate(velocity), tolerance=1e-13)
    assert stepped.mass_residual < 1e-10, stepped.mass_residual
    pressure = stepped.pressure
take("implicit", stepped)
if not all(periodic):
    take("explicit", flow.explicit(boundary, steady.pressure, 1e-10, net.volume_rate(velocity)))

# Two-way, from the implicit pressures, without a body force: nine steps in three intervals, the last of them not yet solved.
if not all(periodic):
    flow.refresh()
    walls = np.array([[0.0, 0.0, 2e-5, 0.0, 0.0 if periodic[2] else 1e-5, 0.0]])
    for split in ("undrained", "predicted"):
        coupling = TwoWayCoupling(net, flow, boundary, pressure, split, tolerance=1e-13)
        for interval in range(3):
            for step in range(3):
                coupling.move(np.cos((3 + step) * x[own] + interval) * 1e-4, 1e-9, walls)
            if interval < 2:
                coupling.exchange()
        force, wall_force = coupling.forces()
        everywhere = np.zeros_like(x)
        everywhere[own] = force
        comm.Allreduce(MPI.IN_PLACE, everywhere)
        result[f"{split} force"], result[f"{split} wall"] = everywhere, wall_force
        done, given, size = comm.allreduce(np.array(coupling.work))
        assert abs(done - given) < 1e-12 * size, (done, given, size)
        result[f"{split} work"] = np.array([done, size])

if comm.rank == 0:
    np.savez(sys.argv[3], **result)
