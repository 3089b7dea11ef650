"""One measurement of flow_update: positions to forces, fresh, the same again, and after small moves. Run by run.py on 1 or more ranks;
prints one JSON line on rank 0. Pressure is given on ymin and ymax, the other walls are closed. With --apart each rank has the whole pack to
itself, and all begin each update at once: what they take more than one alone is the machine's doing, not that of any parallel code.
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import numpy as np
from mpi4py import MPI
from pack import BLOCKS, pack

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.transfer import carry_pressure

BOUNDARY = Boundary(pressure={"ymin": 1.0, "ymax": 0.0})


class Updates:
    """Updates of one network and flow, and what each took."""

    def __init__(self, comm: MPI.Comm, everybody: MPI.Comm, upper: np.ndarray, tolerance: float) -> None:
        self.comm, self.everybody, self.tolerance = comm, everybody, tolerance
        self.network = PoreNetwork(comm, np.zeros(3), upper)
        self.network.remember_previous()
        self.flow: PoreFlow | None = None
        self.pressure: np.ndarray | None = None

    def update(self, name: str, ids: np.ndarray, x: np.ndarray, radius: np.ndarray) -> dict:
        """Positions to forces; CPU seconds by part and as a whole, wall seconds as a whole and within the flow: the slowest rank's."""
        seconds: dict[str, float] = {}
        self.everybody.Barrier()
        wall, start = time.perf_counter(), time.process_time()

        def part(key: str) -> None:
            seconds[key] = time.process_time() - start - sum(seconds.values())

        before = self.network.pores
        mesh = self.network.update(ids, x, radius)
        part("tessellate")
        if self.flow is None:
            self.flow = PoreFlow(self.network, viscosity=10.0, compressibility=1e-9)
        else:
            self.flow.refresh()
        part("geometry")
        if self.pressure is not None and mesh != "kept":
            self.pressure = carry_pressure(self.network, self.pressure, before)
        part("carry")
        result = self.flow.steady(BOUNDARY, self.pressure, tolerance=self.tolerance)
        self.pressure = result.pressure
        part("flow")
        self.network.forces(result.pressure)
        part("forces")
        seconds["cpu"] = sum(seconds.values())
        self.comm.Barrier()
        seconds["wall"] = time.perf_counter() - wall
        seconds |= result.report["seconds"]
        slowest = {key: self.everybody.allreduce(value, op=MPI.MAX) for key, value in seconds.items()}
        return {"update": name, "mesh": mesh, "iterations": result.report["iterations"], "kept": result.report["preconditioner_kept"], "seconds": slowest}


def kernel_rates(network: PoreNetwork, flow: PoreFlow, ids: np.ndarray, x: np.ndarray, radius: np.ndarray) -> dict[str, float]:
    """Tetrahedra and facets a second of one rank's geometry kernels, the best of several: volumes; throat sections and lengths, by the pass that counts
    those which are limited; the same pass with conductances, as the flow solver takes them up; forces."""

    def rate(count: int, phase: str, call, before=lambda: None) -> float:
        def seconds() -> float:
            before()
            start = network.report()["seconds"][phase]
            call()
            return network.report()["seconds"][phase] - start

        return count / min(seconds() for _ in range(10))

    throats, pressure = len(network.owned_throats), network.pore_centre[:, 1].copy()
    # Volumes are taken once after each update, and flow.refresh finds them at hand.
    volumes = rate(network.pores, "geometry", lambda: network.pore_volume, lambda: network.update(ids, x, radius))
    return {
        "volumes": volumes,
        "sections": rate(throats, "geometry", network.limited),
        "with conductances": rate(throats, "geometry", flow.refresh),
        "forces": rate(throats, "forces", lambda: network.forces(pressure)),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--grains", type=int, choices=sorted(BLOCKS), required=True)
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--apart", action="store_true")
    parser.add_argument("--move", type=float, default=1e-4, help="of the mean diameter")
    arguments = parser.parse_args()
    everybody = MPI.COMM_WORLD
    comm = MPI.COMM_SELF if arguments.apart else everybody
    ids, position, radius, upper = pack(BLOCKS[arguments.grains], comm.rank, comm.size)
    bare = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    updates = Updates(comm, everybody, upper, arguments.tolerance)
    rows = [updates.update("fresh", ids, position, radius)]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rows.append(updates.update("same again", ids, position, radius))
    rng = np.random.default_rng(1 + comm.rank)
    for _ in range(2):
        position = position + rng.normal(size=position.shape) * arguments.move * 2 * radius.mean() / np.sqrt(3)
        rows.append(updates.update(f"moved {arguments.move:g} d", ids, position, radius))
    rates = kernel_rates(updates.network, updates.flow, ids, position, radius)
    total = comm.allreduce(len(ids))
    memory = comm.allreduce((peak - bare) * 1024) / total
    peaks = comm.allreduce(peak * 1024)
    pores = updates.network.report()["pores"]
    if everybody.rank == 0:
        print(json.dumps({"grains": total, "pores": pores, "ranks": comm.size, "bytes_per_grain": memory, "peak": peaks, "rates": rates, "rows": rows}), flush=True)


main()
