"""Whether the servos that hold stresses bear the fluid behind their walls: known once the pores are, before the first step.

A servo takes a wall of k_s = k_n N, N its contacts, by gain (target - force) / k_s in each step. While the fluid answers in each step, with a
stiffness k of its own, it overshoots ever more from gain (1 + k / k_s) = 2 on. With flow.split = "staggered" it answers after n steps, in which the
wall has come the share s = 1 - (1 - gain)^n of its way on contacts alone, and of what it answers the share l is left undrained at the solve:

    x' = x + s ((S - P) / k_s - x),   P' = l (P + k (x' - x))

for the wall's place x and the fluid's force P at solves, which is stable up to l k / k_s = (2 - s) (1 + l) / (2 s); the same for l = 1, n = 1. The wall moves
alone here, its nearest pores answer, and no grain yields. `poreslip stability --only
coupling/staggered/servo` finds the limit of 138 grains.
"""

from __future__ import annotations

import math

import numpy as np
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.network import PoreNetwork

from coupling.case.run_case import RunCase
from coupling.engine.interface import WallState
from coupling.errors import InputError
from coupling.fluid.two_way_checks import two_digits
from coupling.scene.walls import SceneWalls
from coupling.stages.deck_variables import servo_gains

#: Of the linear solver: shares are wanted, not pressures.
TOLERANCE = 1e-8


def check_servos(case: RunCase, network: PoreNetwork, flow: PoreFlow, boundary: Boundary, pressure: np.ndarray, walls: SceneWalls,
                 states: dict[str, WallState]) -> None:  # fmt: skip
    """Raise InputError if a servo would throw its wall about; collective. pressure: (m,) Pa, at the start. states: of the walls, by fix id."""
    troubles = []
    for name, gain in servo_gains(case).items():
        skeleton = case.normal_stiffness_N_per_m * max(states[name].contacts, 1)
        behind = _Behind(network, flow, boundary, pressure, *walls.plates[name])
        undrained = behind.stiffness / skeleton
        if case.flow.split != "staggered":
            troubles.append(_undrained_trouble(case, name, gain, undrained))
        elif undrained > 0.0:
            troubles.append(_staggered_trouble(case, name, gain, undrained, behind))
    # What holds for the worst of them holds for all.
    if any(troubles):
        raise InputError(max(filter(None, troubles))[1])


class _Behind:
    """The fluid behind one wall: what answers when the wall alone moves."""

    def __init__(self, network: PoreNetwork, flow: PoreFlow, boundary: Boundary, pressure: np.ndarray, face: int, parts: tuple[int, ...]):
        self._network, self._flow, self._boundary, self._pressure, self._face = network, flow, boundary, pressure, face
        self._groups = [part - 1 for part in parts if part <= network.native.groups]
        inwards = np.zeros((network.native.groups, 6))
        inwards[self._groups, face] = -1.0
        storage = np.divide(1.0, flow.storage, out=np.zeros(network.pores), where=~flow.given(boundary) & (flow.storage > 0.0))
        #: Pressure (m,) Pa per m of the wall's way, undrained.
        self._answer = -network.volume_rate(np.zeros((network.native.grains, 3)), inwards) * storage
        #: N/m: force on the wall per unit of its way while no pore drains.
        self.stiffness = self._force(self._answer)
        # A way that makes pressures of the size of those that stand.
        sizes = network.comm.allreduce(np.array([np.abs(pressure).max(initial=0.0), np.abs(self._answer).max(initial=0.0)]))
        self._way = max(sizes[0], 1.0) / sizes[1] if sizes[1] > 0.0 else 1.0

    def left(self, time: float) -> float:
        """Share of the stiffness that is left after an implicit step of so long, s."""
        # The same step with and without the answer: the difference knows nothing of what is held.
        moved, standing = (self._flow.implicit(self._boundary, self._pressure + way * self._answer, time, tolerance=TOLERANCE).pressure for way in (self._way, 0.0))
        return self._force((moved - standing) / self._way) / self.stiffness

    def _force(self, pressure: np.ndarray) -> float:
        return float(self._network.forces(pressure)[1][self._groups, self._face].sum())


def _undrained_trouble(case: RunCase, name: str, gain: float, stiffness: float) -> tuple[float, str] | None:
    """How bad it is, and what to say; None if the servo holds. stiffness: of the fluid, over that of the contacts."""
    most = 2.0 / gain - 1.0
    if stiffness < most:
        return None
    return stiffness / most, (
        f"{_wall(case, name)}: the fluid behind this wall is {stiffness:.3g} times as stiff as the contacts at it, and a servo holds a stress up to "
        f"{most:.3g} times. {_softer(case, stiffness)}, or set a fluid.compressibility_per_Pa of "
        f"{two_digits(case.fluid.compressibility_per_Pa * stiffness / most, math.ceil)} or more")


def _staggered_trouble(case: RunCase, name: str, gain: float, stiffness: float, behind: _Behind) -> tuple[float, str] | None:
    """As `_undrained_trouble`, where the fluid answers at solves alone."""

    def stable(steps: int) -> bool:
        share, remains = 1.0 - (1.0 - gain) ** steps, behind.left(steps * case.time_step_s)
        return remains * stiffness < (2.0 - share) * (1.0 + remains) / (2.0 * share)

    given = case.flow.interval_steps
    if stable(given):
        return None
    low, high = 0, given
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    softer = _softer(case, stiffness)
    other = 'set flow.split = "undrained"' if stiffness < 2.0 / gain - 1.0 else softer[0].lower() + softer[1:]
    return 1.0 / (1.0 + low), (
        f'flow.interval_steps = {given}: with flow.split = "staggered" the fluid behind the wall of {_wall(case, name)} answers its servo only at the solves, '
        f"and throws it about from {high} steps on ({stiffness:.3g} times as stiff as the contacts at it). "
        + (f"Set {low} or fewer, or {other}" if low else f"No interval is short enough: {other}"))


def _wall(case: RunCase, name: str) -> str:
    return f'sample.walls: {name} = "{case.sample.walls[name]}"' if case.scene == "sample" else f"the scene {case.scene}, {name}"


def _softer(case: RunCase, stiffness: float) -> str:
    """What else helps: the servo of a sample has no input of its own, that of a fault has."""
    if case.scene == "sample":
        return "Drain the wall (fluid.faces), move it at a speed"
    return f"Set a loading.deck_variables.servo_gain of at most {two_digits(2.0 / (1.0 + stiffness), math.floor)}"
