"""LIGGGHTS 3.8 through its C library: the one file that touches it.

Errors of the engine arrive as exceptions on all ranks (see ``guard.cpp``). Nothing is gathered: every array is this rank's own.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from coupling.engine.interface import Contacts, WallState
from coupling.errors import ComputationError, InputError
from coupling.native import library_path

MESSAGE_BYTES = 4096
#: Row lengths of poreslip_contacts and poreslip_take_breaks, see liggghts-inputs/styles/liggghts/poreslip_styles.h.
CONTACT_COLUMNS, BREAK_COLUMNS = 14, 10
RAISED_ON_ALL, RAISED_ON_ONE = 1, 2
#: What poreslip_contacts returns for a contact model that it cannot read.
NOT_LINEAR = -2
#: `image` of a grain that has crossed no periodic boundary: 512 in each of three fields of ten bits.
IN_THE_BOX = 512 << 20 | 512 << 10 | 512

_COLUMNS = {"x": 3, "v": 3, "f": 3, "omega": 3, "torque": 3}
_SCALARS = {"radius": np.float64, "rmass": np.float64, "density": np.float64}
_INTEGERS = {"id": np.int32, "type": np.int32, "mask": np.int32, "image": np.int32}


def _load() -> tuple[ctypes.CDLL, ctypes.CDLL]:
    """The guard first and globally, so that its Error members are the ones that LIGGGHTS binds; then our styles."""
    guard = ctypes.CDLL(str(library_path("libporeslip_engine_guard")), mode=ctypes.RTLD_GLOBAL)
    for name in ("lammps_extract_global", "lammps_extract_atom", "lammps_extract_fix"):
        getattr(guard, name).restype = ctypes.c_void_p
    styles = ctypes.CDLL(str(library_path("libporeslip_liggghts")))
    styles.poreslip_count_bonds.restype = ctypes.c_long
    return guard, styles


@contextmanager
def _silent() -> Iterator[None]:
    """Drop what LIGGGHTS prints past its own log: a second instance in a process warns of every contact model that it finds registered."""
    kept = [os.dup(1), os.dup(2)]
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        sys.stdout.flush()
        for number in (1, 2):
            os.dup2(sink, number)
        yield
    finally:
        for number, before in zip((1, 2), kept):
            os.dup2(before, number)
            os.close(before)
        os.close(sink)


class LiggghtsEngine:
    """One LIGGGHTS instance on ``comm``; see ``coupling.engine.interface.Engine``.

    log: the engine's own log file, written by rank 0.
    """

    def __init__(self, comm, log: Path):
        from mpi4py import MPI

        self.comm = comm
        self._mpi = MPI
        self._library, self._styles = _load()
        self._message = ctypes.create_string_buffer(MESSAGE_BYTES)
        self._lmp = ctypes.c_void_p()
        self._expected_grains: int | None = None
        #: Called after every command that succeeded; it may raise.
        self.between_commands: Callable[[], None] = _nothing
        self._deck: Path | None = None
        self._deck_has_run = False
        self._contact_rows = np.empty((0, CONTACT_COLUMNS))
        arguments = ["liggghts", "-nocite", "-log", str(log), "-screen", os.devnull]
        argv = (ctypes.c_char_p * len(arguments))(*(a.encode() for a in arguments))
        handle = ctypes.c_void_p.from_address(MPI._addressof(comm))
        self._guarded(self._library.poreslip_engine_open, len(arguments), argv, handle, ctypes.byref(self._lmp), silent=True)
        self._styles.poreslip_register_styles(self._lmp)

    # -- commands ---------------------------------------------------------------------------------------------------

    def command(self, line: str) -> None:
        self._guarded(self._library.poreslip_engine_command, self._lmp, line.encode())

    def deck(self, path: Path, variables: dict[str, object], grains: int) -> None:
        if not path.is_file():
            raise InputError(f"the deck {path} does not exist; copy all of liggghts-inputs into decks_directory, then change what you like")
        self.define(variables)
        self._deck, self._deck_has_run = path, False
        self._guarded(self._library.poreslip_engine_file, self._lmp, str(path).encode(), silent=True)
        self._expected_grains = grains
        self._count_grains()

    def define(self, variables: dict[str, object]) -> None:
        """Set index-style variables for the decks to come, which keep them."""
        for name, value in variables.items():
            self.command(f"variable {name} index {_deck_value(name, value)}")

    def run(self, steps: int, setup: bool) -> None:
        if not self._deck_has_run:
            self._refuse_grains_that_stand_still()
        self.command(f"run {steps} post no" if setup else f"run {steps} pre no post no")
        self._deck_has_run = True
        self._count_grains()

    def _refuse_grains_that_stand_still(self) -> None:
        """Collective. A deck that moves no grain would come to its end like one that does."""
        bits = self._library.poreslip_engine_moved_groups(self._lmp)
        still = self.comm.allreduce(int(np.count_nonzero(self.atom("mask") & bits == 0)))
        if still:
            raise InputError(
                f"the deck {self._deck} lets {still} of {self.total_grains} grains stand still whatever acts on them: no fix integrates their motion. Write "
                "`fix move all nve/sphere` in it, and hold grains, where you want that, with fix freeze or fix setforce")

    def acting_fixes(self) -> list[tuple[str, str]]:
        names = ctypes.create_string_buffer(MESSAGE_BYTES)
        self._library.poreslip_engine_acting_fixes(self._lmp, names, MESSAGE_BYTES)
        pairs = (line.split(" ", 1) for line in names.value.decode(errors="replace").splitlines())
        return [(fix_id, style) for fix_id, style in pairs]

    def require_fix(self, fix_id: str, line: str) -> None:
        """Raise InputError if the deck defines no fix of this id; line: what to write."""
        if not self._library.poreslip_engine_has_fix(self._lmp, fix_id.encode()):
            raise InputError(f"the deck {self._deck} defines no `fix {fix_id}`, which the driver needs; restore the line `{line}`")

    def _count_grains(self) -> None:
        if self._expected_grains is not None and self.total_grains != self._expected_grains:
            raise ComputationError(
                f"{self._expected_grains - self.total_grains} of {self._expected_grains} grains were lost by step {self.step}: they left "
                "the engine's box. Usually the time step is too long (loading.time_step_fraction) or a wall moves too fast "
                f"(loading.strain_rate_per_s); the last deck was {self._deck}")

    def variable(self, name: str) -> float:
        value = ctypes.c_double()
        self._guarded(self._library.poreslip_engine_variable, self._lmp, name.encode(), ctypes.byref(value))
        return value.value

    def _guarded(self, function, *arguments, silent: bool = False) -> None:
        with _silent() if silent else nullcontext():
            status = function(*arguments, self._message, MESSAGE_BYTES)
        if status == 0:
            self.between_commands()
            return
        self._lmp = ctypes.c_void_p()
        text = f"LIGGGHTS: {self._message.value.decode(errors='replace')}"
        # Much of what a deck says is looked at by the engine in the first run only.
        of_deck = self._deck is not None and not self._deck_has_run
        if of_deck:
            text += f"\n  in the deck {self._deck}, a file that it includes, or the first step with what they define"
        kind = InputError if of_deck else ComputationError
        if status == RAISED_ON_ONE and self.comm.size > 1:
            # The other ranks are inside the engine and will not come back: there is nothing to raise there.
            print(f"poreslip: {text}\n  raised on rank {self.comm.rank} alone; all ranks are stopped", file=sys.stderr, flush=True)
            self.comm.Abort(kind.exit_status)
        raise kind(text)

    # -- arrays -----------------------------------------------------------------------------------------------------

    def atom(self, name: str) -> np.ndarray:
        count = self.own_grains
        pointer = self._library.lammps_extract_atom(self._lmp, name.encode())
        if name in _COLUMNS:
            return _rows(pointer, count, _COLUMNS[name])
        return _view(pointer, (count,), (_SCALARS | _INTEGERS)[name])

    def property_atom(self, fix_id: str, components: int = 3) -> np.ndarray:
        pointer = self._library.lammps_extract_fix(self._lmp, fix_id.encode(), 1, 2, 0, 0)
        if not pointer:
            raise InputError(f"the deck {self._deck} defines no `fix {fix_id} all property/atom {fix_id} vector`, which the driver needs; restore the line")
        return _rows(pointer, self.own_grains, components)

    def group_bit(self, name: str) -> int:
        bit = self._library.poreslip_engine_group_bit(self._lmp, name.encode())
        if bit == 0:
            raise InputError(f"the deck {self._deck} defines no `group {name}`, which the driver needs for its measures; restore the line")
        return bit

    @property
    def own_grains(self) -> int:
        return self._global("nlocal", ctypes.c_int)

    @property
    def total_grains(self) -> int:
        return self._global("natoms", ctypes.c_int64)

    @property
    def step(self) -> int:
        return self._global("ntimestep", ctypes.c_int64)

    @property
    def time_step(self) -> float:
        return self._global("dt", ctypes.c_double)

    def _global(self, name: str, kind) -> int | float:
        return kind.from_address(self._library.lammps_extract_global(self._lmp, name.encode())).value

    # -- our styles ---------------------------------------------------------------------------------------------------

    def wall(self, fix_id: str) -> WallState:
        values = (ctypes.c_double * 7)()
        if self._styles.poreslip_wall_state(self._lmp, fix_id.encode(), values) != 0:
            raise InputError(f"the deck {self._deck} defines no `fix {fix_id} ... wall/plane`, which the driver needs for its measures; restore the line")
        position, velocity, contact_force, fluid_force, contacts, work, limited = values
        return WallState(position, velocity, contact_force, fluid_force, int(contacts), work, int(limited))

    def set_wall_fluid_force(self, fix_id: str, force: float) -> None:
        self._styles.poreslip_wall_set_fluid_force(self._lmp, fix_id.encode(), ctypes.c_double(force))

    def couple_fluid(self, fix_id: str, step: tuple[int, int], groups: int, planes: dict[str, tuple[int, int]]) -> None:
        names = (ctypes.c_char_p * len(planes))(*(name.encode() for name in planes))
        faces, parts = ((ctypes.c_int * len(planes))(*column) for column in zip(*planes.values()))
        function, fluid = (ctypes.c_void_p(address) for address in step)
        status = self._styles.poreslip_couple_fluid(self._lmp, fix_id.encode(), function, fluid, groups, len(planes), names, faces, parts)
        if status != 0:
            raise InputError(f"the deck {self._deck} lacks a `fix ... wall/plane` of {', '.join(planes)}, which the driver needs; restore the line")

    def contacts(self) -> Contacts:
        buffer = self._contact_rows
        count = self._styles.poreslip_contacts(self._lmp, buffer.ctypes, len(buffer))
        if count > len(buffer):
            self._contact_rows = buffer = np.empty((count + count // 4, CONTACT_COLUMNS))
            count = self._styles.poreslip_contacts(self._lmp, buffer.ctypes, len(buffer))
        if count == NOT_LINEAR:
            raise InputError(
                f"the deck {self._deck} has contacts of a model that the driver cannot read forces of: it reads linear springs with a memory of their shear. Write "
                "`pair_style gran model hooke/stiffness tangential history` (or `tangential bond`), with rolling friction or cohesion as you like")
        if count < 0:
            raise ComputationError("the contacts were asked for while the engine has no neighbour list: a run has to come first")
        rows = buffer[:count].copy()  # one copy in one piece: the fields are views of it
        ids, types = rows[:, 0:2].astype(np.int64), rows[:, 2:4].astype(np.int32)
        return Contacts(ids, types, rows[:, 4] != 0, rows[:, 5], rows[:, 6:9], rows[:, 9], rows[:, 10:13], rows[:, 13])

    def take_breaks(self) -> np.ndarray:
        rows = np.empty((self._styles.poreslip_break_count(self._lmp), BREAK_COLUMNS))
        self._styles.poreslip_take_breaks(self._lmp, rows.ctypes, len(rows))
        return rows

    def intact_bonds(self) -> int:
        return max(0, self._styles.poreslip_count_bonds(self._lmp))

    # -- the rest -----------------------------------------------------------------------------------------------------

    def delete_group(self, name: str) -> None:
        """Delete the grains of a group; ids of the others stay."""
        self.command(f"delete_atoms group {name} compress no")
        self._expected_grains = self.total_grains

    def unwrapped_position(self) -> np.ndarray:
        """Positions (n, 3) as if the box had no periodic boundary, m; a copy."""
        position = self.atom("x").copy()
        image = self.atom("image")
        if not np.all(image == IN_THE_BOX):
            packed = np.stack([image & 1023, (image >> 10) & 1023, image >> 20], axis=1)
            lower, upper = (np.array([self._global(f"box{axis}{end}", ctypes.c_double) for axis in "xyz"]) for end in ("lo", "hi"))
            position += (packed - 512) * (upper - lower)
        return position

    def has_property_atom(self, fix_id: str) -> bool:
        """Whether the deck defines `fix property/atom` with this id."""
        return bool(self._library.lammps_extract_fix(self._lmp, fix_id.encode(), 1, 2, 0, 0))

    def write_restart(self, path: Path) -> None:
        self.command(f"write_restart {_deck_value('restart', path)}")

    def close(self) -> None:
        if self._lmp:
            self._guarded(self._library.poreslip_engine_close, self._lmp)
            self._lmp = ctypes.c_void_p()


def _nothing() -> None:
    """Nothing to look at between commands."""


def _deck_value(name: str, value: object) -> str:
    """A value as the deck's `variable ... index` takes it: numbers with all their digits."""
    if isinstance(value, Path) and len(str(value).split()) != 1:
        raise InputError(f"the path {str(value)!r} ({name}) holds a blank, which LIGGGHTS cannot read in a deck; choose a directory without one")
    return f"{value:.17g}" if isinstance(value, float) else str(value)


def _view(pointer: int | None, shape: tuple[int, ...], kind) -> np.ndarray:
    """The engine's memory at ``pointer`` as an array."""
    count = int(np.prod(shape))
    if count == 0 or not pointer:
        return np.empty(shape, dtype=kind)
    buffer = (ctypes.c_char * (count * np.dtype(kind).itemsize)).from_address(pointer)
    return np.frombuffer(buffer, dtype=kind).reshape(shape)


def _rows(pointer: int | None, count: int, columns: int) -> np.ndarray:
    """The engine's two-dimensional array at ``pointer``, whose first row's address is that of the data."""
    first = ctypes.c_void_p.from_address(pointer).value if pointer and count else None
    return _view(first, (count, columns), np.float64)
