"""Numbers that a user may also give as formulas of position and time, such as "1e5 * cos(3.14 * x) * exp(-t)"."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

NAMES = {"x": "m", "y": "m", "z": "m", "t": "s"}
_ALLOWED = (ast.Expression, ast.BinOp, ast.UnaryOp, ast.Compare, ast.Call, ast.Name, ast.Constant, ast.Load, ast.operator, ast.unaryop, ast.cmpop)
_OVER_PLACES = {"sum", "prod", "min", "max"}
_SHOWN = 80


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
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ValueError(f"{self._shown} is neither a number nor a formula of x, y, z and t") from None
        nodes = list(ast.walk(tree))
        for node in nodes:
            if not isinstance(node, _ALLOWED) or isinstance(node, ast.Constant) and not isinstance(node.value, (int, float)):
                raise ValueError(f"{self._shown} is not a number, and as a formula may hold only numbers, x, y, z, t, operators and functions")
        called = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        if over := called & _OVER_PLACES:
            raise ValueError(f"{self._shown}: {', '.join(sorted(over))} would be over the places at hand, which are other ones on each rank")
        if unknown := {node.id for node in nodes if isinstance(node, ast.Name)} - called - set(NAMES):
            raise ValueError(f"{self._shown} is not a number, and as a formula may name only x, y, z and t, not {', '.join(sorted(unknown))}")
        try:
            kind = self._evaluated(np.full((2, 3), 0.5), 0.5).dtype.kind
        except RecursionError:
            raise ValueError(f"{self._shown} is too long") from None
        except Exception as error:  # numexpr raises whatever its own evaluation met
            raise ValueError(f"{self._shown} cannot be evaluated ({error})") from None
        if kind not in "fib":
            raise ValueError(f"{self._shown} does not yield real numbers")

    @property
    def _shown(self) -> str:
        return repr(self.text if len(self.text) <= _SHOWN else self.text[:_SHOWN] + "...")

    @property
    def number(self) -> float | None:
        """The number, or None if the text is a formula."""
        try:
            return float(self.text)
        except ValueError:
            return None

    def everywhere(self, time: float) -> float | None:
        """The value at a time in s where places do not matter, as of 1e5 / 3 or 2 * t; None of a formula of x, y or z."""
        if self.number is not None:
            return self.number
        named = {node.id for node in ast.walk(ast.parse(self.text.strip(), mode="eval")) if isinstance(node, ast.Name)}
        return None if named & {"x", "y", "z"} else float(self.at(np.zeros((1, 3)), time)[0])

    def at(self, place: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """(k,) float64: values at places (k, 3) in m and a time in s."""
        if (number := self.number) is not None:
            return np.full(len(place), number)
        return np.array(np.broadcast_to(self._evaluated(place, time), len(place)), float)

    def _evaluated(self, place: NDArray[np.float64], time: float) -> NDArray[np.generic]:
        # Deferred: only a formula needs numexpr, which takes a tenth of a second to import.
        import numexpr

        values = dict(zip(NAMES, [*place.T, np.float64(time)]))
        return numexpr.evaluate(self._floating, local_dict=values, global_dict={})

    @cached_property
    def _floating(self) -> str:
        """The formula with whole numbers as float64: powers of those have no end, and their quotients none after the point."""
        tree = ast.parse(self.text.strip(), mode="eval")
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant):
                node.value = float(node.value)
        return ast.unparse(tree)
