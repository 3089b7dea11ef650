"""The largest eigenvalue of a symmetric operator, by Lanczos' iteration; vectors may be spread over the ranks of a communicator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Without reorthogonalisation; the largest eigenvalue is known to some 1e-3 after as many.
STEPS = 60

Array = NDArray[np.float64]


def largest_eigenvalue(apply: Callable[[Array], Array], start: Array, comm: Any = None, steps: int = STEPS) -> float:
    """Largest eigenvalue of `apply`, from a vector `start` of any shape that is not orthogonal to its mode. Collective over comm, if given."""

    def dot(a: Array, b: Array) -> float:
        own = float((a * b).sum())
        return own if comm is None else comm.allreduce(own)

    q, before, beta = start / np.sqrt(dot(start, start)), np.zeros_like(start), 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    for _ in range(steps):
        y = apply(q) - beta * before
        diagonal.append(dot(q, y))
        y = y - diagonal[-1] * q
        beta = float(np.sqrt(dot(y, y)))
        if beta <= 1e-12 * abs(diagonal[0]):
            break
        beside.append(beta)
        before, q = q, y / beta
    beside = beside[: len(diagonal) - 1]
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))[-1])
