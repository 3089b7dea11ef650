"""Strict structuring of what TOML holds: no text taken for a number, no number for a truth value, no number that is not finite, no unknown key."""

from __future__ import annotations

import math
from typing import Any

import cattrs


def number(value: Any, _: type = float) -> float:
    """A finite number as a float; ValueError if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


def exactly(value: Any, kind: type) -> Any:
    """A value of just this type; ValueError if it is none."""
    if type(value) is not kind:
        raise ValueError
    return value


def strict_converter() -> cattrs.Converter:
    """For dataclasses of numbers, whole numbers, texts and truth values."""
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook(float, number)
    for kind in (int, str, bool):
        converter.register_structure_hook(kind, exactly)
    return converter
