"""Whether the forces in a pack balance, and steps until they do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coupling.engine.interface import Contacts, Engine
from coupling.errors import ComputationError

#: Steps until a stage is given up.
LONGEST_SETTLING = 60_000


def settle(
    engine: Engine, comm, what: str, target_forces: Callable[[], dict[str, float]], *, balanced: float, tolerance: float, steps: int = 1000
) -> None:
    """Make steps until the unbalanced-force ratio is below `balanced` and walls bear their target forces (N by fix id) within `tolerance`.

    steps: between two looks.
    """
    ratio = worst = float("inf")
    for _ in range(LONGEST_SETTLING // steps):
        ratio = unbalanced_force_ratio(engine, comm, engine.contacts())
        worst = max(abs(engine.wall(name).contact_force / target - 1.0) for name, target in target_forces().items())
        if ratio < balanced and worst < tolerance:
            return
        engine.run(steps, setup=True)
    raise ComputationError(
        f"the {what} does not come to rest in {LONGEST_SETTLING} more steps: unbalanced-force ratio {ratio:.2e}, wanted {balanced:g}, and "
        f"wall forces off by {worst:.2e}, wanted {tolerance:g}. More drag or more steps in its deck (pack.deck_variables) or a shorter "
        "loading.time_step_fraction help; a pack too loose to bear its stress wants a lower pack.porosity")


def unbalanced_force_ratio(engine: Engine, comm, contacts: Contacts) -> float:
    """Mean resultant force on a grain that is in contact, over the mean normal force of the contacts; collective."""
    touching = np.isin(engine.atom("id"), ids_in_contact(contacts.id, comm), kind="table")
    sums = np.array([
        np.linalg.norm(engine.atom("f")[touching], axis=1).sum(), touching.sum(), contacts.normal_force.sum(), len(contacts),
    ], dtype=float)  # fmt: skip
    force, grains, normal, count = comm.allreduce(sums)
    return float(force / max(grains, 1) / (normal / max(count, 1))) if normal > 0 else float("inf")


def ids_in_contact(pairs: np.ndarray, comm) -> np.ndarray:
    """Ids of the grains of all ranks that touch another grain; pairs: (M, 2) int64, the contacts of this rank."""
    here = np.zeros(int(pairs.max(initial=-1)) + 1, bool)
    here[pairs] = True
    ids = np.flatnonzero(here)
    return ids if comm.size == 1 else np.unique(np.concatenate(comm.allgather(ids)))
