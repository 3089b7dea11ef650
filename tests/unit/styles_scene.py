"""Runs small LIGGGHTS scenes for the tests of the run-time styles, each in processes of its own.

A scene is a function of a test file that takes a communicator and keyword arguments and returns anything that can be
pickled. `run_scene` starts it on one or more ranks and gives back what each rank returned.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
TIMEOUT_SECONDS = 120
#: Printed by a scene's process before the text of the error that ended it.
ERROR_MARK = "scene ended by: "


class SceneError(Exception):
    """A scene ended with an error; the message is that of the engine."""


def run_scene(scene: Callable, ranks: int = 1, **arguments) -> list:
    """Results of `scene(comm, **arguments)`, one a rank; raises SceneError with the engine's message if it fails."""
    with tempfile.TemporaryDirectory() as directory:
        job = Path(directory) / "job.pickle"
        job.write_bytes(pickle.dumps((scene.__code__.co_filename, scene.__name__, arguments)))
        command = [sys.executable, __file__, str(job)]
        if ranks > 1:
            launcher = ["mpirun", "--oversubscribe", "--bind-to", "none", "--mca", "mpi_yield_when_idle", "1", "-n", str(ranks)]
            if os.geteuid() == 0:
                launcher.insert(1, "--allow-run-as-root")
            command = launcher + command
        # What another test's MPI left in the environment would make a child take itself for a part of that run.
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX_", "ORTE_"))}
        done = subprocess.run(command, cwd=directory, env=environment, capture_output=True, text=True, timeout=TIMEOUT_SECONDS, check=False)
        results = sorted(Path(directory).glob("result-*.pickle"))
        if done.returncode != 0 or len(results) != ranks:
            errors = [line for line in done.stderr.splitlines() if ERROR_MARK in line]
            raise SceneError("\n".join(errors) if errors else f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}")
        return [pickle.loads(path.read_bytes()) for path in results]


@dataclass(frozen=True)
class Grain:
    """One grain. x, v: m, m/s. omega: 1/s."""

    x: tuple[float, float, float]
    radius: float = 1.0e-3
    type: int = 1
    v: tuple[float, float, float] = (0.0, 0.0, 0.0)
    omega: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Material:
    """One contact law for all of three atom types. kn, kt: N/m; gamman, gammat: 1/s."""

    kn: float = 1.0e6
    kt: float = 5.0e5
    gamman: float = 0.0
    gammat: float = 0.0
    friction: float = 0.5


class Scene:
    """Grains in the box [0, 0.04] x [0, 0.02] x [0, 0.02] m, split along x between ranks.

    `style` is what follows `pair_style gran model hooke/stiffness`.
    """

    def __init__(self, comm, grains: list[Grain], material: Material = Material(), style: str = "tangential bond",
                 time_step: float = 1.0e-7, boundary: str = "f f f", skin: float = 5.0e-4):
        self.comm = comm
        self.open_engine(comm)
        self.commands(
            "units si", "atom_style granular", "atom_modify map array", f"boundary {boundary}", "newton off",
            "communicate single vel yes", "processors * 1 1", "region box block 0 0.04 0 0.02 0 0.02 units box",
            "create_box 3 box", f"neighbor {skin} bin", "neigh_modify delay 0 every 1")
        for grain in grains:
            self.commands("create_atoms {} single {:.17g} {:.17g} {:.17g} units box".format(grain.type, *grain.x))
        for number, grain in enumerate(grains, start=1):
            self.commands(
                f"set atom {number} diameter {2 * grain.radius:.17g} density 2500",
                "set atom {} vx {:.17g} vy {:.17g} vz {:.17g}".format(number, *grain.v),
                "set atom {} omegax {:.17g} omegay {:.17g} omegaz {:.17g}".format(number, *grain.omega))
        self.contact_law(material, style)
        self.commands(f"timestep {time_step:.17g}")

    @classmethod
    def from_restart(cls, comm, path: Path, material: Material = Material(), style: str = "tangential bond",
                     time_step: float = 1.0e-7, skin: float = 5.0e-4) -> "Scene":
        """A scene that goes on from a restart file."""
        scene = cls.__new__(cls)
        scene.comm = comm
        scene.open_engine(comm)
        scene.commands("newton off", "communicate single vel yes", "processors * 1 1", f"read_restart {path}",
                       f"neighbor {skin} bin", "neigh_modify delay 0 every 1")
        scene.contact_law(material, style)
        scene.commands(f"timestep {time_step:.17g}")
        return scene

    def open_engine(self, comm) -> None:
        from coupling.engine.liggghts import LiggghtsEngine

        self.engine = LiggghtsEngine(comm, Path("log.liggghts"))

    def contact_law(self, m: Material, style: str) -> None:
        def matrix(value: float) -> str:
            return " ".join([f"{value:.17g}"] * 9)

        for name in ("kn", "kt", "gamman", "gammat"):
            self.commands(f"fix m_{name} all property/global {name} peratomtypepair 3 {matrix(getattr(m, name))}")
        self.commands(f"fix m_mu all property/global coefficientFriction peratomtypepair 3 {matrix(m.friction)}",
                      f"pair_style gran model hooke/stiffness {style}", "pair_coeff * *")

    def commands(self, *lines: str) -> None:
        for line in lines:
            self.engine.command(line)

    def run(self, steps: int, setup: bool = True) -> None:
        self.engine.run(steps, setup)

    def gather(self, name: str) -> np.ndarray:
        """An array of all grains in the order of their ids, on every rank."""
        ids = np.concatenate(self.comm.allgather(self.engine.atom("id").copy()))
        values = np.concatenate(self.comm.allgather(self.engine.atom(name).copy()))
        return values[np.argsort(ids)]

    def assign(self, name: str, values: np.ndarray) -> None:
        """Write an array given in the order of ids (all grains) into the engine."""
        array, ids = self.engine.atom(name), self.engine.atom("id")
        array[:] = np.asarray(values)[ids - 1]

    def contact_rows(self) -> np.ndarray:
        """All contacts as rows of poreslip_contacts (M, 14), in the order of their ids."""
        c = self.engine.contacts()
        own = np.column_stack([c.id, c.type, c.bonded, c.normal_force, c.shear_force, c.overlap, c.point, c.energy]).reshape(-1, 14)
        rows = np.concatenate(self.comm.allgather(own))
        return rows[np.lexsort((rows[:, 1], rows[:, 0]))]

    def take_breaks(self) -> np.ndarray:
        """Breaks of all ranks (n, 10) in the order of step and ids."""
        rows = np.concatenate(self.comm.allgather(self.engine.take_breaks()))
        return rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]

    def intact_bonds(self) -> int:
        return sum(self.comm.allgather(self.engine.intact_bonds()))

    def fix_value(self, fix_id: str, column: int) -> float:
        """Value of f_ID[column] through a variable of the deck."""
        name = f"value_{fix_id}_{column}"
        self.commands(f"variable {name} equal f_{fix_id}[{column}]")
        return self.engine.variable(name)


def _main(job_path: str) -> None:
    from mpi4py import MPI

    sys.path[:0] = [str(REPOSITORY), str(Path(__file__).parent)]
    file_name, function_name, arguments = pickle.loads(Path(job_path).read_bytes())
    spec = importlib.util.spec_from_file_location(Path(file_name).stem, file_name)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    comm = MPI.COMM_WORLD
    try:
        result = getattr(module, function_name)(comm, **arguments)
    except Exception as error:
        from coupling.errors import PoreslipError

        if not isinstance(error, PoreslipError):
            raise
        print(f"{ERROR_MARK}{' '.join(str(error).split())}", file=sys.stderr, flush=True)
        sys.exit(3)
    Path(job_path).with_name(f"result-{comm.rank:03d}.pickle").write_bytes(pickle.dumps(result))


if __name__ == "__main__":
    _main(sys.argv[1])
