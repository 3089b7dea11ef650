"""What a line of the history holds in the scene "sample": strains, stresses and pore pressures of a box of grains."""

from __future__ import annotations

import numpy as np

from coupling.case.run_case import RunCase
from coupling.case.schema import FACES, PACK
from coupling.engine.interface import Engine
from coupling.measures.fault import inertial_number, loading_rate
from coupling.scene.fault_geometry import FaultGeometry
from coupling.scene.walls import SceneWalls, wall_positions
from coupling.stages.balance import unbalanced_force_ratio

SAMPLE_COLUMNS = (
    "step", "time_s", "strain_x", "strain_y", "strain_z", "sigma_x_Pa", "sigma_y_Pa", "sigma_z_Pa",
    "contact_stress_x_Pa", "contact_stress_y_Pa", "contact_stress_z_Pa", "pressure_mean_Pa", "pressure_min_Pa", "pressure_max_Pa",
    *(f"outflow_{face}_m3_per_s" for face in FACES), "porosity", "coordination", "contact_force_mean_N", "contact_force_max_N",
    "unbalanced_force_ratio", "kinetic_energy_J", "mesh_rebuilds", "overlap_max_over_d", "inertial_number", "loading_rate",
    "contact_energy_J",
)  # fmt: skip


class SampleMeasures:
    """Measures of a sample, against its state when loading began. Strains are positive in compression; `sigma` is the total stress,
    the mean of both walls of a pair, and `contact_stress` the grains' part of it."""

    #: Nothing is carried from one line to the next.
    previous = None

    def __init__(self, case: RunCase, fault: FaultGeometry, walls: SceneWalls, reference: dict[str, float]):
        self._case, self._walls, self._reference = case, walls, reference
        motions = {name: case.sample.motion(name) for name in PACK}
        self._held = [(name[0], stress) for name, (kind, stress) in motions.items() if kind == "stress"]
        self._driven = tuple(name for name in PACK if case.sample.motion(name)[0] == "speed")

    def resume(self, previous: None) -> None:
        """Nothing is carried over from the line before a checkpoint."""

    @staticmethod
    def columns(case: RunCase) -> tuple[str, ...]:
        """Names of what a line of the history holds."""
        return SAMPLE_COLUMNS

    @staticmethod
    def reference(engine: Engine, comm, fault: FaultGeometry, walls: SceneWalls) -> dict[str, float]:
        """Sizes of the box along x, y, z, m, and volume of the grains, m^3."""
        solid = comm.allreduce(float((4.0 / 3.0 * np.pi * engine.atom("radius") ** 3).sum()))
        return dict(zip(("length", "depth", "height"), _size(engine).tolist())) | {"solid_volume": solid}

    def row(self, engine: Engine, comm, time: float, figures: dict[str, float]) -> dict[str, float]:
        """One line of the history, the same on all ranks; keys are SAMPLE_COLUMNS. figures: those of the flow."""
        from mpi4py import MPI

        state, size = self._walls.states(engine), _size(engine)
        areas = size.prod() / size
        contact = np.array([state[name].contact_force for name in PACK]).reshape(3, 2).mean(axis=1)
        fluid = np.array([state[name].fluid_force for name in PACK]).reshape(3, 2).mean(axis=1)
        strain = 1.0 - size / np.array([self._reference[name] for name in ("length", "depth", "height")])
        contacts, velocity = engine.contacts(), engine.atom("v")
        force = np.hypot(contacts.normal_force, np.linalg.norm(contacts.shear_force, axis=1))
        moving = 0.5 * float(engine.atom("rmass") @ (velocity**2).sum(axis=1))
        kinetic, total, count, stored, overlap = comm.allreduce(np.array([moving, force.sum(), len(force), contacts.energy.sum(), contacts.overlap.sum()]))
        largest = np.array([force.max(initial=0.0), contacts.overlap.max(initial=0.0)])
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        row = dict.fromkeys(SAMPLE_COLUMNS, 0.0) | figures | {"step": engine.step, "time_s": time}
        for axis, name in enumerate("xyz"):
            row[f"strain_{name}"] = strain[axis]
            row[f"contact_stress_{name}_Pa"] = contact[axis] / areas[axis]
            row[f"sigma_{name}_Pa"] = (contact[axis] + fluid[axis]) / areas[axis]
        row |= {
            "porosity": 1.0 - self._reference["solid_volume"] / size.prod(),
            "coordination": 2.0 * count / engine.total_grains,
            "contact_force_mean_N": total / max(count, 1.0),
            "contact_force_max_N": largest[0],
            "unbalanced_force_ratio": unbalanced_force_ratio(engine, comm, contacts),
            "kinetic_energy_J": kinetic,
            "overlap_max_over_d": largest[1] / (2.0 * self._case.mean_radius_m),
            "loading_rate": loading_rate(engine, self._driven, overlap / max(count, 1.0)),
            "contact_energy_J": stored,
        }
        closing = [abs(state[high].velocity - state[low].velocity) for low, high in zip(PACK[0::2], PACK[1::2])]
        mean_stress = sum(row[f"sigma_{name}_Pa"] for name in "xyz") / 3.0
        row["inertial_number"] = inertial_number(max(closing / size), 2.0 * self._case.mean_radius_m, self._case.pack.density_kg_m3, mean_stress)
        return {name: row[name] for name in SAMPLE_COLUMNS}

    def strain(self, engine: Engine) -> float:
        """Strain along z, positive in compression."""
        return float(1.0 - _size(engine)[2] / self._reference["height"])

    def progress(self, engine: Engine, time: float) -> float:
        """How far loading has gone, 0 to 1."""
        return time / self._case.sample.loading_time_s

    def quality(self, row: dict[str, float]) -> dict[str, float]:
        """Figures of a line whose largest values tell how nearly static the run was."""
        figures = {name: row[name] for name in ("unbalanced_force_ratio", "overlap_max_over_d", "inertial_number", "loading_rate", "kinetic_energy_J")}
        return figures | ({"held_stress_error": self._held_stress_error(row)} if self._held else {})

    def _held_stress_error(self, row: dict[str, float]) -> float:
        """By how much the stresses that walls hold are off where those walls are to have them by now, over the larger of theirs and the initial one."""
        sample = self._case.sample
        ramped = min(1.0, row["time_s"] / sample.ramp_time_s)
        errors = []
        for axis, last in self._held:
            wanted = sample.initial_stress_Pa + (last - sample.initial_stress_Pa) * ramped
            errors.append(abs(row[f"sigma_{axis}_Pa"] - wanted) / max(abs(wanted), sample.initial_stress_Pa))
        return max(errors)

    def ending(self, row: dict[str, float]) -> str | None:
        """A sample is loaded to its end."""
        return None

    def shortfall(self, row: dict[str, float]) -> str:
        """Nothing of what a sample is loaded by is known beforehand."""
        return ""

    def line(self, row: dict[str, float]) -> str:
        """What the progress line tells."""
        return f"strain z {row['strain_z']:.3e}  sigma z {row['sigma_z_Pa'] / 1e6:.2f} MPa  mean pressure {row['pressure_mean_Pa'] / 1e6:.3g} MPa"


def _size(engine: Engine) -> np.ndarray:
    """Sides of the box, (3,) m."""
    at = wall_positions(engine, PACK)
    return np.array([at[high] - at[low] for low, high in zip(PACK[0::2], PACK[1::2])])
