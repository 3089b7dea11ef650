"""Flow of a fluid through a pore network: steady, implicit and explicit, (7)-(13) of Yang & Juanes (2018)."""

from __future__ import annotations

import atexit
import difflib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray

from flowsolver.boundary import Boundary, Conditions
from flowsolver.checks import checked_array, checked_choice, checked_number, checked_type, checked_whole, shown
from flowsolver.native import load
from flowsolver.network import LEAST_OPEN_SHARE, LEAST_VOID_SHARE, ComputationError, ForceLaw, InputError, PoreNetwork
from flowsolver.plane_start import plane_through

# A rank is one thread. PETSc's vector operations would start others, which wait for work by spinning.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_native = load("poreslip_flow")
# PETSc must end before MPI does, which mpi4py ends after all functions that are registered here.
atexit.register(_native.finalize)

TOLERANCE = 1e-13
"""Default relative tolerance of the linear solver: the balance of mass closes as well as this, and pressures, forces and permeability are the same to
1e-9 on other numbers of ranks, of either law of conductance."""
LIMIT_SHARE = 0.9
"""Explicit steps take this share of their stability limit."""
STAGE = 1.0 - 0.5 * math.sqrt(2.0)
"""Length of each of the two stages of a step of second order, as a share of it: L-stable (Alexander 1977, SIAM J. Numer. Anal. 14, 1006)."""
MOST_SUBSTEPS = 1_000_000
PETSC_PREFIX = "flow_"
"""What the names of the linear solver's options begin with, after their dash."""
ROUNDING = 4e-16
"""Relative, of a pressure."""
LEAST_BALANCE, SMALLEST_FLOW = 1e-3, 1e-140
"""The share of the throughput that must not be missing; and the throughput, m^3/s, below which squares of flows are no numbers any more."""
USUAL_IMBALANCE = 10.0
"""A steady solve that leaves more than this times its tolerance of the balance of all pores, as a share of the throughput and before the shift that
closes it, is made closer. Of `duct` none did in the packs of tests/unit/test_flow_usual_imbalance.py; of `hydraulic-radius`, whose short throats
conduct far more than others, some leave more."""

ConductanceLaw = Literal["duct", "hydraulic-radius"]
CONDUCTANCE_LAWS = get_args(ConductanceLaw)


@dataclass(frozen=True)
class FlowResult:
    """One solve.

    pressure : (m,) float64, Pa, of all pores that this rank sees
    outflow : face to flow out of the box through it, m^3/s, over all ranks, and over the step; "points" for points and sources together, "inside" for
        the pores with a pressure given inside
    mass_residual : inflow - outflow - storage - volume rate of all free pores together, as a share of the throughput: of what given pressures,
        sources, volume rates and storage bring in and take out. Where that is below what tolerance and rounding leave open nothing flows, and it
        is a share of conductance times pressure, summed over all throats
    pore_residual : the same of each pore, the sum of the sizes: what the linear solver's tolerance leaves
    report : unknowns, isolated_pores, limited_pores, limited_throats, iterations, ksp_reason, residual, preconditioner_kept,
        imbalance (m^3/s, of all free pores together, that one shift of their pressures has closed), substeps, and this rank's seconds {assemble,
        setup, solve}; of a step in two stages iterations and seconds are of both
    rate : (m,) float64, Pa/s: dp/dt at the end of an implicit step; None of the others
    """

    pressure: NDArray[np.float64]
    outflow: dict[str, float]
    mass_residual: float
    report: dict[str, Any]
    rate: NDArray[np.float64] | None
    pore_residual: float


def tolerance_of(given: Any, faults: list[str]) -> float:
    """A tolerance of the linear solver, checked."""
    return checked_number("tolerance", given, lambda share: 0.0 < share < 1.0, "a number between 0 and 1", faults)


def time_of(given: Any, faults: list[str]) -> float:
    """Length of a step in s, checked."""
    return checked_number("dt", given, lambda step: 0.0 < step < math.inf, "a finite number above 0", faults, "s")


def _together(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """The report of two solves of one system."""
    seconds = {phase: first["seconds"][phase] + value for phase, value in second["seconds"].items()}
    return second | {
        "iterations": first["iterations"] + second["iterations"], "residual": max(first["residual"], second["residual"]),
        "preconditioner_kept": first["preconditioner_kept"] and second["preconditioner_kept"], "seconds": seconds,
    }  # fmt: skip


class _Balance(NamedTuple):
    """(7) at given pressures. supply : (m,) m^3/s, what must come from outside for every pore's balance to hold: through a face where the pressure is
    given, else 0; missing, of_each : m^3/s over all ranks, of it, over free pores, the sum's size and the sum of the sizes; throughput : m^3/s over
    all ranks."""

    supply: NDArray[np.float64]
    missing: float
    of_each: float
    throughput: float


class PoreFlow:
    """Flow through the pores of a `PoreNetwork`, which must have been updated before.

    Parameters
    ----------
    network
        Its grains' present places are taken up by `refresh`.
    viscosity : Pa s
    compressibility : 1/Pa
    conductance
        "duct": (6), C = 3 A^3 / (5 viscosity P^2); "hydraulic-radius": A R_h^2 / (2 viscosity) (Chareyre et al. 2012).
    least_open_share, least_void_share
        Limiter: a throat's open area counts as at least this share of its facet; a pore's void, for storage only, as at least
        this share of its cell. What it touches is counted in each report.
    petsc_options
        As on a PETSc command line; those of the linear solver begin with -flow_, as in "-flow_ksp_view -flow_pc_type gamg". The first
        solve refuses those that it has no use for.
    """

    def __init__(
        self,
        network: PoreNetwork,
        viscosity: float,
        compressibility: float = 0.0,
        conductance: ConductanceLaw = "duct",
        least_open_share: float = LEAST_OPEN_SHARE,
        least_void_share: float = LEAST_VOID_SHARE,
        petsc_options: str = "",
    ) -> None:
        faults: list[str] = []
        if not checked_type("network", network, PoreNetwork, faults):
            # Without a network no rank can tell the others.
            raise InputError(faults[0])
        viscosity = checked_number("viscosity", viscosity, lambda value: 0.0 < value < math.inf, "a finite number above 0", faults)
        compressibility, least_open_share, least_void_share = (
            checked_number(name, value, lambda value: 0.0 <= value < math.inf, "a finite number of 0 or more", faults)
            for name, value in (("compressibility", compressibility), ("least_open_share", least_open_share), ("least_void_share", least_void_share)))  # fmt: skip
        conductance = checked_choice("conductance", conductance, CONDUCTANCE_LAWS, faults)
        if not isinstance(petsc_options, str):
            faults.append(f'petsc_options is {shown(petsc_options)}: expected text, such as "-flow_pc_type gamg"')
        network.agree(
            faults, viscosity=viscosity, compressibility=compressibility, conductance=conductance, least_open_share=least_open_share,
            least_void_share=least_void_share, petsc_options=petsc_options)  # fmt: skip
        self.network = network
        self._unchecked_options = petsc_options
        self._native = _native.PoreFlow(
            network.native, viscosity, compressibility, conductance, least_open_share, least_void_share, petsc_options
        )
        self.refresh()

    def refresh(self, body_force: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Take up the network's present geometry. body_force : (3,) Pa/m, on the fluid, such as density times gravity."""
        faults: list[str] = []
        force = checked_array("body_force", body_force, np.float64, (3,), faults)
        if not np.isfinite(force).all():
            faults.append(f"body_force is {force}: expected finite numbers in Pa/m")
        self.network.agree(faults, body_force=force.tolist())
        self.body_force = force
        self._native.refresh([float(f) for f in force])

    def _check(self, faults: Sequence[str] = (), **alike: Any) -> None:
        """Raise InputError on all ranks for a fault on any, for what is not `alike` on all, or where this flow is that of pores which there are no more."""
        self._native.require_current()
        self.network.agree(faults, **alike)

    @property
    def conductance(self) -> NDArray[np.float64]:
        """(t,) float64, m^3/(Pa s), local: C / l of the throats that this rank owns (`network.owned_throats`), in order."""
        return self._native.conductance()

    @conductance.setter
    def conductance(self, value: ArrayLike) -> None:
        faults: list[str] = []
        array = checked_array("conductance", value, np.float64, self._native.conductance().shape, faults)
        if not (np.isfinite(array) & (array >= 0)).all():
            faults.append("conductance has entries that are negative or not finite")
        self.network.agree(faults)
        self._native.set_conductance(array)

    @property
    def storage(self) -> NDArray[np.float64]:
        """(m,) float64, m^3/Pa, local: compressibility times (limited) void volume of each pore."""
        return self._native.storage()

    def given(self, boundary: Boundary) -> NDArray[np.bool_]:
        """(m,) bool: pores whose pressure the boundary gives. Collective."""
        return Conditions.of(self.network, boundary).fixed

    def steady(
        self, boundary: Boundary, pressure: ArrayLike | None = None, volume_rate: ArrayLike | None = None, tolerance: float = TOLERANCE
    ) -> FlowResult:
        """Steady pressures. `pressure` (m,) Pa is the start of the iteration; where no pressure is given at any edge, its mean over the pores is kept, and
        so is it where nothing determines another. Default: 0, with an iteration that starts from a plane through the given pressures."""
        faults: list[str] = []
        tolerance = tolerance_of(tolerance, faults)
        self._check(faults, tolerance=tolerance)
        conditions = Conditions.of(self.network, boundary, pressure, volume_rate)
        self.network.agree([], pressure="none" if pressure is None else "given")
        start = plane_through(self.network, conditions.fixed, conditions.given) if pressure is None else None
        after, report = self._solve(conditions, conditions.given, 0.0, tolerance, start)
        balance = self._balance(conditions, after, None)
        missing, throughput = report["imbalance"], balance.throughput
        if missing > USUAL_IMBALANCE * tolerance * throughput:
            driven, whole = self._native.driven(after, None)
            if throughput > tolerance * driven + ROUNDING * whole:
                # Beside throats that conduct far more than others, the linear solver's residual is mostly theirs: once more, as much closer.
                closer = max(0.03 * tolerance * tolerance * throughput / missing, ROUNDING)
                after, again = self._solve(conditions, after, 0.0, closer)
                report = _together(report, again)
                balance = self._balance(conditions, after, None)
        return self._result(conditions, balance, after, after, None, report, tolerance)

    def implicit(
        self,
        boundary: Boundary,
        pressure: ArrayLike,
        dt: float,
        volume_rate: ArrayLike | None = None,
        tolerance: float = TOLERANCE,
        order: Literal[1, 2] = 1,
    ) -> FlowResult:
        """One step over `dt` (s) from `pressure` (m,) Pa. volume_rate (m,), m^3/s: dV/dt of the pores (`PoreNetwork.volume_rate`).

        order
            1: backward Euler (10)-(13). 2: in two stages of backward Euler, each STAGE of the step long, which damp what drains at once as well.
            In both the boundary gives what it does at the step's end.
        """
        faults: list[str] = []
        dt = time_of(dt, faults)
        if not isinstance(order, int | np.integer) or isinstance(order, bool) or order not in (1, 2):
            faults.append(f"order is {shown(order)}: expected 1 or 2")
        tolerance = tolerance_of(tolerance, faults)
        self._check(faults, dt=dt, tolerance=tolerance, order=order)
        conditions = Conditions.of(self.network, boundary, pressure, volume_rate)
        given, before = conditions.given, conditions.before
        if order == 1:
            after, report = self._solve(conditions, given, dt, tolerance)
            change = (after - before) / dt
            return self._result(conditions, self._balance(conditions, after, change), after, after, change, report, tolerance, change)
        stage = STAGE * dt
        midway, first = self._solve(conditions, given, stage, tolerance)
        from_first = before + (1.0 / STAGE - 1.0) * (midway - before)
        after, report = self._solve(conditions, np.where(conditions.fixed, given, from_first), stage, tolerance)
        flowing = midway + STAGE * (after - midway)
        report = _together(first, report)
        change, rate = (after - before) / dt, (after - from_first) / stage
        return self._result(conditions, self._balance(conditions, flowing, change), after, flowing, change, report, tolerance, rate)

    def explicit(
        self, boundary: Boundary, pressure: ArrayLike, dt: float, volume_rate: ArrayLike | None = None, most_substeps: int = MOST_SUBSTEPS
    ) -> FlowResult:
        """Explicit steps (9) over `dt` (s), as many as the stability limit asks for."""
        faults: list[str] = []
        dt, most_substeps = time_of(dt, faults), checked_whole("most_substeps", most_substeps, 1, faults)
        self._check(faults, dt=dt, most_substeps=most_substeps)
        conditions = Conditions.of(self.network, boundary, pressure, volume_rate)
        if self.storage.size and not (self.storage > 0).all():
            self.network.agree(["explicit flow needs a fluid with compressibility above 0"])
        self.network.agree([])
        after, flowing, report = self._native.step_explicit(
            conditions.fixed, conditions.given, conditions.source, conditions.volume_rate, dt, LIMIT_SHARE, most_substeps
        )
        change = (after - conditions.before) / dt
        return self._result(conditions, self._balance(conditions, flowing, change), after, flowing, change, report, ROUNDING)

    def forces(self, pressure: ArrayLike, law: ForceLaw = "total") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`PoreNetwork.forces` of pressures (m,) Pa, with the body force of the last `refresh`."""
        return self.network.forces(pressure, law, self.body_force)

    def darcy_velocity(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """(3,) float64, m/s: flow at these pressures, (m,) Pa, averaged over the box. Collective."""
        faults: list[str] = []
        pressures = checked_array("pressure", pressure, np.float64, (self.network.pores,), faults)
        self._check(faults)
        left, right, step = self._owned_throats()
        moved = (self.conductance * (pressures[left] - pressures[right] + step @ self.body_force)) @ step
        self.network.comm.Allreduce(MPI.IN_PLACE, moved)
        return moved / self.network.lengths.prod()

    def _solve(
        self, conditions: Conditions, pressure: NDArray[np.float64], dt: float, tolerance: float, start: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """One system, with what is given in the place of the pressures before; steady for dt = 0. start: of the iteration, by default the pressures before.
        The pressures, (m,) Pa, and a report."""
        after, report = self._native.solve(conditions.fixed, pressure, conditions.source, conditions.volume_rate, dt, tolerance, start)
        if self._unchecked_options and report["unknowns"]:
            self._check_options()
        return after, report

    def _result(self, conditions: Conditions, balance: _Balance, after: NDArray, flowing: NDArray, change: NDArray | None, report: dict[str, Any],
                tolerance: float, rate: NDArray | None = None) -> FlowResult:  # fmt: skip
        """A solve's result. after, flowing: (m,) Pa, at the end and those that the fluid flowed by; change: (m,) Pa/s, over the step, None: steady."""
        supply, missing, of_each, throughput = balance
        if missing > tolerance * throughput or throughput == 0.0:
            driven, whole = self._native.driven(flowing, change)
            if throughput <= tolerance * driven + ROUNDING * whole:
                throughput = whole
        if of_each > max(LEAST_BALANCE, 10 * tolerance) * throughput and throughput < SMALLEST_FLOW:
            raise ComputationError(
                f"{of_each:g} m^3/s of a throughput of {throughput:g} m^3/s are missing: flows are too small for the computer's numbers; look at the units of "
                "viscosity, pressures and box"
            )
        missing, of_each = (missing / throughput, of_each / throughput) if throughput > 0 else (0.0, 0.0)
        return FlowResult(after, conditions.outflow(supply), missing, report, rate, of_each)

    def _check_options(self) -> None:
        """Once the linear solver has asked for its options: refuse those that it did not ask for."""
        options, self._unchecked_options = self._unchecked_options, ""
        faults = []
        for name in _native.unused_options(options):
            own = name if name.startswith(PETSC_PREFIX) else PETSC_PREFIX + name
            known = _native.known_options()
            near = [own] if own in known and own != name else difflib.get_close_matches(own, known, 1)
            hint = f"did you mean -{near[0]}?" if near and near[0] != name else "leave it out"
            faults.append(f"-{name} is no option of this linear solver and preconditioner: {hint}")
        self.network.agree(faults)

    def _balance(self, conditions: Conditions, flowing: NDArray, change: NDArray | None) -> _Balance:
        return _Balance(*self._native.balance(conditions.fixed, conditions.source, conditions.volume_rate, flowing, change))

    def _owned_throats(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
        """Of this rank's own throats: pores on the left and right, (t,) each, and the step from one's centre to the other's, (t, 3) m."""
        left, right = self.network.pores_of_throat[self.network.owned_throats].T
        # Beside a wall the next pore's centre may be further off than half a period.
        centre = self.network.native.unwrapped_centre()
        return left, right, centre[right] - centre[left]
