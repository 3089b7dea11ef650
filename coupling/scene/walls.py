"""The plane walls of a scene: which fix each one is, what it bears, and where the flow's boundary stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coupling.case.schema import PACK
from coupling.engine.interface import Engine, WallState
from coupling.scene.fault_geometry import GOUGE, LEFT, RIGHT

GROUPS = (LEFT, GOUGE, RIGHT)

#: Fix ids of the decks, with the face that each stands on and the parts of the pack that it bears.
TWO_SIDES = {
    "x_left": (0, GROUPS), "x_right": (1, GROUPS), "y_front": (2, GROUPS), "y_back": (3, GROUPS),
    "z_bottom_left": (4, (LEFT,)), "z_top_left": (5, (LEFT,)), "z_bottom_right": (4, (RIGHT,)), "z_top_right": (5, (RIGHT,)),
    "z_bottom_gouge": (4, (GOUGE,)), "z_top_gouge": (5, (GOUGE,)),
}  # fmt: skip
SUPPLEMENT = {name: TWO_SIDES[name] for name in ("x_left", "x_right", "y_front", "y_back")}
SAMPLE = {name: (face, GROUPS) for face, name in enumerate(PACK)}
SCENE_WALLS = {"two_sides": TWO_SIDES, "supplement": SUPPLEMENT, "sample": SAMPLE}


@dataclass(frozen=True)
class Stresses:
    """Total stresses on the walls, Pa, compression positive, and the sizes they follow from, m."""

    left: float
    right: float
    vertical: float
    length: float
    height: float


class SceneWalls:
    """The walls of one scene.

    lower, upper: (3,) corners of the box when loading began, m: the faces of the gouge, whose ends are held, stay there.
    plate_areas: area of each plate's block face, m^2, by fix id.
    """

    def __init__(self, scene: str, lower, upper, plate_areas: dict[str, float]):
        self.plates = SCENE_WALLS[scene]
        self.periodic_z = scene == "supplement"
        self._lower, self._upper = tuple(lower), tuple(upper)
        self._plate_areas = plate_areas
        self._depth = self._upper[1] - self._lower[1]

    @property
    def x_wall_area(self) -> float:
        """Of either x wall when loading began, m^2."""
        return self._depth * (self._upper[2] - self._lower[2])

    def states(self, engine: Engine) -> dict[str, WallState]:
        """State of every wall by fix id."""
        return {name: engine.wall(name) for name in self.plates}

    def stresses(self, state: dict[str, WallState]) -> Stresses:
        """Total stress on the x walls and on the plates: contact force and fluid force over their areas."""

        def borne(name: str) -> float:
            return state[name].contact_force + state[name].fluid_force

        length = state["x_right"].position - state["x_left"].position
        if self.periodic_z:
            height = self._upper[2] - self._lower[2]
            return Stresses(*(borne(n) / (self._depth * height) for n in ("x_left", "x_right")), 0.0, length, height)
        heights = [state[f"z_top_{side}"].position - state[f"z_bottom_{side}"].position for side in ("left", "right")]
        horizontal = [borne(f"x_{side}") / (self._depth * height) for side, height in zip(("left", "right"), heights)]
        vertical = sum(borne(name) for name in self._plate_areas) / sum(self._plate_areas.values())
        return Stresses(*horizontal, vertical, length, float(np.mean(heights)))

    def positions(self, state: dict[str, WallState]) -> np.ndarray:
        """(3, 6) m: where the flow's boundary stands for the grains of either block and of the gouge, by FACES."""
        table = np.tile(np.array([self._lower, self._upper]).T.reshape(6), (3, 1))
        for name, (face, parts) in self.plates.items():
            for part in parts:
                table[part - 1, face] = state[name].position
        return table

    @property
    def planes(self) -> dict[str, tuple[int, int]]:
        """Face of each wall, and the parts that it bears as bits, by fix id."""
        return {name: (face, sum(1 << (part - 1) for part in parts)) for name, (face, parts) in self.plates.items()}

    def gaps(self, engine: Engine, state: dict[str, WallState]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """For each wall, by fix id: distances inwards from its plane, (k,) m, of the centres of those of this rank's grains that it bears and that
        are nearer than the largest radius, and their radii, (k,) m."""
        x, radius, kind = engine.atom("x"), engine.atom("radius"), engine.atom("type")
        reach = radius.max(initial=0.0)
        for name, (face, parts) in self.plates.items():
            inwards = x[:, face // 2] - state[name].position
            if face % 2:
                inwards = -inwards
            near = np.flatnonzero(inwards < reach)
            near = near[np.isin(kind[near], parts)]
            yield name, inwards[near], radius[near]

    def fluid_work(self, before: dict[str, WallState], after: dict[str, WallState]) -> float:
        """Work of the fluid on the walls between two states, J, by the trapezoidal rule."""
        outwards = {name: -1.0 if face % 2 == 0 else 1.0 for name, (face, _) in self.plates.items()}
        return sum(0.5 * (before[name].fluid_force + after[name].fluid_force) * sign * (after[name].position - before[name].position)
                   for name, sign in outwards.items())

    def set_fluid_forces(self, engine: Engine, wall_force: np.ndarray) -> None:
        """Hand the fluid's forces (3, 6) N, outwards, by part and face, to the walls that bear them."""
        for name, (face, parts) in self.plates.items():
            engine.set_wall_fluid_force(name, float(sum(wall_force[part - 1, face] for part in parts)))

    def held_bit(self, engine: Engine) -> int:
        """Bit of the grains whose motion is held in a direction, and whose forces therefore do not balance."""
        return engine.group_bit("gouge_ends") if self.plates is TWO_SIDES else 0


def wall_positions(engine: Engine, names) -> dict[str, float]:
    """Coordinates of walls along their axes, m, by fix id."""
    return {name: engine.wall(name).position for name in names}
