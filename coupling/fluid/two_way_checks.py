"""Whether the engine's step bears the fluid between the grains: known once the pores are, before the first step."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.network import PoreNetwork
from flowsolver.two_way_limit import undrained_time_step

from coupling.case.run_case import RunCase
from coupling.errors import InputError


def check_undrained(case: RunCase, mass: np.ndarray, network: PoreNetwork, flow: PoreFlow, boundary: Boundary) -> None:
    """Raise InputError if steps in which no pore drains would be unstable; collective. mass: (n,) kg, of this rank's grains."""
    contacts = case.stable_time_step_s(case.material.local_damping, case.material.friction > 0.0)
    # Local damping makes the fluid's forces that drive grains back larger too.
    fluid = undrained_time_step(network, flow, boundary, mass) / math.sqrt(1.0 + case.material.local_damping)
    together = 1.0 / math.hypot(1.0 / contacts, 1.0 / fluid)
    step, given = case.time_step_s, case.fluid.compressibility_per_Pa
    if step > together:
        fraction = case.loading.time_step_fraction
        other = f", a fluid.compressibility_per_Pa of {two_digits(given * (step / fluid) ** 2 / (1.0 - (step / contacts) ** 2), math.ceil)} or more" if step < contacts else ""
        raise InputError(
            f"loading.time_step_fraction = {fraction:g}: the step of {step:.3g} s is longer than grains bear whose pores cannot drain in it, {together:.3g} s "
            f"(contacts alone {contacts:.3g} s, the fluid alone {fluid:.3g} s). Set {two_digits(fraction * together / step, math.floor)}{other}, or "
            'flow.split = "staggered" where the fluid drains within flow.interval_steps')


def two_digits(number: float, whole: Callable[[float], int]) -> str:
    """Rounded up or down to two digits by `whole`, math.ceil or math.floor."""
    scale = 10.0 ** (math.floor(math.log10(number)) - 1)
    return f"{whole(number / scale) * scale:.2g}"
