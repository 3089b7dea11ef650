"""Numbers that a user may also give as formulas of position and time, such as "1e5 * cos(3.14 * x) * exp(-t)"."""

from __future__ import annotations

import ast
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NAMES = {"x": "m", "y": "m", "z": "m", "t": "s"}


@dataclass(frozen=True)
class Formula:
    """A number, or a formula of x, y, z (m) and t (s) as numexpr evaluates it."""

    text: str

    def __post_init__(self) -> None:
        """ValueError if the text is neither a number nor a formula of these names."""
        if self.number is not None:
            return
        try:
            tree = ast.parse(self.text.strip(), mode="eval")
        except (SyntaxError, ValueError):
            raise ValueError(f"{self.text!r} is neither a number nor a formula of x, y, z and t") from None
        called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        if unknown := {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - called - set(NAMES):
            raise ValueError(f"{self.text!r} is not a number, and as a formula may name only x, y, z and t, not {', '.join(sorted(unknown))}")
        try:
            kind = self.at(np.full((2, 3), 0.5), 0.5).dtype.kind
        except Exception as error:  # numexpr raises whatever its own evaluation met
            raise ValueError(f"{self.text!r} cannot be evaluated ({error})") from None
        if kind not in "fi":
            raise ValueError(f"{self.text!r} does not yield real numbers")

    @property
    def number(self) -> float | None:
        """The number, or None if the text is a formula."""
        try:
            return float(self.text)
        except ValueError:
            return None

    def at(self, place: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """(k,) float64: values at places (k, 3) in m and a time in s."""
        if (number := self.number) is not None:
            return np.full(len(place), number)
        # Deferred: only a formula needs numexpr, which takes a tenth of a second to import.
        import numexpr

        values = dict(zip(NAMES, [*place.T, np.float64(time)]))
        return np.array(np.broadcast_to(numexpr.evaluate(self.text.strip(), local_dict=values, global_dict={}), len(place)), float)
