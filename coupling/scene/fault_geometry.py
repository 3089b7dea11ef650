"""Where the fault lies: the gouge layer between the left and the right block, and distances across and along it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: Atom types of the decks.
LEFT, GOUGE, RIGHT = 1, 2, 3


@dataclass(frozen=True)
class FaultGeometry:
    """A plane layer of gouge through the centre of a box.

    lower, upper: (3,) corners of the box, m. dip_degrees: of the layer, from the horizontal; 90 makes its normal the x axis.
    width: of the layer across itself, m.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    dip_degrees: float
    width: float

    @property
    def centre(self) -> np.ndarray:
        """(3,) centre of the box, m."""
        return 0.5 * (np.array(self.lower) + np.array(self.upper))

    @property
    def normal(self) -> np.ndarray:
        """(3,) unit normal of the layer, from the left block to the right one."""
        dip = math.radians(self.dip_degrees)
        return np.array([math.sin(dip), 0.0, math.cos(dip)])

    @property
    def tangent(self) -> np.ndarray:
        """(3,) unit vector along the dip, downwards; the left block slips this way under horizontal compression."""
        dip = math.radians(self.dip_degrees)
        return np.array([math.cos(dip), 0.0, -math.sin(dip)])

    @property
    def x_wall_area(self) -> float:
        """Area of an x wall, m^2."""
        return (self.upper[1] - self.lower[1]) * (self.upper[2] - self.lower[2])

    def across(self, position: np.ndarray) -> np.ndarray:
        """Distance of points (n, 3) from the middle of the layer, m, positive towards the right block; (n,)."""
        return position @ self.normal - self.centre @ self.normal

    def x_on_interface(self, side: int, z: float) -> float:
        """x of the left (side = -1) or right (side = +1) interface at height z, m."""
        n = self.normal
        return float(self.centre[0] + (side * 0.5 * self.width - (z - self.centre[2]) * n[2]) / n[0])

    def block_face_length(self, block: int, z: float) -> float:
        """Length along x of a block's face at height z, from its x wall to its interface, m."""
        if block == LEFT:
            return self.x_on_interface(-1, z) - self.lower[0]
        return self.upper[0] - self.x_on_interface(+1, z)

    def solid_fraction(self, position: np.ndarray, radius: np.ndarray) -> float:
        """Fraction of the layer's volume that spheres (n, 3), (n,) fill, overlaps counted twice: exact for planes, and for a box
        whose faces cut no sphere. The layer is taken between the box's faces in y and z.
        """
        half = 0.5 * self.width
        distance = self.across(position)
        inside = _sphere_below(half - distance, radius) - _sphere_below(-half - distance, radius)
        size = np.array(self.upper) - np.array(self.lower)
        return float(inside.sum() / (self.width / self.normal[0] * size[1] * size[2]))


def _sphere_below(height: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Volume of spheres (n,) below a plane at `height` (n,) over their centres, m^3."""
    h = np.clip(height, -radius, radius)
    return np.pi / 3.0 * (2.0 * radius**3 + 3.0 * radius**2 * h - h**3)
