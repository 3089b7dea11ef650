"""What the command `poreflow` does, from the grains' file to the report."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver.boundary import Boundary
from flowsolver.command import files
from flowsolver.command.formula import Formula
from flowsolver.command.grain_file import Grains, read_grains
from flowsolver.flow import FlowResult, PoreFlow
from flowsolver.network import FACES, InputError, PoreNetwork


def run(comm: MPI.Comm, a: argparse.Namespace) -> dict[str, Any]:
    """Do what the command line asks for; the report. Collective."""
    start, spent_before = time.perf_counter(), time.process_time()
    _check(a)
    files.check_places(comm, a.pack, {"--json": a.json, "--history": a.history, "--forces": a.forces, "--vtu": a.vtu})
    grains = read_grains(comm, a.pack)
    box, periodic = _box(comm, a, grains)
    if a.dt is None and not (a.face or a.point or a.inflow or a.source or any(a.body_force)):
        raise InputError("nothing drives a steady flow: give a pressure (--face, --point), an inflow (--inflow, --source) or --body-force; or --dt")
    lower, upper = box[::2], box[1::2]
    network = PoreNetwork(comm, lower, upper, periodic)
    _check_points(a, lower, upper)
    clock = time.perf_counter()
    network.update(grains.id, grains.position, grains.radius)
    seconds = {"tessellate": time.perf_counter() - clock}

    clock = time.perf_counter()
    flow = PoreFlow(network, a.viscosity, a.compressibility, a.conductance, petsc_options=a.petsc)
    flow.refresh(a.body_force)
    void = comm.allreduce(float(network.pore_volume[network.owned].sum()))
    seconds["geometry"] = time.perf_counter() - clock

    porosity = void / float((upper - lower).prod())
    if not 0.0 < porosity <= 1.0:
        raise InputError(f"the pack leaves {porosity:.6g} of the box to the fluid: its grains overlap more than pressed grains do")
    result, history, of_solver = _solve(a, network, flow)
    seconds |= of_solver
    owned, pressure = network.owned, result.pressure

    clock = time.perf_counter()
    force, wall_force = flow.forces(pressure, a.force_law)
    seconds["forces"] = time.perf_counter() - clock
    counts = network.report()
    report = {
        "grains": counts["grains"],
        "pores": counts["pores"],
        "throats": counts["throats"],
        "porosity": porosity,
        "permeability": _permeability(a, network, flow, result),
        "outflow": result.outflow,
        "mass_residual": result.mass_residual,
        "momentum_residual": _momentum_residual(comm, a, upper - lower, grains.radius, force, wall_force),
        "limited_pores": result.report["limited_pores"],
        "limited_throats": result.report["limited_throats"],
        "steps": a.steps,
        "iterations": result.report["iterations"],
        "ksp_reason": result.report["ksp_reason"],
    }
    _note(comm, counts["hidden_grains"], "grain lies inside another: it has no pore and feels no fluid", "grains lie inside others: they have no pore and feel no fluid")
    kept = "cut off from every given pressure: {} the pressure of the start, in the mean"
    _note(comm, result.report["isolated_pores"], f"pore is {kept.format('it keeps')}", f"pores are {kept.format('they keep')}")
    clock, spent_on_flow = time.perf_counter(), time.process_time()
    if a.forces:
        files.write_forces(comm, a.forces, grains.id, force, wall_force[0])
    if a.vtu:
        files.write_pressures(comm, a.vtu, network.pore_centre[owned], pressure[owned])
    if a.history:
        files.write(comm, a.history, files.history_as_csv(history))
    now, spent = time.perf_counter(), time.process_time()
    seconds |= {"files": now - clock, "total": now - start}
    # Last, so that nothing but the report itself is left out.
    report |= {
        "seconds": {name: comm.allreduce(value, op=MPI.MAX) for name, value in seconds.items()},
        "cpu_seconds": comm.allreduce(spent - spent_before),
        "cpu_seconds_files": comm.allreduce(spent - spent_on_flow),
        "peak_memory_bytes": comm.allreduce(_peak_memory()),
        "ranks": comm.size,
    }
    if a.json:
        files.write(comm, a.json, files.report_as_json(report))
    elif comm.rank == 0:
        print(json.dumps(report, indent=1))
    return report


def _tell(comm: MPI.Comm, text: str) -> None:
    if comm.rank == 0:
        print(f"poreflow: {text}", file=sys.stderr, flush=True)


def _note(comm: MPI.Comm, count: int, one: str, several: str) -> None:
    if count:
        _tell(comm, f"{count} {one if count == 1 else several}")


def _check(a: argparse.Namespace) -> None:
    """What can be told from the command line alone."""
    if a.steps < 1:
        raise InputError(f"--steps is {a.steps}: expected 1 or more")
    if a.dt is None and (a.explicit or a.steps > 1 or a.history):
        raise InputError(f"{'--explicit' if a.explicit else '--steps' if a.steps > 1 else '--history'} is of flow in time: give --dt")
    if a.explicit and "-flow_" in a.petsc:
        raise InputError("explicit steps have no linear solver: leave out the options -flow_...")
    if a.steady and a.dt is not None:
        raise InputError("--steady and --dt exclude each other")
    if set(a.periodic or "") - set("xyz"):
        raise InputError(f"--periodic is {a.periodic!r}: expected letters of xyz")
    for option, given in (("--face", a.face), ("--inflow", a.inflow)):
        names = [name for name, _ in given]
        if twice := {name for name in names if names.count(name) > 1}:
            raise InputError(f"{option} {twice.pop()} is given more than once")


def _check_points(a: argparse.Namespace, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> None:
    for option, points in (("--point", a.point), ("--source", a.source)):
        for point in points:
            if not ((lower <= point[:3]) & (point[:3] <= upper)).all():
                raise InputError(f"{option} {' '.join(f'{c:g}' for c in point)}: the point is outside the box")


def _box(comm: MPI.Comm, a: argparse.Namespace, grains: Grains) -> tuple[NDArray[np.float64], list[bool]]:
    """The box, (6,) m, and which directions are periodic: from the command line, else from the dump; where both tell and differ, a note."""
    own = grains.boundary and "".join(axis for axis, letters in zip("xyz", grains.boundary) if letters == "pp")
    periodic = own or "" if a.periodic is None else a.periodic
    if own is not None and set(own) != set(periodic):
        _tell(comm, f"{a.pack} is periodic in {own or 'no direction'} (BOX BOUNDS {' '.join(grains.boundary)}): taken is --periodic {periodic or 'of none'}")
    if a.box is None:
        if grains.box is None:
            raise InputError("the pack has no box of its own: give --box XLO XHI YLO YHI ZLO ZHI")
        if shrunk := "".join(axis for axis, letters in zip("xyz", grains.boundary or ()) if "s" in letters):
            raise InputError(f"the box of {a.pack} is shrunk onto its grains in {shrunk} (BOX BOUNDS {' '.join(grains.boundary)}), so that walls are elsewhere: give --box")
        box = grains.box
    else:
        box = np.array(a.box)
        if grains.box is not None and not np.array_equal(box, grains.box):
            _tell(comm, f"{a.pack} has a box of its own, {' '.join(f'{edge:.9g}' for edge in grains.box)} m: taken is --box")
    return box, [axis in periodic for axis in "xyz"]


def _at(value: Formula, time: float) -> Any:
    """A number, or a function of places (k, 3), at a time."""
    return value.number if value.number is not None else lambda place: value.at(place, time)


def _boundary(a: argparse.Namespace, time: float) -> Boundary:
    pressure, inflow = ({face: _at(value, time) for face, value in given} for given in (a.face, a.inflow))
    return Boundary(pressure, inflow, [tuple(p) for p in a.point], [tuple(p) for p in a.source])


def _solve(a: argparse.Namespace, network: PoreNetwork, flow: PoreFlow) -> tuple[FlowResult, list[dict[str, float]], dict[str, float]]:
    """The last solve, with the sum of all iterations and the worst residual; the history; seconds by phase."""
    pressure = a.initial.at(network.pore_centre, 0.0)
    network.agree([] if np.isfinite(pressure).all() else ["--initial does not yield a finite pressure in every pore"])
    means = _Means(network, pressure)
    history = [{"step": 0, "time": 0.0} | means.of(pressure)] if a.history else []
    iterations, worst, seconds = 0, 0.0, dict.fromkeys(("assemble", "setup", "solve"), 0.0)
    for step in range(1, a.steps + 1):
        if a.dt is None:
            # Pressures of 0 everywhere are those of a flow of which nothing is known.
            result = flow.steady(_boundary(a, 0.0), None if a.initial.number == 0 else pressure, tolerance=a.tolerance)
        else:
            # Backward Euler takes what is given at the step's end.
            boundary = _boundary(a, step * a.dt)
            if a.explicit:
                result = flow.explicit(boundary, pressure, a.dt)
            else:
                result = flow.implicit(boundary, pressure, a.dt, tolerance=a.tolerance)
        pressure = result.pressure
        iterations += result.report["iterations"]
        worst = max(worst, result.mass_residual)
        for phase in seconds:
            seconds[phase] += result.report["seconds"][phase]
        if a.history:
            outflow = {f"outflow_{face}": value for face, value in result.outflow.items()}
            history.append({"step": step, "time": step * a.dt} | means.of(pressure) | outflow)
    return dataclasses.replace(result, mass_residual=worst, report=result.report | {"iterations": iterations}), history, seconds


class _Means:
    """Means over the pores' volumes, for a line of the history.

    `amplitude`: how much of the deviation from the mean at the start is left, cov(p, p0) / var(p0); of a Fourier mode, its amplitude.
    """

    def __init__(self, network: PoreNetwork, initial: NDArray[np.float64]):
        self._comm, self._owned = network.comm, network.owned
        self._volume, self._initial = network.pore_volume[self._owned], 0.0
        self._initial = initial[self._owned] - self.of(initial)["pressure_mean"]

    def of(self, pressure: NDArray[np.float64]) -> dict[str, float]:
        """Pressures in Pa: mean, smallest, largest; and the amplitude, nan where all was even at the start."""
        p, v = pressure[self._owned], self._volume
        sums = np.array([v @ p, v.sum(), (v * p * self._initial).sum(), (v * self._initial**2).sum()])
        held, void, left, whole = self._comm.allreduce(sums)
        least = self._comm.allreduce(float(p.min(initial=np.inf)), op=MPI.MIN)
        most = self._comm.allreduce(float(p.max(initial=-np.inf)), op=MPI.MAX)
        return {"pressure_mean": held / void, "pressure_min": least, "pressure_max": most, "amplitude": left / whole if whole > 0.0 else float("nan")}


def _momentum_residual(
    comm: MPI.Comm,
    a: argparse.Namespace,
    lengths: NDArray[np.float64],
    radius: NDArray[np.float64],
    force: NDArray[np.float64],
    wall_force: NDArray[np.float64],
) -> float | None:
    """What grains and walls together bear beyond the push on the fluid, over the sum of all forces' sizes; None where (2) leaves out the drag."""
    sums = comm.allreduce(np.array([*force.sum(axis=0), np.abs(force).sum(), (4 / 3 * np.pi * radius**3).sum()]))
    push = (lengths.prod() - sums[4]) * np.array(a.body_force)
    unbalanced = np.abs(sums[:3] + wall_force[0, 1::2] - wall_force[0, ::2] - push).max()
    scale = sums[3] + np.abs(wall_force).sum()
    return float(unbalanced / scale) if scale > 0 and a.force_law == "total" else None


def _permeability(a: argparse.Namespace, network: PoreNetwork, flow: PoreFlow, result: FlowResult) -> float | None:
    """k along the driven axis, m^2: from the drop between two opposite faces over the box, or from a body force along a period. None where the fluid
    has other ways in or out as well."""
    end = 0.0 if a.dt is None else a.steps * a.dt
    given, lengths = {face: value.everywhere(end) for face, value in a.face}, network.lengths
    if a.inflow or a.point or a.source or len({face[0] for face in given}) > 1:
        return None
    for axis in range(3):
        low, high = (given.get(face) for face in FACES[2 * axis : 2 * axis + 2])
        if low is not None and high is not None and low != high:
            gradient = (low - high) / lengths[axis] + a.body_force[axis]
            through = 0.5 * (result.outflow[FACES[2 * axis + 1]] - result.outflow[FACES[2 * axis]]) * lengths[axis] / lengths.prod()
            return a.viscosity * through / gradient if gradient else None
    driven = [axis for axis in range(3) if a.body_force[axis] and network.periodic[axis]]
    if len(driven) == 1:
        return float(a.viscosity * flow.darcy_velocity(result.pressure)[driven[0]] / a.body_force[driven[0]])
    return None


def _peak_memory() -> int:
    """Largest resident memory of this process so far (Linux). getrusage would count that of the process which started it, too."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])
