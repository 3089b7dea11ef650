"""What callers give, looked at before the first collective call. Each function adds what is wrong to a list of faults, the argument, its value and
what was expected, and gives something of the right type in its place; `PoreNetwork.agree` then tells of the first fault on all ranks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Characters of a value in a message.
SHOWN = 80


def shown(value: Any) -> str:
    """A value in a message."""
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def checked_array(name: str, value: Any, dtype: type, shape: tuple[int | None, ...], faults: list[str]) -> NDArray[Any]:
    """`value` as a C-contiguous array; a wrong type or shape is added to `faults`."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:  # rows of unlike length
        faults.append(f"{name} is no array ({error})")
        return np.zeros(tuple(s or 0 for s in shape), dtype)
    wanted = "(" + ", ".join("n" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
    fits = array.ndim == len(shape) and all(s is None or s == a for s, a in zip(shape, array.shape))
    if not fits or not np.can_cast(array.dtype, dtype, casting="safe"):
        faults.append(f"{name} has shape {array.shape} and dtype {array.dtype}: expected {wanted} {np.dtype(dtype)}")
        return np.zeros(tuple(s or 0 for s in shape), dtype)
    if np.ma.is_masked(value):
        faults.append(f"{name} has masked entries: expected numbers in all of them")
    return np.ascontiguousarray(array, dtype)


def is_number(value: Any) -> bool:
    """Whether it is one real number that a float can hold, a truth value being none."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= sys.float_info.max
    return isinstance(value, float) or (isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0 and value.dtype.kind in "iuf" and not np.ma.is_masked(value))


def checked_number(name: str, value: Any, fits: Callable[[float], bool], expected: str, faults: list[str], unit: str = "") -> float:
    """`value` as a float for which `fits` holds."""
    if is_number(value) and fits(float(value)):
        return float(value)
    faults.append(f"{name} is {shown(value)}{f' {unit}' if unit and is_number(value) else ''}: expected {expected}")
    return 0.0


def checked_whole(name: str, value: Any, least: int, faults: list[str]) -> int:
    """`value` as a whole number, `least` or more."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= least:
        return int(value)
    faults.append(f"{name} is {shown(value)}: expected a whole number, {least} or more")
    return least


def checked_flag(name: str, value: Any, faults: list[str]) -> bool:
    """`value` as True or False."""
    if not isinstance(value, bool | np.bool_):
        faults.append(f"{name} is {shown(value)}: expected True or False")
        return False
    return bool(value)


def checked_choice(name: str, value: Any, known: Sequence[str], faults: list[str]) -> str:
    """`value`, one of some names."""
    if isinstance(value, str) and value in known:
        return value
    expected = " or ".join(f'"{one}"' for one in known) if len(known) == 2 else f"one of {', '.join(known)}"
    faults.append(f"{name} is {shown(value)}: expected {expected}")
    return known[0]


def checked_type(name: str, value: Any, kind: type, faults: list[str]) -> bool:
    """Whether `value` is an instance of `kind`."""
    if not isinstance(value, kind):
        faults.append(f"{name} is {shown(value)}: expected a {kind.__name__}")
    return isinstance(value, kind)
