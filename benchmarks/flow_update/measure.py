"""One measurement of flow_update: positions to forces, fresh, after a small move, and with the preconditioner kept.

Run by run.py on 1 or more ranks; prints one JSON line on rank 0. The pack is made of turned copies of a pressed pack of 1000
grains (tests/data), porosity 0.36, size ratio 1.2; pressure is given on ymin and ymax, the other walls are closed.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.transfer import carry_pressure

DATA = Path(__file__).resolve().parents[2] / "tests" / "data" / "peer_pack_1000.npz"


def slab(comm: MPI.Comm, tiles: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """This rank's share of the pack: whole layers of tiles along x, each turned and mirrored in its own way."""
    spheres = np.load(DATA)["spheres"]
    ids, positions, radii = [], [], []
    for i in np.array_split(np.arange(tiles[0]), comm.size)[comm.rank]:
        for j in range(tiles[1]):
            for k in range(tiles[2]):
                number = (i * tiles[1] + j) * tiles[2] + k
                rng = np.random.default_rng(number)
                x = spheres[:, rng.permutation(3)]
                x = np.where(rng.random(3) < 0.5, x, 1 - x)
                ids.append(number * 1000 + np.arange(1000))
                positions.append(x + [i, j, k])
                radii.append(spheres[:, 3])
    return np.concatenate(ids), np.concatenate(positions), np.concatenate(radii)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--tiles", type=int, nargs=3, required=True)
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--move", type=float, default=1e-4, help="of the mean diameter")
    arguments = parser.parse_args()
    comm = MPI.COMM_WORLD
    ids, position, radius = slab(comm, arguments.tiles)
    boundary = Boundary(pressure={"ymin": 1.0, "ymax": 0.0})
    upper = np.array(arguments.tiles, float)
    bare = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    network = PoreNetwork(comm, np.zeros(3), upper)
    network.remember_previous()
    state: dict = {}

    def update(name: str, x: np.ndarray) -> dict:
        """Positions to forces; seconds by part, wall and CPU, the slowest rank's."""
        parts: dict[str, float] = {}
        clock, cpu = time.perf_counter(), time.process_time()

        def part(key: str) -> None:
            nonlocal clock
            now = time.perf_counter()
            parts[key] = now - clock
            clock = now

        before = network.pores
        outcome = network.update(ids, x, radius)
        part("tessellate")
        flow = state.get("flow")
        if flow is None:
            flow = state["flow"] = PoreFlow(network, viscosity=10.0, compressibility=1e-9)
        else:
            flow.refresh()
        part("geometry")
        start = state.get("pressure")
        if start is not None and outcome != "kept":
            start = carry_pressure(network, start, before)
        part("carry")
        result = flow.steady(boundary, start, tolerance=arguments.tolerance)
        state["pressure"] = result.pressure
        part("flow")
        network.forces(result.pressure)
        part("forces")
        parts["total"] = sum(parts.values())
        parts["cpu"] = time.process_time() - cpu
        parts |= result.report["seconds"]
        slowest = {key: comm.allreduce(value, op=MPI.MAX) for key, value in parts.items()}
        return {"case": name, "mesh": outcome, "iterations": result.report["iterations"], "seconds": slowest, "preconditioner_kept": result.report["preconditioner_kept"]}

    rows = [update("fresh", position)]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rows.append(update("same again", position))
    rng = np.random.default_rng(1 + comm.rank)
    moved = position + rng.normal(size=position.shape) * arguments.move * 2 * radius.mean() / np.sqrt(3)
    moved = np.clip(moved, 1e-6, upper - 1e-6)
    rows.append(update(f"moved {arguments.move:g} d", moved))
    total = comm.allreduce(len(ids))
    memory = comm.allreduce((peak - bare) * 1024) / total
    pores = network.report()["pores"]
    if comm.rank == 0:
        print(json.dumps({"grains": total, "pores": pores, "ranks": comm.size, "bytes_per_grain": memory, "rows": rows}), flush=True)


main()
