"""The command `poreflow`: flow through the pores of a pack of grains, steady or in time, on any number of ranks."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from mpi4py import MPI

from flowsolver.command.formula import Formula
from flowsolver.command.run import run
from flowsolver.flow import TOLERANCE
from flowsolver.network import FACES, ComputationError, InputError

INPUT_ERROR, COMPUTATION_ERROR = 2, 3
#: What options of the linear solver begin with on PETSc's command line, and on this one.
PETSC_PREFIX = "-flow_"
_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


class _Parser(argparse.ArgumentParser):
    """All ranks see the same command line: rank 0 speaks, all leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().strip()}")

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def _formula(text: str) -> Formula:
    try:
        return Formula(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _face(text: str) -> tuple[str, Formula]:
    name, _, value = text.partition("=")
    if name not in FACES:
        raise argparse.ArgumentTypeError(f"{text!r}: expected FACE=VALUE with a face of {', '.join(FACES)}")
    return name, _formula(value)


def parser() -> argparse.ArgumentParser:
    p = _Parser(
        "poreflow",
        description="Flow through the pores of a pack of grains. SI units. A VALUE is a number, or a formula of x, y, z (m) and t (s) such as "
        '"1e5 * cos(3.14159 * x) * (t < 2)".',
        epilog="Options of PETSc's linear solver come last, as in: poreflow PACK ... -flow_ksp_monitor -flow_pc_type gamg",
    )
    # argparse alone would take -1e-3 for an option.
    p._negative_number_matcher = _NEGATIVE_NUMBER
    p.add_argument("pack", type=Path, help="text with x y z r on each line, or a LIGGGHTS or LAMMPS dump with x y z radius")
    p.add_argument("--box", type=float, nargs=6, metavar=("XLO", "XHI", "YLO", "YHI", "ZLO", "ZHI"), help="m; a dump brings its own")
    p.add_argument("--periodic", metavar="AXES", help='periodic directions, such as xz; the others have walls; a dump brings its own, "" is none')
    p.add_argument("--face", type=_face, action="append", default=[], metavar="FACE=VALUE", help="pressure at a wall, Pa; the others are closed")
    p.add_argument("--inflow", type=_face, action="append", default=[], metavar="FACE=VALUE", help="Darcy velocity into the box through a wall, m/s")
    p.add_argument("--point", type=float, nargs=4, action="append", default=[], metavar=("X", "Y", "Z", "PA"), help="pressure of the pore that holds a point")
    p.add_argument("--source", type=float, nargs=4, action="append", default=[], metavar=("X", "Y", "Z", "M3/S"), help="flow into the pore that holds a point")
    p.add_argument("--body-force", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"), help="on the fluid, Pa/m: of gravity, density times g")
    p.add_argument("--viscosity", type=float, default=1e-3, help="Pa s (default: water, 1e-3)")
    p.add_argument("--compressibility", type=float, default=4.5e-10, help="1/Pa, for flow in time (default: water, 4.5e-10)")
    p.add_argument("--conductance", choices=("duct", "hydraulic-radius"), default="duct")
    p.add_argument("--steady", action="store_true", help="the steady state (default unless --dt is given)")
    p.add_argument("--dt", type=float, help="time step, s")
    p.add_argument("--steps", type=int, default=1, help="number of time steps")
    p.add_argument("--explicit", action="store_true", help="explicit in time, within the stability limit")
    p.add_argument("--initial", type=_formula, default=Formula("0"), metavar="VALUE", help="pressure at the start, Pa")
    p.add_argument("--tolerance", type=float, default=TOLERANCE, help=f"relative, of the linear solver (default {TOLERANCE:g})")
    p.add_argument("--forces", type=Path, help="npz with id, force (n, 3) N, wall_force (6,) N")
    p.add_argument("--force-law", choices=("total", "pressure"), default="total")
    p.add_argument("--json", type=Path, help="report; else it is printed")
    p.add_argument("--history", type=Path, help="csv with time, pressures and outflows at the start and after each step")
    p.add_argument("--vtu", type=Path, help="pressures at the pores' centres, for ParaView")
    p.add_argument("--petsc", default="", metavar="OPTIONS", help='other options of PETSc, such as "-log_view"')
    return p


def parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line, with PETSc's own options, which begin with one dash, moved into `petsc`."""
    own, petsc = list(arguments), []
    first = next((k for k, word in enumerate(own) if word.startswith(PETSC_PREFIX)), len(own))
    own, petsc = own[:first], own[first:]
    for word in petsc:
        if word.startswith("--"):
            raise InputError(f"{word} stands after options of PETSc ({petsc[0]}): those come last")
        if word == "-flow_ksp_rtol":
            raise InputError("-flow_ksp_rtol would have no effect: give --tolerance")
    namespace = parser().parse_args(own)
    namespace.petsc = " ".join([namespace.petsc, *petsc]).strip()
    return namespace


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status, the same on all ranks: 0, 2 for bad input, 3 for a failed computation."""
    comm = MPI.COMM_WORLD
    try:
        run(comm, parsed(sys.argv[1:] if arguments is None else arguments))
    except (InputError, ComputationError) as error:
        if comm.rank == 0:
            print(f"poreflow: {error}", file=sys.stderr, flush=True)
        # Nobody leaves, and has the others ended by mpirun, before the message is out.
        comm.Barrier()
        return INPUT_ERROR if isinstance(error, InputError) else COMPUTATION_ERROR
    return 0
