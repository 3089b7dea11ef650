"""The command `poreflow`: flow through the pores of a pack of grains, steady or in time, on any number of ranks."""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from mpi4py import MPI

from flowsolver.flow import FACES, TOLERANCE, Boundary, FlowResult, PoreFlow
from flowsolver.grain_file import read_grains
from flowsolver.network import ComputationError, InputError, PoreNetwork

INPUT_ERROR, COMPUTATION_ERROR = 2, 3


class _Parser(argparse.ArgumentParser):
    """All ranks see the same command line: rank 0 speaks, all leave."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().strip()}")

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


def _face(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    if name not in FACES:
        raise argparse.ArgumentTypeError(f"{text!r}: expected FACE=VALUE with a face of {', '.join(FACES)}")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: {value!r} is not a number") from None


def parser() -> argparse.ArgumentParser:
    p = _Parser("poreflow", description="Flow through the pores of a pack of grains. SI units.")
    p.add_argument("pack", type=Path, help="text with x y z r on each line, or a LIGGGHTS or LAMMPS dump with id x y z radius")
    p.add_argument("--box", type=float, nargs=6, metavar=("XLO", "XHI", "YLO", "YHI", "ZLO", "ZHI"), help="m; a dump brings its own")
    p.add_argument("--periodic", default="", metavar="AXES", help="periodic directions, such as xz; the others have walls")
    p.add_argument("--face", type=_face, action="append", default=[], metavar="FACE=PA", help="pressure at a wall; the others are closed")
    p.add_argument("--inflow", type=_face, action="append", default=[], metavar="FACE=M/S", help="Darcy velocity into the box through a wall")
    p.add_argument("--point", type=float, nargs=4, action="append", default=[], metavar=("X", "Y", "Z", "PA"), help="pressure of the pore nearest to a point")
    p.add_argument("--body-force", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"), help="on the fluid, Pa/m")
    p.add_argument("--viscosity", type=float, default=1e-3, help="Pa s (default: water, 1e-3)")
    p.add_argument("--compressibility", type=float, default=4.5e-10, help="1/Pa, for flow in time (default: water, 4.5e-10)")
    p.add_argument("--conductance", choices=("duct", "hydraulic-radius"), default="duct")
    p.add_argument("--steady", action="store_true", help="the steady state (default unless --dt is given)")
    p.add_argument("--dt", type=float, help="time step, s")
    p.add_argument("--steps", type=int, default=1, help="number of time steps")
    p.add_argument("--explicit", action="store_true", help="explicit in time, within the stability limit")
    p.add_argument("--initial", type=float, default=0.0, help="pressure at the start, Pa")
    p.add_argument("--tolerance", type=float, default=TOLERANCE, help="relative, of the linear solver")
    p.add_argument("--forces", type=Path, help="npz with id, force (n, 3) N, wall_force (6,) N")
    p.add_argument("--force-law", choices=("total", "pressure"), default="total")
    p.add_argument("--json", type=Path, help="report; else it is printed")
    p.add_argument("--vtu", type=Path, help="pressures at the pores' centres, for ParaView")
    p.add_argument("--petsc", default="", metavar="OPTIONS", help='such as "-flow_ksp_view -flow_pc_type gamg"')
    return p


def _share_out(comm: MPI.Comm, path: Path) -> tuple[Any, Any, Any, Any]:
    """Each rank's grains, in slabs of equal numbers along the pack's longest side; and the box of a dump."""
    slabs, fault, box = None, "", None
    if comm.rank == 0:
        try:
            grains = read_grains(path)
            box = grains.box
            axis = int(np.argmax(np.ptp(grains.position, axis=0)))
            order = np.argsort(grains.position[:, axis], kind="stable")
            slabs = [(grains.id[k], grains.position[k], grains.radius[k]) for k in np.array_split(order, comm.size)]
        except InputError as error:
            fault = str(error)
    if fault := comm.bcast(fault):
        raise InputError(fault)
    return (*comm.scatter(slabs), comm.bcast(box))


def _permeability(a: argparse.Namespace, lengths: np.ndarray, flow: PoreFlow, result: FlowResult) -> float | None:
    """k along the driven axis, m^2: from the drop between two opposite faces over the box, or from a body force along a period."""
    for axis in range(3):
        low, high = FACES[2 * axis : 2 * axis + 2]
        given = dict(a.face)
        if low in given and high in given and given[low] != given[high]:
            gradient = (given[low] - given[high]) / lengths[axis] + a.body_force[axis]
            through = 0.5 * (result.outflow[high] - result.outflow[low]) * lengths[axis] / lengths.prod()
            return a.viscosity * through / gradient if gradient else None
    driven = [axis for axis in range(3) if a.body_force[axis] and "xyz"[axis] in a.periodic]
    if len(driven) == 1:
        return float(a.viscosity * flow.darcy_velocity(result.pressure)[driven[0]] / a.body_force[driven[0]])
    return None


def run(comm: MPI.Comm, a: argparse.Namespace) -> dict[str, Any]:
    """Do what the command line asks for; the report."""
    start = time.perf_counter()
    if a.steps < 1:
        raise InputError(f"--steps is {a.steps}: expected 1 or more")
    if a.steady and a.dt is not None:
        raise InputError("--steady and --dt exclude each other")
    if set(a.periodic) - set("xyz"):
        raise InputError(f"--periodic is {a.periodic!r}: expected letters of xyz")
    ids, position, radius, box = _share_out(comm, a.pack)
    box = np.array(a.box) if a.box is not None else box
    if box is None:
        raise InputError("the pack has no box of its own: give --box XLO XHI YLO YHI ZLO ZHI")
    lower, upper = box[::2], box[1::2]
    network = PoreNetwork(comm, lower, upper, [axis in a.periodic for axis in "xyz"])
    clock = time.perf_counter()
    network.update(ids, position, radius)
    seconds = {"tessellate": time.perf_counter() - clock}

    clock = time.perf_counter()
    flow = PoreFlow(network, a.viscosity, a.compressibility, a.conductance, petsc_options=a.petsc)
    flow.refresh(a.body_force)
    owned = network.owned
    void = comm.allreduce(float(network.pore_volume[owned].sum()))
    seconds["geometry"] = time.perf_counter() - clock

    boundary = Boundary(dict(a.face), dict(a.inflow), [tuple(p) for p in a.point])
    pressure = np.full(network.pores, a.initial)
    iterations, phases, residual = 0, dict.fromkeys(("assemble", "setup", "solve"), 0.0), 0.0
    for _ in range(a.steps if a.dt is not None else 1):
        if a.dt is None:
            result = flow.steady(boundary, pressure, tolerance=a.tolerance)
        elif a.explicit:
            result = flow.explicit(boundary, pressure, a.dt)
        else:
            result = flow.implicit(boundary, pressure, a.dt, tolerance=a.tolerance)
        pressure = result.pressure
        iterations += result.report["iterations"]
        residual = max(residual, result.mass_residual) if result.mass_residual is not None else None
        for phase in phases:
            phases[phase] += result.report["seconds"][phase]
    seconds |= phases

    clock = time.perf_counter()
    force, wall_force = network.forces(pressure, a.force_law)
    seconds["forces"] = time.perf_counter() - clock
    sums = comm.allreduce(np.append(force.sum(axis=0), np.abs(force).sum()))
    unbalanced = np.abs(sums[:3] + wall_force[0, 1::2] - wall_force[0, ::2]).max()
    scale = sums[3] + np.abs(wall_force).sum()
    counts = network.report()
    seconds["total"] = time.perf_counter() - start
    report = {
        "grains": counts["grains"],
        "pores": counts["pores"],
        "throats": counts["throats"],
        "hidden_grains": counts["hidden_grains"],
        "porosity": void / float((upper - lower).prod()),
        "permeability": _permeability(a, upper - lower, flow, result),
        "outflow": result.outflow,
        "mass_residual": residual,
        "momentum_residual": float(unbalanced / scale) if scale > 0 and a.force_law == "total" else None,
        "limited_pores": result.report["limited_pores"],
        "limited_throats": result.report["limited_throats"],
        "isolated_pores": result.report["isolated_pores"],
        "iterations": iterations,
        "ksp_reason": result.report["ksp_reason"],
        "substeps": result.report["substeps"],
        "seconds": {name: comm.allreduce(value, op=MPI.MAX) for name, value in seconds.items()},
        "peak_memory_bytes": comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024),
        "ranks": comm.size,
    }
    _write(comm, a, report, ids, force, wall_force, network.pore_centre[owned], pressure[owned])
    return report


def _write(comm: MPI.Comm, a: argparse.Namespace, report: dict[str, Any], ids, force, wall_force, centre, pressure) -> None:
    forces = (comm.gather(ids), comm.gather(force)) if a.forces else None
    pores = (comm.gather(centre), comm.gather(pressure)) if a.vtu else None
    fault = ""
    if comm.rank == 0:
        try:
            if forces:
                order = np.argsort(np.concatenate(forces[0]))
                np.savez(a.forces, id=np.concatenate(forces[0])[order], force=np.concatenate(forces[1])[order], wall_force=wall_force[0])
            if pores:
                import meshio

                points = np.concatenate(pores[0])
                cells = [("vertex", np.arange(len(points))[:, None])]
                meshio.Mesh(points, cells, point_data={"pressure": np.concatenate(pores[1])}).write(a.vtu)
            if a.json:
                a.json.write_text(json.dumps(report, indent=1) + "\n")
            else:
                print(json.dumps(report, indent=1))
        except OSError as error:
            fault = f"cannot write: {error}"
    if fault := comm.bcast(fault):
        raise InputError(fault)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status, the same on all ranks: 0, 2 for bad input, 3 for a failed computation."""
    comm = MPI.COMM_WORLD
    try:
        run(comm, parser().parse_args(arguments))
    except (InputError, ComputationError) as error:
        if comm.rank == 0:
            print(f"poreflow: {error}", file=sys.stderr, flush=True)
        # Nobody leaves, and has the others ended by mpirun, before the message is out.
        comm.Barrier()
        return INPUT_ERROR if isinstance(error, InputError) else COMPUTATION_ERROR
    return 0
