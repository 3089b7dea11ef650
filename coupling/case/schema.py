"""What a case file may hold: one frozen dataclass a section, each input with its default, range and source.

All inputs are in SI units; a unit stands in the key where a quantity has one (`_m`, `_Pa`, `_per_s`). "Table I" is that of
Yang & Juanes (2018), "the paper"; where the paper is silent or contradicts itself, the comment says what is taken and why.
`allowed` attaches the range that coupling/case/checks.py enforces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from coupling.native import REPOSITORY


def allowed(
    default: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field with its default and the range of its value, or of each of its values."""
    limits = {"above": above, "at_least": at_least, "below": below, "at_most": at_most, "choices": choices}
    limits = {name: limit for name, limit in limits.items() if limit not in (None, ())}
    if isinstance(default, dict):
        # A dict has no hash; two runs that differ in it alone share one, which is allowed.
        return field(default_factory=lambda: dict(default), hash=False, metadata=limits)
    return field(default=default, metadata=limits)


@dataclass(frozen=True)
class Pack:
    """The packing of spheres before it is loaded: grown, compacted isotropically, floaters removed."""

    # Seed of the grains' random positions and sizes; runs with the same [pack] and [material] share one cached pack.
    seed: int = allowed(1, at_least=1, at_most=2_000_000_000)
    # Size of the box along x, y, z: Table I.
    box_m: tuple[float, float, float] = allowed((0.08, 0.02, 0.05), above=0.0, at_most=1e3)
    # Smallest and largest diameter, uniform between them: Table I.
    diameter_m: tuple[float, float] = allowed((1.8e-3, 2.2e-3), above=0.0, at_most=1e3)
    # Porosity aimed at: Table I. What is reached stands in the report.
    porosity: float = allowed(0.35, at_least=0.2, at_most=0.9)
    # Density of a grain: Table I.
    density_kg_m3: float = allowed(2650.0, above=0.0, at_most=1e9)
    # Isotropic stress that the pack is compacted to: the vertical stress of Table I. From a higher one than the initial stress the two-sided
    # scene is unloaded with friction: very stiff grains come to rest only so.
    confining_stress_Pa: float = allowed(1e7, above=0.0, at_most=1e12)
    # How far the walls' forces may be from the initial stress when it counts as settled, as a part of it.
    initial_stress_tolerance: float = allowed(2e-3, above=0.0, at_most=0.1)
    # Coefficient of friction while the pack is made: 0 makes packs as dense as asked for without it, and looser ones with the little
    # that they need. More makes a pack looser: at 0.02 about 0.43, at 0.1 about 0.47.
    friction: float = allowed(0.0, at_least=0.0, at_most=10.0)
    # Ranks that make the pack, its initial stress and its bonds, of those of the run; the others wait. Grains come to lie elsewhere on
    # another number of ranks, so that this number is one of the pack's inputs and that of the run is not. Worth raising from some 1e5 grains on.
    ranks: int = allowed(1, at_least=1, at_most=1_000_000)
    # Values for the `variable ... index` lines of liggghts-inputs/in.pack, which holds their defaults.
    deck_variables: dict[str, float | int | str] = allowed({})


@dataclass(frozen=True)
class Material:
    """Linear elastic-frictional contacts (Cundall & Strack), the same for all grains and walls but for the walls' friction, which is 0."""

    # How `modulus_Pa` gives the normal stiffness k_n. The paper's 5e10 "N/m" would cap the stress near 50 MPa at a strain of 1e-5, where its
    # ramped pressure is below 0.1 MPa, so it is read as an effective modulus E*: k_n = pi min(R)^2 E* / (R1 + R2), as in PFC's linear
    # model. "older-pfc" is k_n = 4 R E_c. "literal" takes the number as k_n in N/m: the stiff extreme, 25 times as many steps.
    stiffness_reading: str = allowed("effective-modulus", choices=("effective-modulus", "older-pfc", "literal"))
    # Table I's 5.0e10, in Pa, or in N/m where it is read literally.
    modulus_Pa: float = allowed(5e10, above=0.0, at_most=1e15)
    # k_s / k_n: the paper gives none (elastic spheres without slip have 2/3 to 1).
    shear_stiffness_ratio: float = allowed(0.5, at_least=0.0, at_most=1.0)
    # Coefficient of friction between grains: Table I.
    friction: float = allowed(0.5, at_least=0.0, at_most=10.0)
    # Coefficient of restitution of two mean grains, which sets the viscous damping of contacts; the paper gives none, and
    # quasi-static loading does not depend on it.
    restitution: float = allowed(0.5, above=0.0, at_most=1.0)
    # PFC's local damping while loading, F -= alpha |F| sign(v) by component: 0 is off, the default; the paper gives none.
    local_damping: float = allowed(0.0, at_least=0.0, below=1.0)

    def normal_stiffness(self, radius_m: float) -> float:
        """k_n of two grains of one radius, N/m."""
        if self.stiffness_reading == "effective-modulus":
            return math.pi * radius_m * self.modulus_Pa / 2.0
        if self.stiffness_reading == "older-pfc":
            return 4.0 * radius_m * self.modulus_Pa
        return self.modulus_Pa


@dataclass(frozen=True)
class Bonds:
    """Linear contact bonds (Potyondy & Cundall) between the grains of either block."""

    # Whether the blocks are bonded at all.
    enabled: bool = allowed(True)
    # Tensile strength as a stress, mean and standard deviation of a normal distribution: Table I; times pi min(R)^2 it is the
    # force at which a bond breaks, about 3.1 kN.
    strength_mean_Pa: float = allowed(1e9, above=0.0, at_most=1e15)
    strength_sd_Pa: float = allowed(0.2e9, at_least=0.0, at_most=1e15)
    # Shear strength over tensile strength: Table I gives the same for both.
    shear_ratio: float = allowed(1.0, above=0.0, at_most=1e3)
    # Pairs with at most this gap between their surfaces are bonded: 0 bonds only those that touch.
    gap_m: float = allowed(0.0, at_least=0.0, at_most=1e3)
    # Seed of the strengths, hashed with the ids of the two grains.
    seed: int = allowed(1, at_least=1, at_most=2_000_000_000)


@dataclass(frozen=True)
class Fault:
    """The gouge layer through the centre of the box, between two bonded blocks."""

    # Width of the layer across itself: Table I.
    gouge_width_m: float = allowed(0.012, above=0.0, at_most=1e3)
    # Dip of the layer from the horizontal: the paper's Fig. 3; 90 makes the fault's normal the x axis.
    dip_degrees: float = allowed(45.0, above=0.0, at_most=90.0)
    # Gouge grains whose centres lie within this distance of the top or bottom face have u_z = 0: paper, section II.D. A little
    # under one diameter: one layer of grains.
    end_band_m: float = allowed(1.5e-3, at_least=0.0, at_most=1e3)


@dataclass(frozen=True)
class Loading:
    """Horizontal compression at a constant rate under a constant vertical stress."""

    # Horizontal strain reached at the end, at which the pressures reach their targets: paper, section II.E.
    horizontal_strain: float = allowed(3.1e-3, above=0.0, below=0.5)
    # Rate of that strain. The paper's is 7.8e-3; 200 times that is still quasi-static. What other rates do to the onset of slip, and softer or
    # denser grains: docs/error-against-run-time.md, loading rate.
    strain_rate_per_s: float = allowed(1.56, above=0.0, at_most=1e9)
    # Total vertical stress on the blocks, held by servo: Table I.
    vertical_stress_Pa: float = allowed(1e7, above=0.0, at_most=1e12)
    # A run ends early when the vertical extension reaches this strain: p_t is above the vertical stress, so the blocks part
    # for good once the gouge has slid.
    stop_vertical_strain: float = allowed(0.02, above=0.0, below=1.0)
    # Time step over 0.63 sqrt(m_min / k_n), about the limit of a dense pack without damping. What stays stable depends on k_s / k_n and on the
    # damping besides (0.82 with the defaults, see coupling/case/time_step_limit.py); more is refused.
    time_step_fraction: float = allowed(0.5, above=0.0, at_most=1.0)
    # Values for the `variable ... index` lines of liggghts-inputs/in.load, which holds their defaults.
    deck_variables: dict[str, float | int | str] = allowed({})


@dataclass(frozen=True)
class Supplement:
    """Loads of the scene "supplement": fault normal along x, periodic in z, stresses held while the pressures rise."""

    # Total normal stress on the x walls.
    normal_stress_Pa: float = allowed(4e7, above=0.0, at_most=1e12)
    # Shear stress on the fault, along z.
    shear_stress_Pa: float = allowed(1.8e7, at_least=0.0, at_most=1e12)
    # Time in which the pressures rise linearly to their targets.
    ramp_time_s: float = allowed(5e-4, above=0.0, at_most=1e6)
    # Time that the targets are held after that.
    hold_time_s: float = allowed(1e-3, at_least=0.0, at_most=1e6)
    # A run ends early when the blocks have slipped this far past each other.
    stop_slip_m: float = allowed(1e-4, above=0.0, at_most=1e3)


@dataclass(frozen=True)
class Sample:
    """Loads of the scene "sample": a box of grains between six walls."""

    # Isotropic stress on the dry pack when loading begins.
    initial_stress_Pa: float = allowed(1e7, above=0.0, at_most=1e12)
    # What a wall does: "fixed", which those not named are; "speed V", into the box, m/s; or "stress S", total, Pa, held by servo. Walls:
    # x_left, x_right, y_front, y_back, z_bottom, z_top.
    walls: dict[str, float | int | str] = allowed({})
    # Time in which the stresses of the walls go, linearly, from the initial stress to theirs: some times that of a wave through the box.
    ramp_time_s: float = allowed(2e-5, above=0.0, at_most=1e6)
    # Time from the start of loading to its end.
    loading_time_s: float = allowed(1e-3, above=0.0, at_most=1e6)

    def motion(self, wall: str) -> tuple[str, float]:
        """What a wall does, "fixed", "speed" or "stress", and the number that goes with it; ValueError if its entry is none of them."""
        kind, *rest = str(self.walls.get(wall, "fixed")).split() or [""]
        if (kind, len(rest)) == ("fixed", 0):
            return kind, 0.0
        if kind not in ("speed", "stress") or len(rest) != 1 or not math.isfinite(float(rest[0])):
            raise ValueError
        return kind, float(rest[0])


@dataclass(frozen=True)
class Fluid:
    """The pore fluid, for flow.kind = "solve"."""

    # Viscosity and compressibility: of water at 20 degrees Celsius.
    viscosity_Pa_s: float = allowed(1e-3, above=0.0, at_most=1e12)
    # A compressibility of 0 makes the flow steady at each solve.
    compressibility_per_Pa: float = allowed(4.6e-10, at_least=0.0, at_most=1.0)
    # "duct": (6) of the paper; "hydraulic-radius": Chareyre et al. (2012). Their errors: docs/error-against-run-time.md, conductance law.
    conductance: str = allowed("duct", choices=("duct", "hydraulic-radius"))
    # Scene "sample": pressure in the pores when loading begins. A fault begins with the field of [pressure].
    initial_pressure_Pa: float = allowed(0.0, at_least=-1e12, at_most=1e12)
    # Scene "sample": pressures held at faces, Pa: xmin, xmax, ymin, ymax, zmin, zmax. A face that is not named lets nothing through.
    faces: dict[str, float | int | str] = allowed({})
    # A fault: where the field of [pressure] is held, "faces": at the blocks' outer faces, or "blocks": in all of the blocks, as the paper
    # prescribes it. Everywhere else the fluid flows; y faces and the gouge's ends let nothing through.
    held: str = allowed("faces", choices=("faces", "blocks"))


@dataclass(frozen=True)
class Pressure:
    """Pore pressure as a function of position and horizontal strain: prescribed in all pores, or with a solved flow where `fluid.held` says."""

    # "none": dry, or held at 0 with a solved flow. "uniform": the same everywhere. "linear": one pressure in each block and linear across the gouge between
    # them, as in the paper. "expression": given by `expression`.
    mode: str = allowed("linear", choices=("none", "uniform", "linear", "expression"))
    # Pressures reached in the left (lower) and right (upper) block at the end of the ramp; p_t = 2.5e7 in Table I.
    left_target_Pa: float = allowed(0.0, at_least=0.0, at_most=1e12)
    right_target_Pa: float = allowed(0.0, at_least=0.0, at_most=1e12)
    # How the targets are reached: linearly in strain (in time, in the scene "supplement").
    ramp: str = allowed("strain", choices=("strain",))
    # Pressure in Pa as a formula of EXPRESSION_NAMES, for mode "expression".
    expression: str = allowed("")


#: What a pressure formula may name, and what each is.
EXPRESSION_NAMES = {
    "x": "position, m",
    "y": "position, m",
    "z": "position, m",
    "s": "distance from the middle of the gouge across it, m, positive in the right block",
    "width": "width of the gouge, m",
    "strain": "horizontal strain",
    "time": "time since loading began, s",
    "p_left": "ramped pressure of the left block, Pa",
    "p_right": "ramped pressure of the right block, Pa",
    "p_t": "the larger of the two targets, Pa",
}


@dataclass(frozen=True)
class Flow:
    """How the pore pressure becomes forces on the grains."""

    # "none": no pore forces, and no mesh is built. "prescribed": the pressure of [pressure] acts on the grains, which do not act back.
    # "solve": the [fluid] flows through the pores.
    kind: str = allowed("prescribed", choices=("none", "prescribed", "solve"))
    # With "solve", whether the grains act back on the fluid by squeezing the pores: false solves for the flow through them alone.
    two_way: bool = allowed(True)
    # "total": pressure on the grains' surfaces and drag in the throats, the exact gradient of sum p V. "pressure": (2) of the paper alone.
    forces: str = allowed("total", choices=("total", "pressure"))
    # Two-way, what the pressures do between two solves: "undrained": they answer every step of the grains as if no fluid passed any
    # throat; "predicted": so they do, and go on draining as in the interval before, which allows longer intervals; "staggered": they stand
    # still, which is stable only while the fluid is softer than the skeleton.
    split: str = allowed("undrained", choices=("undrained", "predicted", "staggered"))
    # Steps between two updates of the forces; with "solve", between two solves of the flow. The error of an interval, and the split to
    # choose for it: docs/error-against-run-time.md, coupling interval and remeshing.
    interval_steps: int = allowed(50, at_least=1, at_most=1_000_000_000)
    # Two-way, with a split other than "staggered": makes intervals follow the solution. Each is as long as keeps the difference between the
    # pressures that the grains feel at its end and those that the solve then gives near this part of what pressures change by in the run, at
    # most interval_steps; intervals end where a line of the history is due. 0: all intervals are of interval_steps. What it does to a settlement:
    # docs/error-against-run-time.md, coupling interval.
    interval_tolerance: float = allowed(0.0, at_least=0.0, at_most=1.0)
    # Residual of a solve over its right side; mass and work balance whatever it is. What it makes of a settlement:
    # docs/error-against-run-time.md, coupling interval.
    solver_tolerance: float = allowed(1e-6, at_least=1e-14, at_most=1e-2)
    # When the mesh of the pores is made anew: "needed": where it no longer is the triangulation of the grains, and then repaired if that can
    # be; "always": at every update.
    remesh: str = allowed("needed", choices=("needed", "always"))
    # Part of a mean radius that a grain may move before the mesh is looked at again; 0 looks at every update, which is cheap
    # (docs/error-against-run-time.md, remesh).
    remesh_displacement: float = allowed(0.0, at_least=0.0, at_most=0.5)
    # Which deck include adds the forces: "fast", the compiled fix, or "addforce", LIGGGHTS' own fix addforce with atom-style variables.
    pore_force: str = allowed("fast", choices=("fast", "addforce"))


@dataclass(frozen=True)
class Output:
    """What a run writes, and how often."""

    # Steps between two lines of history.csv.
    history_interval_steps: int = allowed(100, at_least=1, at_most=1_000_000_000)
    # Number of snapshots for ParaView, evenly spaced, the first at the start of loading and the last at its end: 0 writes none.
    snapshots: int = allowed(0, at_least=0, at_most=100_000)
    # Steps between two checkpoints: 0 writes none.
    checkpoint_every_steps: int = allowed(0, at_least=0, at_most=1_000_000_000)


SECTIONS = {
    "pack": Pack,
    "material": Material,
    "bonds": Bonds,
    "fault": Fault,
    "loading": Loading,
    "supplement": Supplement,
    "sample": Sample,
    "fluid": Fluid,
    "pressure": Pressure,
    "flow": Flow,
    "output": Output,
}
SCENES = ("two_sides", "supplement", "sample")
ENGINES = ("liggghts",)
#: Faces of the box in the order that arrays of six have, and the walls of a pack and of a sample on them: ids of fixes in the decks.
FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
PACK = ("x_left", "x_right", "y_front", "y_back", "z_bottom", "z_top")
#: Decks of the engine. A case that wants others names a copy of this directory with changes in it: `decks_directory`.
DECKS = REPOSITORY / "liggghts-inputs"
