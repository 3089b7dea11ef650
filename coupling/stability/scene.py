"""What a scene of the stability map is, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

#: How a scene can end. "stable": carried out, and sound by its figure. "refused", "stopped": caught by the program, before the first step or in the run;
#: "warned": carried out, with a warning on the screen and in the report. "failed": crashed, hung, or wrong without a word.
STABLE, REFUSED, STOPPED, WARNED, FAILED = "stable", "refused", "stopped", "warned", "failed"


@dataclass(frozen=True)
class Outcome:
    """What came of a scene. figure: that which says so, in words. found, predicted: a limit, where the scene has one, in `unit`. ranks: that it was
    carried out on."""

    ended: str
    figure: str
    found: float | None = None
    predicted: float | None = None
    unit: str = ""
    ranks: int = 1


@dataclass(frozen=True)
class Scene:
    """name: part of the program and setting, as in "grains/step/1.2/0.9". expected: how it may end. quick: a second or two. spread: its act itself is
    carried out by several ranks where asked for; runs of the program always are, and what looks at whole packs or matrices never is."""

    name: str
    what: str
    expected: tuple[str, ...]
    act: Callable[[Path], Outcome]
    quick: bool = False
    spread: bool = False


def limit(found: float, predicted: float, unit: str, figure: str, within: float) -> Outcome:
    """A limit that was found, stable if the one predicted lies below it and by no more than the share `within`."""
    sound = predicted * (1.0 - 0.01) <= found <= predicted * (1.0 + within)
    return Outcome(STABLE if sound else FAILED, figure, found, predicted, unit)


def bisected(stable: Callable[[float], bool], low: float, high: float, share: float = 0.01) -> float:
    """The largest number that is stable, between one that is and one that is not, to a share of itself; `low` or `high` if they are not."""
    if not stable(low):
        return low
    if stable(high):
        return high
    while high - low > share * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
