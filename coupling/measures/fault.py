"""What a line of the history holds: stresses on the walls, slip on the interfaces, contacts, balance of forces."""

from __future__ import annotations

import math

import numpy as np

from coupling.case.run_case import RunCase
from coupling.engine.interface import Engine
from coupling.measures.pressure import BAND_DIAMETERS
from coupling.scene.fault_geometry import GOUGE, LEFT, RIGHT, FaultGeometry
from coupling.scene.walls import SceneWalls, wall_positions

HISTORY_COLUMNS = (
    "step", "time_s", "strain", "vertical_strain", "sigma_h_left_Pa", "sigma_h_right_Pa", "sigma_v_Pa", "sigma_n_Pa",
    "p_left_Pa", "p_right_Pa", "vertical_strain_rate_per_s", "slip_left_m", "slip_right_m", "bonds_intact",
    "bonds_broken_tension", "bonds_broken_shear", "coordination_gouge", "contacts_gouge", "porosity_gouge",
    "contact_force_mean_N", "contact_force_max_N", "unbalanced_force_ratio", "kinetic_energy_J", "mesh_rebuilds",
    "overlap_max_over_d", "inertial_number", "loading_rate", "contact_energy_J",
)  # fmt: skip
#: What a solved flow adds: over all pores, by their volumes; and the flow out of the box, net, m^3/s.
FLOW_COLUMNS = ("pressure_mean_Pa", "pressure_min_Pa", "pressure_max_Pa", "outflow_m3_per_s")

#: Part of the strain by which the walls may miss it: they are driven by the size of the pack, which the initial stress changes a little.
STRAIN_TOLERANCE = 0.02


def inertial_number(rate_per_s: float, diameter_m: float, density_kg_m3: float, stress_Pa: float) -> float:
    """I = shear rate * d / sqrt(stress / density): below 1e-3 a pack is quasi-static (GDR MiDi 2004)."""
    return rate_per_s * diameter_m * math.sqrt(density_kg_m3 / max(abs(stress_Pa), 1.0))


def loading_rate(engine: Engine, driven: tuple[str, ...], mean_overlap_m: float) -> float:
    """Way of the fastest of the driven walls in a step, over the mean overlap of the contacts; 0 where no wall is driven."""
    way = max((abs(engine.wall(name).velocity) for name in driven), default=0.0) * engine.time_step
    return way / mean_overlap_m if mean_overlap_m > 0.0 else 0.0


class Measures:
    """Measures of a run, against its state when loading began.

    A grain's reference position travels with it in the deck's `fix reference_position`; only sums cross the ranks.
    """

    def __init__(self, case: RunCase, fault: FaultGeometry, walls: SceneWalls, reference: dict[str, float]):
        self._case = case
        self._fault = fault
        self._walls = walls
        self._reference = reference
        self._band = BAND_DIAMETERS * 2.0 * case.mean_radius_m
        self._previous: tuple[float, float] | None = None

    def row(self, engine: Engine, comm, time: float, figures: dict[str, float]) -> dict[str, float]:
        """One line of the history, the same on all ranks; keys are `columns` of the case. figures: those of the flow and of the bonds."""
        row: dict[str, float] = {"step": engine.step, "time_s": time} | figures
        row |= self._stresses(engine)
        grains, mean_overlap = self._grains(engine, comm)
        row |= grains
        row["vertical_strain_rate_per_s"] = self._rate(time, row["vertical_strain"])
        mean_stress = 0.5 * (abs(row["sigma_h_left_Pa"] + row["sigma_h_right_Pa"]) / 2 + abs(row["sigma_v_Pa"]))
        rate = max(abs(self._case.loading.strain_rate_per_s), abs(row["vertical_strain_rate_per_s"]))
        row["inertial_number"] = inertial_number(rate, 2.0 * self._case.mean_radius_m, self._case.pack.density_kg_m3, mean_stress)
        # The x walls of the scene "supplement" are driven by a stress.
        driven = ("x_left", "x_right") if self._case.scene == "two_sides" else ()
        row["loading_rate"] = loading_rate(engine, driven, mean_overlap)
        return {name: row[name] for name in self.columns(self._case)}

    @staticmethod
    def columns(case: RunCase) -> tuple[str, ...]:
        """Names of what a line of the history holds."""
        return HISTORY_COLUMNS + (FLOW_COLUMNS if case.flow.kind == "solve" else ())

    @staticmethod
    def reference(engine: Engine, comm, fault: FaultGeometry, walls: SceneWalls) -> dict[str, float]:
        """What later strains refer to: length and height of the box, m, and porosity of the gouge."""
        positions = wall_positions(engine, walls.plates)
        reference = {"length": positions["x_right"] - positions["x_left"]}
        if walls.periodic_z:
            reference["height"] = fault.upper[2] - fault.lower[2]
        else:
            sides = [positions[f"z_top_{side}"] - positions[f"z_bottom_{side}"] for side in ("left", "right")]
            reference["height"] = 0.5 * sum(sides)
        solid = comm.allreduce(fault.solid_fraction(engine.atom("x"), engine.atom("radius")))
        reference["porosity_gouge"] = 1.0 - solid
        return reference

    def resume(self, previous: list[float] | None) -> None:
        """Continue the vertical strain rate from (time, vertical strain) of the line before a checkpoint."""
        self._previous = (previous[0], previous[1]) if previous else None

    def strain(self, engine: Engine) -> float:
        """Horizontal strain, from the x walls, positive in compression."""
        length = engine.wall("x_right").position - engine.wall("x_left").position
        return 1.0 - length / self._reference["length"]

    def progress(self, engine: Engine, time: float) -> float:
        """How far the ramp of the pressures has gone, 0 to 1."""
        if self._case.scene == "supplement":
            return min(1.0, time / self._case.supplement.ramp_time_s)
        return self._ramped(self.strain(engine))

    def _ramped(self, strain: float) -> float:
        return min(1.0, strain / self._case.loading.horizontal_strain)

    def quality(self, row: dict[str, float]) -> dict[str, float]:
        """Figures of a line whose largest values tell how nearly static the run was."""
        left, right = row["sigma_h_left_Pa"], row["sigma_h_right_Pa"]
        names = ("unbalanced_force_ratio", "overlap_max_over_d", "inertial_number", "loading_rate", "kinetic_energy_J")
        held = {"supplement": (left, right)}.get(self._case.scene, (row["sigma_v_Pa"],))
        wanted = self._case.initial_stress_Pa
        return {name: row[name] for name in names} | {
            "wall_stress_difference": 2 * abs(left - right) / max(abs(left + right), 1e-300), "held_stress_error": max(abs(stress / wanted - 1.0) for stress in held)}

    def ending(self, row: dict[str, float]) -> str | None:
        """Why the run is over after this line; None if it is not."""
        if self._case.scene == "two_sides" and row["vertical_strain"] >= self._case.loading.stop_vertical_strain:
            return f"the blocks part: vertical strain {row['vertical_strain']:.3g} reached loading.stop_vertical_strain"
        slip = max(abs(row["slip_left_m"]), abs(row["slip_right_m"]))
        if self._case.scene == "supplement" and slip >= self._case.supplement.stop_slip_m:
            return f"the fault slips: {slip:.3g} m reached supplement.stop_slip_m"
        return None

    def shortfall(self, row: dict[str, float]) -> str:
        """How far the last line of a run that made all its steps is from the strain asked for, which walls of a deck's own may miss; empty
        where it is there."""
        wanted = self._case.loading.strain_rate_per_s * row["time_s"]
        if self._case.scene != "two_sides" or abs(row["strain"] - wanted) <= STRAIN_TOLERANCE * wanted:
            return ""
        reached = f"; the pressures, which follow it, reached {100.0 * self._ramped(row['strain']):.0f} % of their targets" if self._case.needs_mesh else ""
        return f", at a strain of {row['strain']:.3g} where the case has {wanted:.3g}: its deck moves the x walls in a way of its own{reached}"

    def line(self, row: dict[str, float]) -> str:
        """What the progress line tells."""
        return f"strain {row['strain']:.2e}  sigma_n {row['sigma_n_Pa'] / 1e6:.1f} MPa  slip {1e6 * row['slip_left_m']:.0f} / {1e6 * row['slip_right_m']:.0f} um"

    @property
    def previous(self) -> tuple[float, float] | None:
        """(time, vertical strain) of the last line."""
        return self._previous

    def _rate(self, time: float, vertical_strain: float) -> float:
        before, self._previous = self._previous, (time, vertical_strain)
        if before is None or time == before[0]:
            return 0.0
        return (vertical_strain - before[1]) / (time - before[0])

    def _stresses(self, engine: Engine) -> dict[str, float]:
        state = self._walls.states(engine)
        stresses = self._walls.stresses(state)
        horizontal = 0.5 * (stresses.left + stresses.right)
        # The mean stress plus half the difference times cos 2 alpha (paper, II.E), alpha from the x axis to the fault's normal.
        across_x, _, across_z = self._fault.normal**2
        normal = across_x * horizontal + across_z * stresses.vertical
        return {
            "strain": 1.0 - stresses.length / self._reference["length"],
            "vertical_strain": stresses.height / self._reference["height"] - 1.0,
            "sigma_h_left_Pa": stresses.left,
            "sigma_h_right_Pa": stresses.right,
            "sigma_v_Pa": stresses.vertical,
            "sigma_n_Pa": normal,
        }

    def _grains(self, engine: Engine, comm) -> tuple[dict[str, float], float]:
        """What needs the grains and their contacts, and the contacts' mean overlap, m."""
        from mpi4py import MPI

        kind, mass = engine.atom("type"), engine.atom("rmass")
        reference = engine.property_atom("reference_position")
        displacement = engine.unwrapped_position() - reference
        across = self._fault.across(reference)
        along, opening = displacement @ self._fault.tangent, displacement @ self._fault.normal
        half = 0.5 * self._fault.width
        bands = (
            (kind == LEFT) & (across > -half - self._band), (kind == GOUGE) & (across < -half + self._band),
            (kind == GOUGE) & (across > half - self._band), (kind == RIGHT) & (across < half + self._band),
        )  # fmt: skip
        velocity, force = engine.atom("v"), engine.atom("f")
        free = (engine.atom("mask") & self._walls.held_bit(engine)) == 0
        contacts = engine.contacts()
        first, second = contacts.type[:, 0] == GOUGE, contacts.type[:, 1] == GOUGE
        in_gouge, gouge_ends = first | second, np.count_nonzero(first) + np.count_nonzero(second)
        size = np.sqrt(contacts.normal_force**2 + _squares(contacts.shear_force))
        sums = [
            *(x for band in bands for x in (band.sum(), along[band].sum(), opening[band].sum())),
            0.5 * float(mass @ _squares(velocity)),
            np.sqrt(_squares(force)[free]).sum(), free.sum(),
            size.sum(), len(size), size[in_gouge].sum(), in_gouge.sum(), gouge_ends, (kind == GOUGE).sum(), engine.intact_bonds(),
            contacts.energy.sum(), contacts.overlap.sum(),
        ]  # fmt: skip
        total = np.array(sums, dtype=float)
        comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
        largest = np.array([size[in_gouge].max(initial=0.0), contacts.overlap.max(initial=0.0)])
        comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)

        count, slide, open_ = total[0:12:3], total[1:12:3], total[2:12:3]
        slide, open_ = slide / np.maximum(count, 1), open_ / np.maximum(count, 1)
        kinetic, unbalanced, free_count, force_sum, contact_count, gouge_sum, gouge_contacts, ends, gouge_grains, intact, energy, overlap = total[12:]
        mean_force = force_sum / max(contact_count, 1.0)
        widening = open_[3] - open_[0]
        solid = (1.0 - self._reference["porosity_gouge"]) * self._fault.width / (self._fault.width + widening)
        row = {
            "slip_left_m": slide[0] - slide[1],
            "slip_right_m": slide[2] - slide[3],
            "bonds_intact": int(intact),
            "coordination_gouge": ends / max(gouge_grains, 1.0),
            "contacts_gouge": int(gouge_contacts),
            "porosity_gouge": 1.0 - solid,
            "contact_force_mean_N": gouge_sum / max(gouge_contacts, 1.0),
            "contact_force_max_N": largest[0],
            "unbalanced_force_ratio": unbalanced / max(free_count, 1.0) / mean_force if mean_force > 0 else 0.0,
            "kinetic_energy_J": kinetic,
            "overlap_max_over_d": largest[1] / (2.0 * self._case.mean_radius_m),
            "contact_energy_J": energy,
        }
        return row, overlap / max(contact_count, 1.0)


def _squares(vectors: np.ndarray) -> np.ndarray:
    """Squared lengths (n,) of vectors (n, 3); sums along so short an axis are many times slower."""
    return np.einsum("ij,ij->i", vectors, vectors)
