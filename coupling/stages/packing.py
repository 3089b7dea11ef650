"""The pack stage: in.pack pushes the grains apart, and what the decks cannot express is done here between short runs.

A dense pack is made without friction, and its grains exchange sizes (coupling/stages/size_exchange.py) until the box of the wanted size
bears no more than the confining stress. In a pack looser than a random frictionless one, friction lets the forces rest on fewer
grains: the more of it, the more grains are left without contacts, and those are taken out. Either way the walls bear the confining
stress at the end, and grains without contacts are gone.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coupling.case.run_case import RunCase
from coupling.engine.interface import Engine
from coupling.scene.walls import PACK, wall_positions
from coupling.stages.balance import ids_in_contact, settle
from coupling.stages.deck_variables import pack_variables
from coupling.stages.pack import aimed_porosity, is_loose, packing_friction
from coupling.stages.size_exchange import exchange_sizes

#: Carried out after `in.pack`, from the same directory.
RELEASE_DECK = "in.pack_release"
#: Balance that the stage ends with, mean unbalanced force over mean contact force, and how far the walls' forces may be from their
#: targets. A pack without friction creeps on under the least difference of its stresses; the next stage, with friction, settles it.
BALANCED, WALL_TOLERANCE, LOOK_STEPS = 1e-2, 3e-2, 250
#: Floaters are deleted, and the box closes in after them, at most so often.
PASSES = 3
#: The box has the wanted volume when it is larger by this part at most; two thousandths are one of porosity.
VOLUME_TOLERANCE = 2e-3


class Packing:
    """One pack on one engine; all methods are collective."""

    def __init__(self, case: RunCase, engine: Engine, comm, deck: Path):
        self.case, self.engine, self.comm, self.deck = case, engine, comm, deck
        self.aim = aimed_porosity(case.pack, case.periodic_z)
        self.loose = is_loose(case.pack, case.periodic_z)
        self.walls = [name for name in PACK if not (case.periodic_z and name.startswith("z_"))]
        self.friction = packing_friction(case.pack, case.periodic_z)

    def make(self, grains: Path, count: int) -> dict:
        """Pack the grains of a data file, `count` of them; return what was reached."""
        engine = self.engine
        engine.deck(self.deck, pack_variables(self.case, grains), grains=count)
        if not self.loose:
            self._exchange_in_closed_box()
        if self.loose:
            engine.command("fix mu all property/global coefficientFriction peratomtypepair 3" + f" {self.friction:.17g}" * 9)
        engine.deck(self.deck.with_name(RELEASE_DECK), {}, grains=engine.total_grains)
        floaters = 0
        for _ in range(PASSES):
            self._close_in()
            self._settle()
            found = self._delete_floaters()
            floaters += found
            if found:
                self._settle()
            if self.loose or self._too_large() <= VOLUME_TOLERANCE:
                break
        targets = self.target_forces()
        return {
            "grains": engine.total_grains,
            "floaters": floaters,
            "walls": wall_positions(engine, self.walls),
            "size_m": self.size().tolist(),
            "porosity_aim": self.case.pack.porosity,
            "porosity": 1.0 - self._solid_volume() / float(self.size().prod()),
            "porosity_bulk": self._bulk_porosity(),
            "friction": self.friction,
            "stress_Pa": {name: self.case.pack.confining_stress_Pa * self.engine.wall(name).contact_force / target for name, target in targets.items()},
        }

    def size(self) -> np.ndarray:
        """Sides of the box, (3,) m."""
        lower, upper = self._corners()
        return upper - lower

    def _corners(self) -> tuple[np.ndarray, np.ndarray]:
        at = {"z_bottom": 0.0, "z_top": self.case.pack.box_m[2]} | wall_positions(self.engine, self.walls)
        return np.array([at[name] for name in PACK[::2]]), np.array([at[name] for name in PACK[1::2]])

    def target_forces(self) -> dict[str, float]:
        """Force that each wall is to bear, N by fix id."""
        size = self.size()
        area = dict(zip("xyz", size.prod() / size))
        return {name: self.case.pack.confining_stress_Pa * area[name[0]] for name in self.walls}

    def _exchange_in_closed_box(self) -> None:
        """Exchange sizes, by shorter and shorter steps, until the box of the wanted size bears the confining stress."""
        first, last = self._deck_number("exchange_first"), self._deck_number("exchange_last")
        for step in np.geomspace(first, last, int(self._deck_number("closed_rounds"))):
            exchange_sizes(self.engine, self.comm, self.walls, step)
            self.engine.run(int(self._deck_number("exchange_steps")), setup=True)
            targets = self.target_forces()
            if np.mean([self.engine.wall(name).contact_force / target for name, target in targets.items()]) < 1.0:
                return

    def _close_in(self) -> None:
        """Let the walls bear the confining stress, and make the pack denser while the box is larger than wanted."""
        rounds = int(self._deck_number("release_rounds"))
        for step in np.geomspace(self._deck_number("exchange_last"), self._deck_number("release_last"), rounds):
            if not self.loose and self._too_large() > 0.0:
                exchange_sizes(self.engine, self.comm, self.walls, step)
            self.engine.run(int(self._deck_number("release_steps")), setup=True)

    def _settle(self) -> None:
        settle(self.engine, self.comm, "pack", self.target_forces, balanced=BALANCED, tolerance=WALL_TOLERANCE, steps=LOOK_STEPS)

    def _too_large(self) -> float:
        """By what part the box is larger than its grains fill at the porosity aimed at."""
        return float(self.size().prod()) * (1.0 - self.aim) / self._solid_volume() - 1.0

    def _solid_volume(self) -> float:
        return self.comm.allreduce(float((4.0 / 3.0 * np.pi * self.engine.atom("radius") ** 3).sum()))

    def _bulk_porosity(self) -> float:
        """Porosity a mean diameter away from the walls."""
        inset = 2.0 * self.case.mean_radius_m * np.array([1.0, 1.0, 0.0 if self.case.periodic_z else 1.0])
        lower, upper = self._corners()
        solid = solid_volume_within(self.engine.atom("x"), self.engine.atom("radius"), lower + inset, upper - inset, self.case.periodic_z)
        return 1.0 - self.comm.allreduce(solid) / float((upper - lower - 2.0 * inset).prod())

    def _delete_floaters(self) -> int:
        """Delete the grains without a contact; return their number."""
        engine = self.engine
        floating = ~np.isin(engine.atom("id"), ids_in_contact(engine.contacts().id, self.comm))
        count = self.comm.allreduce(int(floating.sum()))
        if count:
            engine.atom("type")[floating] = 3
            engine.command("group floaters type 3")
            engine.delete_group("floaters")
            engine.command("group floaters delete")
            engine.run(0, setup=True)
        return count

    def _deck_number(self, name: str) -> float:
        """Value of a `variable ... index` line of the deck."""
        self.engine.command(f"variable driver_reads equal ${{{name}}}")
        return self.engine.variable("driver_reads")


def solid_volume_within(position: np.ndarray, radius: np.ndarray, lower, upper, periodic_z: bool) -> float:
    """Volume of spheres inside a box, m^3; overlaps count twice.

    position: (n, 3) m. radius: (n,) m. lower, upper: (3,) m. Exact for spheres that one face cuts; at edges and corners the parts
    that the faces leave are multiplied, which errs by a few per mille of those spheres.
    """
    part = np.ones(len(radius))
    for axis in range(2 if periodic_z else 3):
        below = np.clip((lower[axis] - position[:, axis]) / radius, -1.0, 1.0)
        above = np.clip((upper[axis] - position[:, axis]) / radius, -1.0, 1.0)
        # Part of a unit sphere below the plane at height h: (2 + 3 h - h^3) / 4.
        part *= (3.0 * (above - below) - (above**3 - below**3)) / 4.0
    return float((4.0 / 3.0 * np.pi * radius**3 * part).sum())
