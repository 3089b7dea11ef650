"""The longest stable step of packs by bisection on the engine, against the spectrum of their contacts and against the formula.

A pack at rest is the scene, with a motion far below what opens a contact: with a step that is too long it grows within some hundred steps.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from coupling.case.files import load_case
from coupling.case.run_case import RunCase
from coupling.case.schema import PACK
from coupling.engine.liggghts import LiggghtsEngine
from coupling.errors import ComputationError
from coupling.stability.contact_spectrum import contacts_of, stable_time_step
from coupling.stability.grain_scenes import SIZES, of_sizes
from coupling.stability.scene import FAILED, STABLE, Outcome, Scene, bisected, limit
from coupling.stability.small_cases import SAMPLE
from coupling.stages import prepared
from coupling.stages.deck_variables import fault_geometry, load_variables, stress_variables
from coupling.stages.packing import Packing

STEPS, STILL_STEPS = 1000, 20000
#: Speed, m/s, that each component of the grains' velocities begins with, at random; and by how much its energy grows in an unstable pack.
PERTURBED, GROWN = 1e-7, 10.0
#: By how much the formula may be shorter than what is found: nearly equal sizes, and others, whose smallest grains touch few.
NEAR, FAR = 0.25, 9.0
WALLS = {name: (face // 2, 1 - 2 * (face % 2)) for face, name in enumerate(PACK)}


def _silent(text: str) -> None:
    """Stages that are made here tell nobody."""


class AtRest:
    """A pack at rest under its stress, that can be run with any time step; on one rank."""

    def __init__(self, case: RunCase, stage: prepared.Stage, directory: Path):
        from mpi4py import MPI

        self.case, self.stage, self._comm, self._log = case, stage, MPI.COMM_SELF, directory / "log.liggghts"
        # What of the settling still moves, and grains that touch nothing, are stilled.
        step = 0.2 * case.critical_time_step_s
        engine = self.engine(step)
        lightest = engine.atom("rmass").min()
        engine.command(f"fix still all viscous {0.5 * lightest / step:.9g}")
        engine.command("fix stiller all damping/local 0.7")
        engine.run(STILL_STEPS, setup=True)
        engine.command("unfix still")
        engine.command("unfix stiller")
        engine.write_restart(directory / "still.restart")
        engine.close()
        self.stage = prepared.Stage(directory / "still.restart", stage.manifest)

    def engine(self, time_step: float) -> LiggghtsEngine:
        engine = LiggghtsEngine(self._comm, self._log)
        fault = fault_geometry(self.case, self.stage.manifest["geometry"], self.case.pack.box_m[2])
        variables = load_variables(self.case, self.stage.restart, fault) | {"time_step": time_step} | {f"motion_{name}": '"velocity 0."' for name in PACK}
        engine.deck(prepared.load_deck(self.case), variables, self.stage.manifest["grains"])
        engine.command("reset_timestep 0")
        engine.run(0, setup=True)
        return engine

    def stable(self, time_step: float) -> bool:
        def kinetic() -> float:
            return float(engine.atom("rmass") @ (engine.atom("v") ** 2).sum(axis=1))

        engine = self.engine(time_step)
        engine.atom("v")[:] = PERTURBED * np.random.default_rng(1).normal(size=engine.atom("v").shape)
        before = kinetic()
        try:
            engine.run(STEPS, setup=False)
            after = kinetic()
            engine.close()
        except ComputationError:
            return False
        return after < GROWN * before

    def by_spectrum(self) -> tuple[float, float]:
        """The longest stable step, s, and the coordination number."""
        case = self.case
        engine = self.engine(0.2 * case.critical_time_step_s)
        engine.run(200, setup=False)
        contacts = contacts_of(engine, WALLS, case.normal_stiffness_N_per_m, case.shear_stiffness_N_per_m, case.normal_damping_per_s, case.material.friction)
        engine.close()
        longest = stable_time_step(contacts) / math.sqrt(1.0 + case.material.local_damping)
        return longest, contacts.coordination

    def limit(self, within: float, agreement: float = 0.05) -> Outcome:
        """within: by how much the formula may be shorter than what is found; agreement: of that with the spectrum."""
        unit = self.case.critical_time_step_s
        spectrum, coordination = self.by_spectrum()
        found = bisected(self.stable, 0.6 * spectrum, 1.4 * spectrum) / unit
        formula = self.case.stable_time_step_s(self.case.material.local_damping, self.case.material.friction > 0.0) / unit
        words = f"spectrum of its contacts {spectrum / unit:.3f}, {coordination:.2f} contacts a grain, {self.stage.manifest['grains']} grains"
        outcome = limit(found, formula, "of 0.63 sqrt(m_min/k_n)", words, within)
        agree = abs(found / (spectrum / unit) - 1.0) < agreement
        return outcome if agree else Outcome(FAILED, f"found is off the spectrum: {words}", found, formula, outcome.unit)


def case_of(directory: Path, *settings: str) -> RunCase:
    """The box of grains with `--set` values."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "case.toml").write_text(SAMPLE)
    return load_case(directory / "case.toml", settings).runs[0]


def of_sample(within: float, *settings: str, agreement: float = 0.05):
    """Act: the limit of the pack that the program makes."""

    def act(directory: Path) -> Outcome:
        from mpi4py import MPI

        case = case_of(directory, *settings)
        stage = prepared.prepare(case, MPI.COMM_SELF, LiggghtsEngine, _silent)
        return AtRest(case, stage, directory).limit(within, agreement)

    return act


def of_two_sizes(apart: float, side: float, large_share: float):
    """Act: the limit of a pack of grains of two diameters, 1e-3 m and `apart` times as much, in a box of this side, m; large_share: of the solid."""

    def act(directory: Path) -> Outcome:
        from mpi4py import MPI

        small, large = 1e-3, 1e-3 * apart
        # Two sizes are no input of the program: the pack's own stages are carried out on a file of grains.
        case = case_of(directory, f"pack.diameter_m=[{small}, {large}]", "pack.box_m=[0.1, 0.1, 0.1]")
        case = dataclasses.replace(case, pack=dataclasses.replace(case.pack, box_m=(side, side, side)))
        box = np.array(case.pack.box_m)
        solid, random = 0.6 * box.prod(), np.random.default_rng(1)
        counts = [round(share * solid / (np.pi / 6.0 * d**3)) for share, d in ((large_share, large), (1.0 - large_share, small))]
        diameter = np.repeat([large, small], counts)
        position = 0.5 * small + random.random((len(diameter), 3)) * (box - small)
        lines = ["two sizes", "", f"{len(diameter)} atoms", "3 atom types", "", *(f"{-0.1 * s:.9g} {1.1 * s:.9g} {a}lo {a}hi" for a, s in zip("xyz", box)), "", "Atoms", ""]
        lines += [f"{i + 1} 1 {d:.9g} {case.pack.density_kg_m3:.9g} {x:.9g} {y:.9g} {z:.9g}" for i, (d, (x, y, z)) in enumerate(zip(diameter, position))]
        (directory / "grains.data").write_text("\n".join(lines) + "\n")
        comm = MPI.COMM_SELF
        engine = LiggghtsEngine(comm, directory / "log.pack")
        packing = Packing(case, engine, comm, Path(case.decks_directory) / "in.pack")
        packing.loose = True
        made = packing.make(directory / "grains.data", len(diameter))
        engine.write_restart(directory / "pack.restart")
        engine.close()
        packed = prepared.Stage(directory / "pack.restart", made | {"geometry": made["walls"]})
        engine = LiggghtsEngine(comm, directory / "log.stress")
        engine.deck(Path(case.decks_directory) / "in.stress_sample", stress_variables(case, packed) | {"settle_steps": 20000}, made["grains"])
        engine.write_restart(directory / "stress.restart")
        engine.close()
        return AtRest(case, prepared.Stage(directory / "stress.restart", packed.manifest), directory).limit(FAR)

    return act


def scenes() -> list[Scene]:
    """All of them, in the order of the table."""
    found = []
    for apart in SIZES:
        within = NEAR if apart == "1.2" else FAR
        # Of the widest sizes some grains hardly bear anything: their contacts open under the least motion.
        act = of_sample(within, *of_sizes(apart), agreement=0.3 if apart == "10" else 0.05)
        found.append(Scene(f"grains/limit/{apart}", f"longest stable DEM step, sizes {apart} apart", (STABLE,), act, quick=apart == "1.2"))
    found.append(Scene("grains/limit/two_sizes_3", "longest stable DEM step, two sizes 3 apart, half the solid each", (STABLE,), of_two_sizes(3.0, 0.009, 0.5)))
    for name, settings in {
        "undamped": ("material.restitution=1.0",), "overdamped": ("material.restitution=0.01", "loading.time_step_fraction=0.4"),
        "local_damping_0.7": ("material.local_damping=0.7",), "shear_stiffness_1": ("material.shear_stiffness_ratio=1.0",),
        "frictionless": ("material.friction=0.0", "material.shear_stiffness_ratio=0.0"),
    }.items():  # fmt: skip
        # Local damping is not linear: sqrt(1 + alpha) is for a motion that turns round at every step.
        act = of_sample(NEAR, *settings, agreement=0.1 if "local" in name else 0.05)
        found.append(Scene(f"grains/limit/{name}", f"longest stable DEM step, {name.replace('_', ' ')}", (STABLE,), act))
    return found
