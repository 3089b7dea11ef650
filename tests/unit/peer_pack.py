"""A peer's flow through pressed packs: YADE 2023.02a's oedometer packs of 1000 and 8000 grains in the unit box, viscosity 10 Pa s, p = 1 Pa on
ymin and 0 on ymax, with the peer's own conductances.

tests/data/peer_pack_N.npz: `spheres` (N, 4) x y z r; `cell_vertices` (c, 4), sorted, grains' rows and -1 to -6 for the walls; `cell_pressure` (c,),
Pa; `throat_conductance` (t,), m^3/(Pa s), of the throats as `throat_vertices` yields them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver import PoreNetwork

DATA = Path(__file__).resolve().parent.parent / "data"
#: Grains to the flow through the pack, m^3/s.
OUTFLOW = {1000: 7.87110485e-07, 8000: 1.71857185e-07}


def peer_pack(grains: int) -> dict[str, NDArray[Any]]:
    """The peer's arrays, with `throat_vertices` (t, 3): the facets between two of its cells, sorted."""
    data = dict(np.load(DATA / f"peer_pack_{grains}.npz"))
    facets = np.concatenate([np.delete(data["cell_vertices"], k, axis=1) for k in range(4)])
    facets, cells = np.unique(facets, axis=0, return_counts=True)
    return data | {"throat_vertices": facets[cells == 2]}


def network_of(peer: dict[str, NDArray[Any]], comm: MPI.Comm = MPI.COMM_SELF) -> PoreNetwork:
    """Our own mesh of the pack, whose grains' ids are their rows; each rank brings every size-th grain."""
    own = slice(comm.rank, None, comm.size)
    network = PoreNetwork(comm, [0] * 3, [1] * 3)
    network.update(np.arange(len(peer["spheres"]))[own], peer["spheres"][own, :3], peer["spheres"][own, 3])
    return network


def by_vertices(vertices: NDArray[Any], values: NDArray[np.float64]) -> dict[tuple[int, ...], float]:
    return {tuple(v): value for v, value in zip(np.sort(vertices, axis=1).tolist(), values)}


def looked_up(table: dict[tuple[int, ...], float], vertices: NDArray[Any]) -> NDArray[np.float64]:
    return np.array([table[tuple(v)] for v in np.sort(vertices, axis=1).tolist()])
