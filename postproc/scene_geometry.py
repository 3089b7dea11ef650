"""Where the box, the interfaces and the plates lie in the x-z plane, in mm, for figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .run_files import Grains, Run


@dataclass(frozen=True)
class Outline:
    """lower, upper: (3,) float64 corners of the box at the start of the loading, mm; dip: radians; width: of the gouge, mm."""

    lower: np.ndarray
    upper: np.ndarray
    dip: float
    width: float

    @property
    def size(self) -> np.ndarray:
        """(3,) mm."""
        return self.upper - self.lower

    @property
    def middle(self) -> np.ndarray:
        """(3,) mm."""
        return 0.5 * (self.lower + self.upper)

    def interface(self, side: int) -> tuple[np.ndarray, np.ndarray]:
        """x (2,) and z (2,), mm, of the left (-1) or right (+1) interface at the bottom and the top of the box.

        The interfaces are s = -width/2 and +width/2 with s = (x - x_m) sin(dip) + (z - z_m) cos(dip).
        """
        z = np.array([self.lower[2], self.upper[2]])
        return self.middle[0] + (0.5 * side * self.width - (z - self.middle[2]) * np.cos(self.dip)) / np.sin(self.dip), z

    @property
    def interfaces(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        return self.interface(-1), self.interface(+1)

    def across(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Distance from the middle of the gouge across it, mm, positive towards the right block."""
        return (x - self.middle[0]) * np.sin(self.dip) + (z - self.middle[2]) * np.cos(self.dip)

    def plates(self) -> list[tuple[float, float, float]]:
        """The plates on the four block faces: x from, x to, z, mm; the gouge's ends are free of them."""
        found = []
        for end, z in enumerate((self.lower[2], self.upper[2])):
            ends = [(self.lower[0], self.interface(-1)[0][end]), (self.interface(+1)[0][end], self.upper[0])]
            for first, last in np.clip(ends, self.lower[0], self.upper[0]):
                if last > first:
                    found.append((float(first), float(last), float(z)))
        return found


def outline(case: Mapping[str, object], grains: Grains | None) -> Outline:
    """From the grains at the start of the loading where there are any (the pack is compacted), else the box asked for."""
    if grains is not None and len(grains.radius):
        lower = 1e3 * (grains.position - grains.radius[:, None]).min(axis=0)
        upper = 1e3 * (grains.position + grains.radius[:, None]).max(axis=0)
    else:
        lower, upper = np.zeros(3), 1e3 * np.array(case["pack"]["box_m"], float)
    return Outline(lower, upper, float(np.radians(case["fault"]["dip_degrees"])), 1e3 * float(case["fault"]["gouge_width_m"]))


def is_upright(run: Run) -> bool:
    """Whether the run is of the scene with the upright fault, periodic along z, without plates."""
    return run.case.get("scene") == "supplement"
