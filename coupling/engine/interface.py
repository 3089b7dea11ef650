"""What the driver asks of a DEM engine.

LIGGGHTS fills it in ``coupling.engine.liggghts``; LAMMPS is to fill it with the same names. Arrays are views of the engine's own
memory, of this rank's own grains only, and hold until the next ``run``, ``command`` or ``file``: grains change their order
and their rank in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class WallState:
    """State of one ``fix wall/plane``, the same on all ranks.

    position: coordinate along the wall's axis, m. velocity: of that position, m/s. contact_force: of the grains on the wall
    against its normal, N, compression positive. fluid_force: what the driver set, N. contacts: number of grains that touch it.
    work: done by the wall on the grains since its definition, J. limited: steps at which the servo's speed was limited.
    """

    position: float
    velocity: float
    contact_force: float
    fluid_force: float
    contacts: int
    work: float
    limited: int


@dataclass(frozen=True)
class Contacts:
    """Contacts of this rank; over all ranks each contact stands once.

    id: (M, 2) int64. type: (M, 2) int32. bonded: (M,) bool. normal_force: (M,) N, compression positive.
    shear_force: (M, 3) N. overlap: (M,) m. point: (M, 3) m, the contact point. energy: (M,) J, of its springs.
    """

    id: np.ndarray
    type: np.ndarray
    bonded: np.ndarray
    normal_force: np.ndarray
    shear_force: np.ndarray
    overlap: np.ndarray
    point: np.ndarray
    energy: np.ndarray

    def __len__(self) -> int:
        return len(self.normal_force)

class Engine(Protocol):
    """A DEM engine on the ranks of a communicator."""

    #: number of grains of all ranks
    total_grains: int
    #: number of steps made since the last ``reset_timestep``
    step: int
    #: time step, s
    time_step: float

    def command(self, line: str) -> None:
        """Carry out one command of the deck language."""

    def deck(self, path: Path, variables: dict[str, object], grains: int) -> None:
        """Set index-style variables, then carry out the deck ``path``, which keeps them (``variable ... index``). ``grains`` is their number after it."""

    def define(self, variables: dict[str, object]) -> None:
        """Set index-style variables for the decks to come."""

    def run(self, steps: int, setup: bool) -> None:
        """Make ``steps`` steps. ``setup`` rebuilds the neighbour list and the forces first, as after any command."""

    def require_fix(self, fix_id: str, line: str) -> None:
        """Raise InputError, naming the deck, if it defines no fix of this id; line: what to write."""

    def acting_fixes(self) -> list[tuple[str, str]]:
        """Ids and styles of the fixes that take part in each step: those that put forces on grains, or move them."""

    def variable(self, name: str) -> float:
        """Value of an equal-style variable of the deck."""

    def atom(self, name: str) -> np.ndarray:
        """This rank's own values: ``id type mask`` (n,) int32; ``radius rmass`` (n,) float64; ``x v f omega torque`` (n, 3) float64."""

    def property_atom(self, fix_id: str) -> np.ndarray:
        """The array of ``fix property/atom ... vector``, (n, components) float64, in place."""

    def group_bit(self, name: str) -> int:
        """Bit of the group ``name`` in ``atom("mask")``."""

    def wall(self, fix_id: str) -> WallState:
        """State of a ``fix wall/plane``."""

    def set_wall_fluid_force(self, fix_id: str, force: float) -> None:
        """Fluid's force on the wall, N, pushing it outwards; a servo wall holds contact force + fluid force."""

    def couple_fluid(self, fix_id: str, step: tuple[int, int], groups: int, planes: dict[str, tuple[int, int]]) -> None:
        """Give `fix poreforce/two_way` its fluid: the addresses of a C function and of its first argument (`TwoWayCoupling.for_engine`).
        planes: fix id of each wall to the face that it stands on and the groups of grains, as bits, that it bears."""

    def contacts(self) -> Contacts:
        """Contacts as of the last step."""

    def take_breaks(self) -> np.ndarray:
        """Bonds broken since the last call, (n, 10) float64: step, id_i, id_j, mode (1 tension, 2 shear), x, y, z (m), F_n (N, compression
        positive), F_s (N), elastic energy released (J); over all ranks each bond stands once."""

    def intact_bonds(self) -> int:
        """Bonds of this rank that hold; over all ranks each bond counts once."""

    def unwrapped_position(self) -> np.ndarray:
        """Positions (n, 3) as if the box had no periodic boundary, m; a copy."""

    def has_property_atom(self, fix_id: str) -> bool:
        """Whether the deck defines `fix property/atom` with this id."""

    def delete_group(self, name: str) -> None:
        """Delete the grains of a group; ids of the others stay."""

    def write_restart(self, path: Path) -> None:
        """Write the engine's whole state to one file."""

    def close(self) -> None:
        """End the engine; it must not be used again."""
