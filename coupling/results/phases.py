"""Where a run's time and memory go."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Phases:
    """Wall and CPU seconds, and calls, by phase, of this rank. Each second counts once: for the innermost phase that is being timed.

    stages: pack, initial stress, bonds. engine: the grains' steps. tessellation: the mesh, kept or made. geometry: throats and volumes.
    assembly, solve: of the linear system. forces: of the fluid on grains and walls, with the pressures' answer to each step. exchange: arrays
    to and from the engine. pressure: given ones. flow: what else the fluid takes. measures, output: of the history.
    """

    def __init__(self) -> None:
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._within: list[list[float]] = []
        self._started, self._wall_before = time.perf_counter(), 0.0
        #: Steps of the checkpoints that the run went on from.
        self.restarts: list[int] = []

    @property
    def wall_s(self) -> float:
        """Wall seconds of the whole run, up to now; between a checkpoint and a restart from it none."""
        return self._wall_before + time.perf_counter() - self._started

    def state(self, comm) -> dict:
        """What a checkpoint has to hold of it; collective."""
        return {"by_rank": comm.allgather(self.to_dict()), "wall_s": self.wall_s, "restarts": self.restarts}

    def resume(self, state: dict, step: int, comm) -> None:
        """Go on counting from a checkpoint of this step. On another number of ranks each gets an even share of the CPU time, and the longest of
        the wall times."""
        by_rank, self._wall_before, self.restarts = state["by_rank"], state["wall_s"], [*state["restarts"], step]
        for name in dict.fromkeys(name for one in by_rank for name in one):
            spent = [one[name] for one in by_rank if name in one]
            if len(by_rank) == comm.size:
                spent = [by_rank[comm.rank][name]] if name in by_rank[comm.rank] else []
            share = 1.0 if len(by_rank) == comm.size else 1.0 / comm.size
            if spent:
                self._add(name, max(one["wall_s"] for one in spent), share * sum(one["cpu_s"] for one in spent), spent[0]["calls"])

    @contextmanager
    def timed(self, phase: str) -> Iterator[None]:
        """Add the block's time, but for what phases inside of it take, to ``phase``."""
        inside = [0.0, 0.0]
        self._within.append(inside)
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            yield
        finally:
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            self._within.pop()
            if self._within:
                self._within[-1][0] += wall
                self._within[-1][1] += cpu
            self._add(phase, wall - inside[0], cpu - inside[1], 1)

    def shared(self, phase: str, seconds: dict[str, float]) -> None:
        """Hand part of a phase's time on to others. seconds: wall seconds of each, measured by what was called; CPU time goes with them."""
        rate = self.cpu[phase] / self.wall[phase] if self.wall.get(phase) else 0.0
        for name, wall in seconds.items():
            self._add(name, wall, rate * wall, 1)
            self._add(phase, -wall, -rate * wall, 0)

    def _add(self, phase: str, wall: float, cpu: float, calls: int) -> None:
        self.wall[phase] = self.wall.get(phase, 0.0) + wall
        self.cpu[phase] = self.cpu.get(phase, 0.0) + cpu
        self.calls[phase] = self.calls.get(phase, 0) + calls

    def to_dict(self) -> dict[str, dict[str, float]]:
        return {name: {"wall_s": self.wall[name], "cpu_s": self.cpu[name], "calls": self.calls[name]} for name in self.wall}


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far (Linux). getrusage would count that of the process which started it, too."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])
