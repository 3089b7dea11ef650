"""One run with every input resolved, what follows from its inputs, and the case file that stands for several."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from coupling.case.schema import SECTIONS, Bonds, Fault, Flow, Fluid, Loading, Material, Output, Pack, Pressure, Sample, Supplement
from coupling.case.time_step_limit import stable_time_step


@dataclass(frozen=True)
class RunCase:
    """One run with every input resolved."""

    case: str  # stem of the case file's name
    name: str  # name of the run; with several packs `<group>-seed<seed>`
    group: str  # name of the run without its pack
    title: str
    scene: str
    engine: str
    decks_directory: str  # absolute path
    pack: Pack
    material: Material
    bonds: Bonds
    fault: Fault
    loading: Loading
    supplement: Supplement
    sample: Sample
    fluid: Fluid
    pressure: Pressure
    flow: Flow
    output: Output

    @property
    def mean_radius_m(self) -> float:
        return sum(self.pack.diameter_m) / 4.0

    @property
    def normal_stiffness_N_per_m(self) -> float:
        """k_n of two mean grains."""
        return self.material.normal_stiffness(self.mean_radius_m)

    @property
    def shear_stiffness_N_per_m(self) -> float:
        """k_s of two mean grains."""
        return self.material.shear_stiffness_ratio * self.normal_stiffness_N_per_m

    @property
    def normal_damping_per_s(self) -> float:
        """gamma_n of F = -gamma_n m_eff v_n for the restitution of two mean grains."""
        if self.material.restitution == 1.0:
            return 0.0
        half_mass = self._mass(self.mean_radius_m) / 2.0
        logarithm = math.log(self.material.restitution)
        damping_ratio = -logarithm / math.hypot(math.pi, logarithm)
        return 2.0 * damping_ratio * math.sqrt(self.normal_stiffness_N_per_m / half_mass)

    @property
    def critical_time_step_s(self) -> float:
        """0.63 sqrt(m_min / k_n), by which loading.time_step_fraction is counted; `stable_time_step_s` is the limit itself."""
        lightest = self._mass(self.pack.diameter_m[0] / 2.0)
        return 0.63 * math.sqrt(lightest / self.normal_stiffness_N_per_m)

    @property
    def time_step_s(self) -> float:
        return self.loading.time_step_fraction * self.critical_time_step_s

    def stable_time_step_s(self, local_damping: float, sheared: bool = True) -> float:
        """The longest step with which the contacts stay stable; `sheared`: whether they have friction, without which k_s does nothing."""
        lightest, ratio = self._mass(self.pack.diameter_m[0] / 2.0), self.material.shear_stiffness_ratio if sheared else 0.0
        return stable_time_step(lightest, self.normal_stiffness_N_per_m, ratio, self.normal_damping_per_s, local_damping)

    @property
    def initial_stress_Pa(self) -> float:
        """Stress on the walls before loading, isotropic in the plane of the fault's normal."""
        if self.scene == "sample":
            return self.sample.initial_stress_Pa
        return self.supplement.normal_stress_Pa if self.scene == "supplement" else self.loading.vertical_stress_Pa

    @property
    def initial_overlap_m(self) -> float:
        """Estimate of the overlap of two mean grains under the initial stress, sigma d^2 / k_n."""
        return self.initial_stress_Pa * (2.0 * self.mean_radius_m) ** 2 / self.normal_stiffness_N_per_m

    @property
    def loading_time_s(self) -> float:
        """Time from the start of loading to its end."""
        if self.scene == "supplement":
            return self.supplement.ramp_time_s + self.supplement.hold_time_s
        if self.scene == "sample":
            return self.sample.loading_time_s
        return self.loading.horizontal_strain / self.loading.strain_rate_per_s

    @property
    def loading_steps(self) -> int:
        return math.ceil(self.loading_time_s / self.time_step_s)

    @property
    def estimated_grains(self) -> int:
        """Grains that fill the box at the target porosity, diameters uniform between the smallest and the largest."""
        smallest, largest = self.pack.diameter_m
        mean_cube = (smallest**2 + largest**2) * (smallest + largest) / 4.0
        return round(math.prod(self.pack.box_m) * (1.0 - self.pack.porosity) / (math.pi / 6.0 * mean_cube))

    @property
    def periodic_z(self) -> bool:
        """Whether the box is periodic along z."""
        return self.scene == "supplement"

    @property
    def has_fault(self) -> bool:
        """Whether the pack is divided into two blocks and the gouge between them."""
        return self.scene != "sample"

    @property
    def bonded(self) -> bool:
        """Whether the blocks are bonded."""
        return self.bonds.enabled and self.has_fault

    @property
    def needs_mesh(self) -> bool:
        """Whether any pore force acts, so that the pore network is needed at all."""
        return self.flow.kind == "solve" or (self.flow.kind == "prescribed" and self.pressure.mode != "none")

    def _mass(self, radius_m: float) -> float:
        return self.pack.density_kg_m3 * 4.0 / 3.0 * math.pi * radius_m**3

    def to_dict(self) -> dict[str, Any]:
        """Every input with its value, as case.json holds it, and under `derived` what follows from them."""
        resolved: dict[str, Any] = {"case": self.case, "run": self.name, "group": self.group}
        resolved |= {"title": self.title, "scene": self.scene, "engine": self.engine, "decks_directory": self.decks_directory}
        resolved |= {name: dataclasses.asdict(getattr(self, name)) for name in SECTIONS}
        derived = (
            "normal_stiffness_N_per_m",
            "shear_stiffness_N_per_m",
            "normal_damping_per_s",
            "critical_time_step_s",
            "time_step_s",
            "loading_steps",
            "estimated_grains",
        )
        resolved["derived"] = {name: getattr(self, name) for name in derived}
        return resolved


@dataclass(frozen=True)
class CaseFile:
    """A case file: the runs it stands for, in its own order."""

    stem: str
    runs: tuple[RunCase, ...]
