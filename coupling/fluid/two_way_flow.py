"""Two-way coupling: the fluid flows through the pores of the moving pack, its pressure pushes grains and walls, and they squeeze it.

Imported only by a run with flow.kind = "solve": it loads PETSc. Within an interval the pore network stands where it was at the
interval's start. In each step of the engine, once grains and walls are at their new places, `fix poreforce/two_way` has the pressures
answer, so that the forces are those of the place that the grains come to, as contact forces are; all of that is C++. The solve at the
interval's end takes up all that was swept.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from flowsolver.flow import Boundary, FlowResult, PoreFlow
from flowsolver.network import ComputationError as FlowFailed
from flowsolver.network import InputError as FlowRefused
from flowsolver.network import PoreNetwork
from flowsolver.transfer import carry_pressure
from flowsolver.two_way import TwoWayCoupling

from coupling.case.run_case import RunCase
from coupling.case.schema import FACES
from coupling.engine.interface import Engine
from coupling.errors import ComputationError
from coupling.fluid.exchange import Dry
from coupling.fluid.held_pressure import HeldPressure
from coupling.fluid.interval_error import IntervalError
from coupling.fluid.servo_checks import check_servos
from coupling.fluid.two_way_checks import check_undrained
from coupling.measures.pressure import around_grains
from coupling.results.phases import Phases
from coupling.scene.walls import GROUPS, SceneWalls

#: Names of flow.split as the flow solver has them.
SPLITS = {"undrained": "undrained", "predicted": "predicted", "staggered": "drained"}
#: Id of the fix that has the fluid answer the engine's steps.
FIX = "two_way"
STAGGERED_HINT = """
  With flow.split = "staggered" a run ends like this when the fluid is stiffer than the skeleton: set "undrained", or shorten flow.interval_steps"""


class TwoWayFlow(Dry):
    """A fluid that is coupled both ways with the grains; methods are collective.

    held: the pressures that are given, and those at the start. saved: arrays of `state` from a checkpoint, or none of them at the start.
    refuse_unstable: whether time steps and servos beyond the limits that are known beforehand are refused, at the start.
    """

    def __init__(self, case: RunCase, engine: Engine, comm, walls: SceneWalls, held: HeldPressure, lower, upper, phases: Phases,
                 saved: dict[str, np.ndarray], refuse_unstable: bool = True):  # fmt: skip
        super().__init__(engine, phases)
        self._case, self._comm, self._walls, self._fluid = case, comm, walls, case.fluid
        self._split, self._law = SPLITS[case.flow.split], case.flow.forces
        self.intervals = self._following = None
        if case.flow.interval_tolerance > 0.0:
            from coupling.fluid.following_intervals import FollowingIntervals

            self.intervals = self._following = FollowingIntervals(case)
        self._interval, self._last_step = case.flow.interval_steps, case.loading_steps
        self._error = IntervalError(comm, held.largest_change)
        self._box = np.array(lower), np.array(upper), (False, False, walls.periodic_z)
        self._always = case.flow.remesh == "always"
        self._held, self._refuses = held, refuse_unstable
        self._begin_anew(saved)
        self._result: FlowResult | None = None
        self._stored_before: float | None = None
        self._hint = STAGGERED_HINT if self._split == "drained" else ""
        # The forces of (2) alone balance neither momentum nor work.
        on_forces = ("momentum_residual", "work_residual") if self._law == "total" else ()
        self._worst = dict.fromkeys((*on_forces, "mass_residual", "remesh_mass_residual"), 0.0)
        self._prepare_engine()

    def _begin_anew(self, saved: dict[str, np.ndarray]) -> None:
        """Without mesh, linear solver and answer to the engine's steps, all of which the coming update makes."""
        self._saved = saved
        self._refuses = self._refuses and not saved
        self._network = PoreNetwork(self._comm, *self._box, self._case.flow.remesh_displacement * self._case.mean_radius_m)
        self._network.remember_previous()
        self._flow: PoreFlow | None = None
        self._pressure = self._drainage = np.zeros(0)
        self._coupling: TwoWayCoupling | None = None

    def _prepare_engine(self) -> None:
        self._engine.command(f"fix {FIX} all poreforce/two_way pore_force")

    # -- one interval ---------------------------------------------------------------------------------------------------

    def update(self, progress: float, strain: float, time: float) -> None:
        """Take up where the grains are now, with the pressures carried over, and set the forces of these pressures."""
        with self._failures_told():
            self._take_up()
            with self._phases.timed("forces"):
                self._begin()
                self._begin_error()
            if self._following:
                self._following.begin(self._engine.step)
            with self._phases.timed("exchange"):
                self._set_forces()
            self._walls_before, self._begun_at = self._walls.states(self._engine), self._engine.step
            if self._stored_before is None:
                self._stored_before = self._stored(self._pressure)
            self._measure_momentum()

    def advance(self, steps: int) -> None:
        """Make steps of the engine, and let the fluid flow where an interval ends."""
        self._make_steps(steps)
        step = self._engine.step
        if self._following.ends(step) if self._following else step % self._interval == 0 or step >= self._last_step:
            with self._failures_told(), self._phases.timed("flow"):
                self._exchange()

    def _set_forces(self) -> None:
        """Hand the forces over to the engine. The coming step begins with them, not with those that the last one ended with: half a step of the
        old ones would give back what the fluid lost in flowing, and drive the grains."""
        pore_force = self._engine.property_atom("pore_force")
        change = self._force - pore_force
        if held := self._walls.held_bit(self._engine):
            change[self._engine.atom("mask") & held != 0, 2] = 0.0
        self._engine.atom("f")[:] += change
        pore_force[:] = self._force
        self._walls.set_fluid_forces(self._engine, self._wall_force)

    def _make_steps(self, steps: int) -> None:
        before = self._coupling.seconds
        super().advance(steps)
        self._phases.shared("engine", {"forces": self._coupling.seconds - before})

    def _begin(self) -> None:
        """Begin an interval, in each of whose steps the engine calls the fluid, with the forces of the present pressures."""
        if self._coupling is None:
            held = self._held.boundary()
            if self._refuses:
                self._refuse_unstable(held)
            self._coupling = TwoWayCoupling(self._network, self._flow, held, self._pressure, self._split, self._case.flow.solver_tolerance, self._law, self._drainage)
            self._engine.couple_fluid(FIX, self._coupling.for_engine, len(GROUPS), self._walls.planes)
        else:
            self._coupling.begin(self._pressure, self._drainage)
        self._force, self._wall_force = self._coupling.forces()

    def _refuse_unstable(self, held: Boundary) -> None:
        if self._split != "drained":
            check_undrained(self._case, self._engine.atom("rmass"), self._network, self._flow, held)
        check_servos(self._case, self._network, self._flow, held, self._pressure, self._walls, self._walls.states(self._engine))

    def _exchange(self) -> None:
        """End the interval: the fluid flows, and the balance of its mass is drawn up."""
        with self._phases.timed("solve"):
            self._result = self._solve()
        report = self._result.report
        self._phases.shared("solve", {"assembly": report["seconds"]["assemble"]})
        self._pressure = self._result.pressure
        self._keep_worst("mass_residual", self._result.mass_residual)
        self.solver |= {
            "solves": self.solver.get("solves", 0) + 1,
            "iterations": self.solver.get("iterations", 0) + report["iterations"],
            "pore_residual_at_most": max(self.solver.get("pore_residual_at_most", 0.0), self._result.pore_residual),
            **{f"{name}_at_most": max(self.solver.get(f"{name}_at_most", 0), report[name])
               for name in ("iterations", "residual", "limited_pores", "limited_throats", "isolated_pores")},
        }  # fmt: skip

    def _solve(self) -> FlowResult:
        """The flow of an interval, after the balance of its work."""
        done, by_fluid, size = self._comm.allreduce(np.array(self._coupling.work))
        if size > 0.0 and self._law == "total":
            self._keep_worst("work_residual", abs(done - by_fluid) / size)
        on_walls = self._walls.fluid_work(self._walls_before, self._walls.states(self._engine))
        self._coupling.boundary = self._held.boundary()
        result = self._coupling.exchange()
        self._count_work(done - on_walls, on_walls, result)
        self._drainage = self._coupling.drainage
        owned = self._network.owned
        self._error.take(result.pressure[owned], self._coupling.lag[owned], self._network.pore_volume[owned])
        if self._following:
            self._following.learn(self._error.last)
        return result

    def _begin_error(self) -> None:
        if self._error.begun:
            return
        owned = self._network.owned
        self._error.begin(self._pressure[owned], self._network.pore_volume[owned])

    def _count_work(self, on_grains: float, on_walls: float, result: FlowResult) -> None:
        """Add an interval's work. Between constant pressures at faces that is not what was done on the grains, but the most that the fluid had to
        give: what came in with it, less what it stores, sum of beta V p^2 / 2, and what it did on the walls. Pressures that lag behind do more."""
        if self._case.scene == "sample":
            elapsed = (self._engine.step - self._begun_at) * self._engine.time_step
            on_grains = -elapsed * sum(pressure * result.outflow[face] for face, pressure in self._held.at_faces.items()) - on_walls
            stored = self._stored(result.pressure)
            self.work_on_grains -= stored - self._stored_before
            self._stored_before = stored
        if self._comm.rank == 0:
            self.work_on_grains += on_grains

    def _stored(self, pressure: np.ndarray) -> float:
        """Energy of the fluid in this rank's own pores, J."""
        return 0.5 * float((self._flow.storage * pressure**2)[self._network.owned].sum())

    # -- the mesh ---------------------------------------------------------------------------------------------------------

    def _take_up(self, rebuild: bool = False) -> None:
        """Move the network to where grains and walls are, and the pressures with it."""
        engine, network = self._engine, self._network
        pores_before = network.pores if self._flow else 0
        with self._phases.timed("tessellation"):
            self._id = engine.atom("id").copy()
            outcome = network.update(
                self._id, engine.atom("x"), engine.atom("radius"), wall_position=self._walls.positions(self._walls.states(engine)),
                group=engine.atom("type") - np.int32(1), rebuild=rebuild or self._always)
        with self._phases.timed("geometry"):
            if self._flow is None:
                self._flow = PoreFlow(network, self._fluid.viscosity_Pa_s, self._fluid.compressibility_per_Pa, self._fluid.conductance)
                self._pressure = self._restored("pressure") if self._saved else self._held.initial(network.pore_centre)
                self._drainage = self._restored("drainage") if self._saved else np.zeros(network.pores)
                self._saved = {}
                return
            if outcome != "kept":
                before = self._pressure
                self._pressure = carry_pressure(network, before, pores_before)
                predicted = self._split == "predicted"
                self._drainage = carry_pressure(network, self._drainage, pores_before) if predicted else np.zeros(network.pores)
                self._measure_carried(before)
            self._flow.refresh()

    def _measure_carried(self, before: np.ndarray) -> None:
        """Fluid gained in a change of mesh, sum of V p, as a share of sum of V |p|."""
        _, volume, index = self._network.native.previous()
        held = self._network.pore_volume * self._pressure
        owned = self._network.owned
        after, former, size = self._comm.allreduce(np.array([held[owned].sum(), volume @ before[index], np.abs(held[owned]).sum()]))
        if size > 0.0:
            self._keep_worst("remesh_mass_residual", abs(after - former) / size)

    def _measure_momentum(self) -> None:
        """Resultant of the fluid's forces on all grains and walls, over the sum of their sizes; the law (2) alone has no such balance."""
        if self._law != "total":
            return
        sums = self._comm.allreduce(np.append(self._force.sum(axis=0), np.linalg.norm(self._force, axis=1).sum()))
        resultant = sums[:3] + (self._wall_force[:, 1::2] - self._wall_force[:, 0::2]).sum(axis=0)
        size = sums[3] + np.abs(self._wall_force).sum()
        if size > 0.0:
            self._keep_worst("momentum_residual", float(np.linalg.norm(resultant) / size))

    # -- checkpoints ------------------------------------------------------------------------------------------------------

    def state(self) -> dict[str, np.ndarray]:
        """Pressures by the ids of each pore's grains, on a mesh made anew here, as the run that starts from the checkpoint makes it."""
        with self._failures_told():
            self._take_up()
            self._take_up(rebuild=True)
        owned = self._network.owned
        parts = self._comm.gather((np.sort(self._network.grains_of_pore[owned], axis=1), self._pressure[owned], self._drainage[owned]))
        if parts is None:
            return {}
        return dict(zip(("grains_of_pore", "pressure", "drainage"), (np.concatenate(column) for column in zip(*parts))))

    def synchronise(self, saved: dict[str, np.ndarray]) -> None:
        """Begin anew as a run does that starts from this point's checkpoint: the order of pores, what the linear solver kept, and with them the
        last bits, are the same in both."""
        counts = self.counts()
        self._begin_anew(saved)
        self.resume(counts)

    def counts(self) -> dict[str, dict[str, float]]:
        following = {"intervals": self._following.state()} if self._following else {}
        return super().counts() | {"interval_error": self._error.state(), "stored": {"J": self._comm.allreduce(self._stored_before)}} | following

    def resume(self, counts: dict[str, dict[str, float]]) -> None:
        """Go on counting from a checkpoint."""
        super().resume(counts)
        self._error.resume(counts["interval_error"])
        # Of all ranks; of this one's pores none are known before the coming update.
        self._stored_before = counts["stored"]["J"] if self._comm.rank == 0 else 0.0
        if self._following:
            self._following.resume(counts["intervals"])

    def _restored(self, name: str) -> np.ndarray:
        """(m,): the checkpoint's "pressure" (Pa) or "drainage" (Pa/s) on the present mesh."""
        wanted = np.sort(self._network.grains_of_pore, axis=1)
        saved = self._saved["grains_of_pore"]
        _, place = np.unique(np.concatenate([saved, wanted]), axis=0, return_inverse=True)
        place = place.ravel()
        value = np.full(place.max() + 1, np.nan)
        value[place[: len(saved)]] = self._saved[name]
        values = value[place[len(saved) :]]
        missing = self._comm.allreduce(int(np.isnan(values).sum()))
        if missing:
            raise ComputationError(f"{missing} pores of the mesh at step {self._engine.step} are not in the checkpoint: run the case from its start")
        return values

    # -- what is told -----------------------------------------------------------------------------------------------------

    @property
    def residuals(self) -> dict[str, float]:
        """Balances of momentum; of work and mass over the worst interval; of mass in the worst change of mesh."""
        return dict(self._worst)

    def interval_figures(self) -> dict[str, float]:
        return self._error.figures | (self._following.lengths if self._following else {})

    def figures(self, progress: float, strain: float, time: float) -> dict[str, float]:
        """Mean pressure over the pores' volumes, and the extremes, Pa; and what belongs to the scene."""
        from mpi4py import MPI

        owned = self._network.owned
        volume, pressure = self._network.pore_volume[owned], self._pressure[owned]
        held, void = self._comm.allreduce(np.array([volume @ pressure, volume.sum()]))
        lowest = self._comm.allreduce(float(pressure.min(initial=np.inf)), op=MPI.MIN)
        highest = self._comm.allreduce(float(pressure.max(initial=-np.inf)), op=MPI.MAX)
        figures = {"pressure_mean_Pa": held / void, "pressure_min_Pa": lowest, "pressure_max_Pa": highest}
        return figures | self._held.figures(self._network, self._pressure, self._result.outflow if self._result else {})

    def grain_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        return self._id, around_grains(self._network, self._pressure, self._id)

    def report(self) -> dict:
        """Counts and times of network and solver; permeability along the driven axis where two opposite faces have pressures."""
        report = dict(self._network.report())
        if self._result:
            report["solver"] = dict(self._result.report)
            report["outflow_m3_per_s"] = dict(self._result.outflow)
        if self._result:
            report |= self._permeability()
        return report

    def _permeability(self) -> dict[str, float]:
        """Along an axis whose two faces, and no others, are held at different pressures; collective."""
        given = self._held.at_faces
        for axis in range(3):
            low, high = FACES[2 * axis : 2 * axis + 2]
            if set(given) == {low, high} and given[low] != given[high]:
                position = self._walls.positions(self._walls.states(self._engine))
                size = position[0, 1::2] - position[0, 0::2]
                velocity = 0.5 * (self._result.outflow[high] - self._result.outflow[low]) / (size.prod() / size[axis])
                permeability = self._fluid.viscosity_Pa_s * velocity * size[axis] / (given[low] - given[high])
                void = self._comm.allreduce(float(self._network.pore_volume[self._network.owned].sum()))
                storage = self._fluid.compressibility_per_Pa * void / size.prod()
                # t_p of the paper's Discussion: pressure diffuses through the box.
                return {"permeability_m2": permeability, "pressure_diffusion_time_s": size[axis] ** 2 * self._fluid.viscosity_Pa_s * storage / permeability}
        return {}

    def _keep_worst(self, name: str, value: float) -> None:
        self.final[name] = float(value)
        self._worst[name] = max(self._worst[name], float(value))

    @contextmanager
    def _failures_told(self) -> Iterator[None]:
        """Errors of the flow solver as those of a computation: the case was good when loading began."""
        try:
            yield
        except (FlowRefused, FlowFailed) as error:
            raise ComputationError(f"the flow cannot be computed at step {self._engine.step}: {error}{self._hint}") from None
