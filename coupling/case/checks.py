"""Whether a run makes sense: the range of each input, and inputs that have to fit one another."""

from __future__ import annotations

import ast
import dataclasses
import math
import operator
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from coupling.case.run_case import RunCase
from coupling.case.schema import EXPRESSION_NAMES, FACES, PACK, SECTIONS, Flow, Output

#: A key (dotted), and what is wrong with its value and what to do.
Problem = tuple[str, str]
#: Overlaps under the initial stress that a wall may move in a step: such a run warns of its loading rate from a twentieth of one on.
MOST_OVERLAPS = 10.0


def problems(run: RunCase) -> Iterator[Problem]:
    """All that is wrong with a run whose values have the right types; cross checks only once every value is in its range."""
    out_of_range = list(_ranges(run))
    yield from out_of_range
    if not out_of_range:
        for check in (_geometry, _loading, _flow, _pressure, _sample, _intervals, _deck_variables):
            yield from check(run)


def _ranges(run: RunCase) -> Iterator[Problem]:
    for section in SECTIONS:
        part = getattr(run, section)
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            values = value if isinstance(value, tuple) else (value,)
            if not all(_within(one, field.metadata) for one in values):
                yield f"{section}.{field.name}", f"allowed is {allowed_text(field)}"


def _within(value: Any, limits: Mapping[str, Any]) -> bool:
    if "choices" in limits:
        return value in limits["choices"]
    compare = {"above": operator.gt, "at_least": operator.ge, "below": operator.lt, "at_most": operator.le}
    return all(compare[name](value, limit) for name, limit in limits.items())


def allowed_text(field: dataclasses.Field) -> str:
    """What a key may hold, for messages: type, range, default."""
    limits = field.metadata
    kind = {
        "bool": "true or false",
        "int": "a whole number",
        "float": "a finite number",
        "str": "text in quotes",
        "tuple[float, float]": "two finite numbers, [smallest, largest]",
        "tuple[float, float, float]": "three finite numbers, [x, y, z]",
        "dict[str, float | int | str]": "a table of numbers and texts, { name = value }",
    }[field.type]
    if "choices" in limits:
        kind = "one of " + ", ".join(f'"{choice}"' for choice in limits["choices"])
    words = {"above": "above", "at_least": "at least", "below": "below", "at_most": "at most"}
    bounds = " and ".join(f"{words[name]} {limits[name]:g}" for name in words if name in limits)
    default = "" if field.default is dataclasses.MISSING else f"; the default is {toml_text(field.default)}"
    return kind + (f", {bounds}" if bounds else "") + default


def toml_text(value: Any) -> str:
    """A value as a case file writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_text(one) for one in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {toml_text(one)}" for name, one in value.items()) + " }"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _geometry(run: RunCase) -> Iterator[Problem]:
    smallest, largest = run.pack.diameter_m
    if smallest > largest:
        yield "pack.diameter_m", "the smallest diameter stands first and the largest second; swap them"
        return
    if min(run.pack.box_m) < 3.0 * largest:
        yield "pack.box_m", f"each side must hold three of the largest grains, {3.0 * largest:g} m; enlarge the box or choose smaller grains"
        return
    if run.estimated_grains > 2**31 - 1:
        yield "pack.diameter_m", f"the box would hold {run.estimated_grains:.3g} grains, more than the engine can number; choose larger grains"
        return
    if not run.has_fault:
        return
    length, _, height = run.pack.box_m
    width, dip = run.fault.gouge_width_m, math.radians(run.fault.dip_degrees)
    if width < 2.0 * largest:
        yield "fault.gouge_width_m", f"the gouge must hold two of the largest grains across, {2.0 * largest:g} m; widen it or choose smaller grains"
    if run.scene == "supplement" and run.fault.dip_degrees != 90.0:
        yield "fault.dip_degrees", 'the scene "supplement" has its fault\'s normal along x: set it to 90'
    if run.scene == "two_sides" and run.fault.dip_degrees == 90.0:
        yield "fault.dip_degrees", 'horizontal compression cannot shear a vertical fault: choose a dip below 90, or the scene "supplement"'
    # The layer meets the top face this far to one side of the middle, and the bottom face as far to the other.
    reach = width / (2.0 * math.sin(dip)) + height / 2.0 / math.tan(dip)
    if reach + 2.0 * largest > length / 2.0:
        yield (
            "fault.gouge_width_m",
            f"the gouge (width {width:g} m, dip {run.fault.dip_degrees:g}) reaches {reach:g} m to either side of the middle, and each block must keep "
            f"a strip of two of the largest grains between it and the x wall, {length / 2.0:g} m from the middle; narrow the gouge, "
            "raise fault.dip_degrees, or enlarge pack.box_m along x",
        )
    if run.fault.end_band_m > height / 4.0:
        yield "fault.end_band_m", f"at most a quarter of the box's height, {height / 4.0:g} m; it is meant to hold one layer of grains"


def _loading(run: RunCase) -> Iterator[Problem]:
    if run.bonds.strength_sd_Pa >= run.bonds.strength_mean_Pa:
        yield "bonds.strength_sd_Pa", f"must be below the mean strength, {run.bonds.strength_mean_Pa:g} Pa, or many bonds would have none"
    material, longest = run.material, run.stable_time_step_s(run.material.local_damping, run.material.friction > 0.0)
    if run.time_step_s > longest:
        holds = math.floor(100.0 * longest / run.critical_time_step_s) / 100.0
        yield "loading.time_step_fraction", (
            f"the step of {run.time_step_s:.3g} s is longer than the contacts bear, {longest:.3g} s with material.shear_stiffness_ratio "
            f"{material.shear_stiffness_ratio:g}, restitution {material.restitution:g} and local_damping {material.local_damping:g}; set at most {holds:g}")
    rate = {"supplement": "supplement.ramp_time_s", "sample": "sample.loading_time_s"}.get(run.scene, "loading.strain_rate_per_s")
    slower, faster = ("lower it", "raise it") if rate.endswith("rate_per_s") else ("lengthen it", "shorten it")
    if run.loading_steps < 10:
        yield rate, (f"loading takes {run.loading_steps} steps of {run.time_step_s:.3g} s, too few to follow the grains; {slower}, or see whether that step, which "
                     "material.modulus_Pa, pack.density_kg_m3 and pack.diameter_m decide, is as it should be")
    # Half of the rate to each x wall.
    step, overlap = 0.5 * run.loading.strain_rate_per_s * run.pack.box_m[0] * run.time_step_s, run.initial_overlap_m
    if run.scene == "two_sides" and step > MOST_OVERLAPS * overlap:
        yield "loading.vertical_stress_Pa", (
            f"presses grains of this stiffness into each other by about {overlap:.2g} m, and a wall moves {step:.2g} m in one step at loading.strain_rate_per_s = "
            f"{run.loading.strain_rate_per_s:g}: no contact bears that. It is in Pa (1e7 is 10 MPa): raise it, or lower the rate to less than "
            f"{MOST_OVERLAPS * run.loading.strain_rate_per_s * overlap / step:.2g}")
    if run.loading_steps > 2**31 - 1:
        yield rate, f"loading takes {run.loading_steps:.3g} steps of {run.time_step_s:.3g} s, more than the engine can count; {faster}"


def _flow(run: RunCase) -> Iterator[Problem]:
    if run.scene == "sample" and run.flow.kind == "prescribed":
        yield "flow.kind", 'the scene "sample" has no fault to prescribe a pressure by: set "solve", or "none" for a dry run'
    if run.flow.kind == "solve":
        yield from _fluid(run)
    for face, pressure in run.fluid.faces.items():
        if face not in FACES:
            yield "fluid.faces", f"{face} is no face; allowed are {', '.join(FACES)}"
        elif not isinstance(pressure, int | float):
            yield "fluid.faces", f"the pressure of {face} is a number of Pa, not {toml_text(pressure)}"


def _fluid(run: RunCase) -> Iterator[Problem]:
    fluid = run.fluid
    if fluid.compressibility_per_Pa == 0.0:
        if run.flow.two_way and run.flow.split != "staggered":
            yield "fluid.compressibility_per_Pa", f'must be above 0 with flow.split = "{run.flow.split}", in which the pores store what is squeezed; set "staggered"'
        if run.scene == "sample" and not fluid.faces:
            yield "fluid.compressibility_per_Pa", "must be above 0 in a sealed box; or hold a pressure at one of fluid.faces"
    if run.flow.two_way and run.flow.split == "staggered":
        # Deferred: the estimate needs numpy.
        from coupling.case.staggered_limit import MARGIN, layers_of, range_text

        longest = layers_of(run).longest_interval()
        if run.flow.interval_steps > MARGIN * longest:
            shorter = f"set {longest} or fewer, or " if longest else "set "
            yield (
                "flow.interval_steps",
                f'with flow.split = "staggered" this fluid throws the grains about where solves are too far apart, from {range_text(longest)} on: {shorter}'
                'flow.split = "undrained" or "predicted"',
            )
    if run.has_fault and fluid.faces:
        yield "fluid.faces", f'has no effect in the scene "{run.scene}", where [pressure] and fluid.held say what is held; leave it out'
    if run.has_fault and fluid.initial_pressure_Pa:
        yield "fluid.initial_pressure_Pa", f'has no effect in the scene "{run.scene}", which begins with the field of [pressure]; leave it out'


def _sample(run: RunCase) -> Iterator[Problem]:
    if run.scene != "sample":
        return
    stressed = False
    for name, motion in run.sample.walls.items():
        if name not in PACK:
            yield "sample.walls", f"{name} is no wall; allowed are {', '.join(PACK)}"
            continue
        try:
            kind, number = run.sample.motion(name)
            stressed |= kind == "stress"
            if kind == "stress" and number < 0.0 and run.flow.kind != "solve":
                yield "sample.walls", f"{name} = {toml_text(motion)} pulls, and grains hold no wall back: give a stress of 0 or more, positive in compression"
        except ValueError:
            yield "sample.walls", f'{name} = {toml_text(motion)} is none of "fixed", "speed V" (m/s, into the box) and "stress S" (total, Pa)'
    if stressed and run.sample.ramp_time_s > run.sample.loading_time_s:
        yield "sample.ramp_time_s", f"must not be longer than sample.loading_time_s, {run.sample.loading_time_s:g}, or the stresses would not be reached"


def _pressure(run: RunCase) -> Iterator[Problem]:
    pressure = run.pressure
    if pressure.mode == "none" or run.scene == "sample":
        return
    if run.flow.kind == "none":
        yield "flow.kind", f'with "none" the pressure of mode "{pressure.mode}" would act on no grain; set flow.kind = "prescribed", or pressure.mode = "none" for a dry run'
    if pressure.mode == "expression":
        trouble = _expression_trouble(run)
        if trouble:
            yield "pressure.expression", trouble
        return
    if pressure.expression:
        yield "pressure.expression", f'has no effect in mode "{pressure.mode}"; set pressure.mode = "expression" or leave it out'
    if pressure.mode == "uniform" and pressure.left_target_Pa != pressure.right_target_Pa:
        yield "pressure.right_target_Pa", f'must equal left_target_Pa, {pressure.left_target_Pa:g}, in mode "uniform"; choose mode "linear" for two pressures'
    if pressure.left_target_Pa == pressure.right_target_Pa == 0.0:
        yield "pressure.mode", 'both targets are 0: give left_target_Pa or right_target_Pa, or set pressure.mode = "none" for a dry run'


def _expression_trouble(run: RunCase) -> str | None:
    """What is wrong with a pressure formula, found from its names and from its values over the box before and after loading."""
    text = run.pressure.expression.strip()
    names = ", ".join(EXPRESSION_NAMES)
    if not text:
        return f'mode "expression" needs a formula, such as "p_left * (s < 0)"; it may name {names}'
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError) as error:
        return f"is not a formula ({error.args[0]}); write it as in Python, with ** for powers, & and | for and, or"
    # Deferred: only a case with a formula needs numexpr, which takes a tenth of a second to import.
    import numexpr
    import numpy as np
    from numexpr.expressions import functions

    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    named = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - called
    if unknown := sorted(named - set(EXPRESSION_NAMES)):
        return f"names {', '.join(unknown)}, but it may name only {names}"
    if unknown := sorted(called - set(functions)):
        return f"calls {', '.join(unknown)}, but it may call only {', '.join(sorted(functions))}"

    x, y, z = (axis.ravel() for axis in np.meshgrid(*(np.linspace(0.0, side, 9) for side in run.pack.box_m), indexing="ij"))
    dip = math.radians(run.fault.dip_degrees)
    length, _, height = run.pack.box_m
    s = (x - length / 2.0) * math.sin(dip) + (z - height / 2.0) * math.cos(dip)
    targets = run.pressure.left_target_Pa, run.pressure.right_target_Pa
    for fraction in (0.0, 1.0):
        values = {"x": x, "y": y, "z": z, "s": s, "width": run.fault.gouge_width_m, "p_t": max(targets)}
        values |= {"strain": fraction * run.loading.horizontal_strain, "time": fraction * run.loading_time_s}
        values |= {"p_left": fraction * targets[0], "p_right": fraction * targets[1]}
        try:
            result = np.broadcast_to(numexpr.evaluate(text, local_dict=values, global_dict={}), x.shape)
        except Exception as error:  # numexpr raises whatever its own evaluation met
            return f"cannot be evaluated ({error})"
        if result.dtype.kind not in "fi":
            return f"yields {'true or false' if result.dtype.kind == 'b' else 'complex numbers'}, not a pressure in Pa"
        if not np.isfinite(result).all():
            worst = int(np.argmin(np.isfinite(result)))
            return (
                f"yields {result[worst]} at x = {x[worst]:g}, y = {y[worst]:g}, z = {z[worst]:g} m and strain {values['strain']:g}; "
                "it must be finite everywhere in the box"
            )
    return None


def _intervals(run: RunCase) -> Iterator[Problem]:
    steps, flow, output = run.loading_steps, run.flow.interval_steps, run.output
    if output.history_interval_steps > steps:
        yield "output.history_interval_steps", f"loading takes {steps} steps, so nothing would be written; lower it"
    if output.snapshots > steps:
        yield "output.snapshots", f"loading takes {steps} steps, so there cannot be more snapshots; lower it"
    if not run.needs_mesh:
        return
    if run.flow.interval_tolerance > 0.0:
        yield from _following_intervals(run.flow, output)
        return
    if flow > steps:
        yield "flow.interval_steps", f"loading takes {steps} steps, so the forces would never change; lower it"
    for key, interval in (
        ("output.history_interval_steps", output.history_interval_steps),
        ("output.checkpoint_every_steps", output.checkpoint_every_steps),
    ):
        if interval % flow:
            nearest = max(1, round(interval / flow)) * flow
            yield key, f"must be a multiple of flow.interval_steps, {flow}, so that it falls on an update of the pore forces; {nearest} is the nearest"


def _following_intervals(flow: Flow, output: Output) -> Iterator[Problem]:
    key = "flow.interval_tolerance"
    if flow.kind != "solve" or not flow.two_way:
        yield key, 'intervals follow the error of a two-way flow alone; leave it out, or set flow.kind = "solve" and flow.two_way = true'
    elif flow.split == "staggered":
        yield key, 'flow.split = "staggered" bears intervals only up to a limit that does not follow from their error; leave it out, or set flow.split = "predicted" or "undrained"'
    elif (steps := output.checkpoint_every_steps) % (every := output.history_interval_steps):
        yield "output.checkpoint_every_steps", (
            f"must be a multiple of output.history_interval_steps, {every}, where intervals end that follow flow.interval_tolerance; {max(1, round(steps / every)) * every} is the nearest")


def _deck_variables(run: RunCase) -> Iterator[Problem]:
    load_deck = "in.load" if run.scene == "two_sides" else f"in.load_{run.scene}"
    for section, deck in (("pack", "in.pack"), ("loading", load_deck)):
        if given := getattr(run, section).deck_variables:
            known = _variables_of_deck(Path(run.decks_directory), deck)
            if unknown := sorted(set(given) - known):
                yield (
                    f"{section}.deck_variables",
                    f"the deck {Path(run.decks_directory) / deck} has no line `variable {unknown[0]} index`, so the value would have no effect; its variables: "
                    + ", ".join(sorted(known)),
                )


def _variables_of_deck(directory: Path, deck: str) -> set[str]:
    """Names of the `variable ... index` lines of a deck and of the files that it includes by their full names."""
    if not (directory / deck).is_file():
        return set()
    text = (directory / deck).read_text(encoding="utf-8", errors="replace")
    included = re.findall(r"^include\s+\$\{inputs\}/([\w.]+)\s", text, flags=re.MULTILINE)
    texts = [text, *((directory / name).read_text(encoding="utf-8", errors="replace") for name in included if (directory / name).is_file())]
    return {name for one in texts for name in re.findall(r"^variable\s+(\w+)\s+index\b", one, flags=re.MULTILINE)}
