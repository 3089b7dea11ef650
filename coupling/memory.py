"""Whether the machine holds a case's grains: told before the first of them is made, for who runs out of memory is killed without a word."""

from __future__ import annotations

from pathlib import Path

from coupling.case.checks import toml_text
from coupling.case.run_case import RunCase
from coupling.errors import InputError
from coupling.plan import memory_bytes

#: By how much the estimate may be too large.
MARGIN = 1.2


def refuse_too_large(case: RunCase, comm) -> None:
    """Raise InputError if the ranks of some machine would need more memory than it has; collective."""
    from mpi4py import MPI

    neighbours = comm.Split_type(MPI.COMM_TYPE_SHARED)
    needed = memory_bytes(case) * neighbours.size / comm.size
    neighbours.Free()
    shortest = comm.allreduce(available_bytes() - needed / MARGIN, op=MPI.MIN)
    if shortest < 0.0:
        raise InputError(
            f"pack.box_m = {toml_text(case.pack.box_m)} with pack.diameter_m = {toml_text(case.pack.diameter_m)} (run {case.name}): about {case.estimated_grains:.2g} grains, "
            f"which need about {memory_bytes(case) / 1e9:.3g} GB, {-shortest / 1e9:.3g} GB more than a machine of this run has free. Both are in m: check them, choose "
            "a smaller box or larger grains, or spread the ranks over more machines")


def available_bytes() -> int:
    """Memory that this machine could hand out now (Linux)."""
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return 1 << 62
