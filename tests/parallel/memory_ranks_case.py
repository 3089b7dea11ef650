"""On however many ranks: a thousand meshes, forces and solves with walls, and as many with periods; rank 0 prints the growth of each rank, in kB. Run by test_memory_ranks.py.

Every other mesh is made anew, the others are kept or repaired. Grains wander to and fro between the ranks.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "unit"))
from geometry_reference import random_pack  # noqa: E402

from flowsolver import PoreNetwork  # noqa: E402
from flowsolver.flow import Boundary, PoreFlow  # noqa: E402

COUNT, WARM = 1000, 300
comm = MPI.COMM_WORLD
x, r = random_pack(40, (0.08, 0.14), seed=1)


def resident() -> int:
    """kB held by this process now."""
    return int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0])


for periodic in ((False, False, False), (True, False, True)):
    network = PoreNetwork(comm, [0] * 3, [1] * 3, periodic)
    network.remember_previous()
    flow, rng = None, np.random.default_rng(0)
    for count in range(COUNT):
        moved = np.clip(x + rng.normal(scale=2e-3, size=x.shape), 0.02, 0.98)
        own = np.flatnonzero((moved[:, 1] > 0.5) == comm.rank) if comm.size > 1 else np.arange(len(x))
        network.update(own, moved[own], r[own], rebuild=count % 2 == 0)
        flow = flow or PoreFlow(network, 1e-3, compressibility=4.5e-10)
        flow.refresh()
        result = flow.steady(Boundary(pressure={"ymin": 1.0, "ymax": 0.0}), tolerance=1e-6)
        network.forces(result.pressure)
        if count == WARM:
            before = resident()
    growth = comm.gather(resident() - before)
    if comm.rank == 0:
        print(periodic, *growth, flush=True)
