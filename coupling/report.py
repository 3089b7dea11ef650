"""The report of a run: what it took, how long, and how good it is, as report.json and as a page to read.

It holds what the run has: no counts of a mesh, a solver or bonds where there are none.
"""

from __future__ import annotations

import numpy as np

from coupling.case.run_case import RunCase
from coupling.collective import raised_together
from coupling.engine.interface import Engine
from coupling.loading import Ending, Loading
from coupling.results.output import RunOutput
from coupling.results.phases import Phases, peak_memory_bytes
from coupling.results.stated_ranges import BALANCES, STATED_RANGES, warnings

#: What the report says of the pack, from the stage's manifest.
PACK_FIGURES = ("grains", "floaters", "porosity_aim", "porosity", "porosity_bulk", "size_m", "stress_Pa", "friction")
#: Phase that is made once for all runs with the same pack, and no part of a run's own time.
STAGES = "stages"
READINGS = {
    "effective-modulus": "material.modulus_Pa is an effective modulus E*: k_n = pi min(R)^2 E* / (R1 + R2)",
    "older-pfc": "material.modulus_Pa is PFC's E_c: k_n = 4 R E_c",
    "literal": "material.modulus_Pa is k_n itself, in N/m",
}
#: Beginnings of columns of the history that are of the fluid, and of the bonds: 0 in a run without.
OF_FLUID, OF_BONDS = ("mesh_", "p_left_", "p_right_", "pressure_", "outflow_"), ("bonds_",)
PERIMETERS = {
    "duct": "whole: the arcs of the grains and the open gaps between them",
    "hydraulic-radius": "none: a throat's hydraulic radius is its void over its solid surface",
}


def write_report(
    case: RunCase, comm, output: RunOutput, stage, state: dict, loading: Loading, flow, engine: Engine, ending: Ending, phases: Phases
) -> None:  # fmt: skip
    """Write report.json and report.md, and print the warnings once; collective."""
    peak, times = comm.gather(peak_memory_bytes()), comm.gather(phases.to_dict())
    network, meshes = comm.gather(flow.report()), flow.meshes
    report = _content(case, stage, state, loading, flow, engine, ending, phases, peak, times, network, meshes) if comm.rank == 0 else None
    with raised_together(comm):
        if report is not None:
            output.json("report.json", _plain(report))
            output.text("report.md", page(case, report))
    for warning in report["warnings"] if report is not None else ():
        print(f"{case.name}  warning: {warning}", flush=True)


def _content(case: RunCase, stage, state: dict, loading: Loading, flow, engine: Engine, ending: Ending, phases: Phases, peak: list, times: list, network: list,
             meshes: dict) -> dict:  # fmt: skip
    """What report.json holds. peak, times, network: of all ranks, the last since the newest checkpoint."""
    steps = engine.step
    of_fluid: dict[str, object] = {}
    if case.needs_mesh:
        of_fluid["balances"] = {name: {"worst": loading.worst[name], "final": flow.final.get(name, 0.0)} for name in BALANCES if name in loading.worst}
        of_fluid |= {name: loading.worst[name] for name in flow.residuals}
        of_fluid |= {"interval_error": interval} if (interval := flow.interval_figures()) else {}
        of_fluid |= {"solver": flow.solver} if case.flow.kind == "solve" else {}
        of_fluid |= {"remeshes": meshes, "pore_network_by_rank": network}
    broken = {mode: loading.broken[mode] for mode in ("tension", "shear")}
    return {
        "run": case.name,
        "ended": ending.reason,
        "complete": ending.complete,
        "grains": engine.total_grains,
        "steps": steps,
        "ranks": len(times),
        "restarted_at_steps": phases.restarts,
        "wall_s": phases.wall_s,
        **speeds(times, steps * engine.total_grains),
        "cpu_s_by_phase_and_rank": times,
        "peak_memory_bytes_by_rank": peak,
        "warnings": warnings(loading.worst, case.scene, loading.uncounted),
        "quasi_static_checks": loading.worst,
        **of_fluid,
        **({"bonds": stage.manifest["bonds"], "bonds_broken": broken} if case.bonded else {}),
        "interpretations": interpretations(case),
        "pack": {name: stage.manifest[name] for name in PACK_FIGURES if name in stage.manifest},
        "reference": state["reference"],
        "wall_speed_limited_steps": {name: engine.wall(name).limited for name in loading.walls.plates},
        "last": last_line(case, loading.last),
    }


def last_line(case: RunCase, line: dict[str, float]) -> dict[str, float]:
    """The last line of the history without the columns of what the case does not have."""
    absent = (*(() if case.needs_mesh else OF_FLUID), *(() if case.bonded else OF_BONDS))
    return {name: value for name, value in line.items() if not name.startswith(absent)}


def interpretations(case: RunCase) -> dict[str, object]:
    """How the case reads what the paper leaves open, of what this run takes."""
    taken: dict[str, object] = {
        "stiffness_reading": READINGS[case.material.stiffness_reading],
        "normal_stiffness_N_per_m": case.normal_stiffness_N_per_m,
        "bond_strength": f"{case.bonds.strength_mean_Pa:g} Pa (standard deviation {case.bonds.strength_sd_Pa:g} Pa) times pi min(R)^2" if case.bonded else "no bonds",
        "wall_stress": f"total: {'contact force and fluid force' if case.needs_mesh else 'contact force'} over the wall's area",
    }
    if case.needs_mesh:
        taken["forces"] = case.flow.forces
        taken["contact_areas"] = "the pore pressure acts all round a grain, contact areas included"
    if case.flow.kind == "solve":
        taken |= {"conductance": case.fluid.conductance, "perimeter": PERIMETERS[case.fluid.conductance]}
        taken |= {"coupling": "two-way", "split": case.flow.split} if case.flow.two_way else {"coupling": "one-way: the grains do not squeeze the fluid"}
        if case.has_fault:
            taken["pressure_held"] = f"in the {case.fluid.held}" if case.fluid.held == "blocks" else "at the blocks' outer faces"
    return taken


def speeds(times: list[dict], grain_steps: int) -> dict[str, float]:
    """Seconds of loading, without the stages before it: CPU seconds of all ranks, wall seconds of the slowest; and grain-steps per second, of
    the whole and of the engine alone."""
    loading = [{name: spent for name, spent in part.items() if name != STAGES} for part in times]
    cpu = sum(spent["cpu_s"] for part in loading for spent in part.values())
    wall = max(sum(spent["wall_s"] for spent in part.values()) for part in loading)
    engine = sum(part["engine"]["cpu_s"] for part in loading)
    rates = {"grain_steps_per_s": wall, "grain_steps_per_cpu_s": cpu, "grain_steps_per_engine_cpu_s": engine}
    return {"loading_wall_s": wall, "loading_cpu_s": cpu} | {name: grain_steps / seconds if seconds > 0 else 0.0 for name, seconds in rates.items()}


def page(case: RunCase, report: dict) -> str:
    """The report as a page of Markdown."""
    lines = [f"# {case.title or case.case}: {case.name}", "", f"Ended: {report['ended']}.", ""]
    lines += [f"- **Warning**: {warning}" for warning in report["warnings"]]
    lines += ["", "## How good", "", "| figure | worst | final | stated range ends at | |", "|---|---|---|---|---|"]
    for name, value in report["quasi_static_checks"].items():
        stated = STATED_RANGES.get(name)
        final = report.get("balances", {}).get(name, {}).get("final", report["last"].get(name))
        shown = "" if final is None else f"{final:.3g}"
        lines.append(f"| {name} | {value:.3g} | {shown} | {stated.highest if stated else ''} | {stated.what if stated else ''} |")
    counts = [f"| mesh {kind} | {count} |" for kind, count in report.get("remeshes", {}).items()]
    counts += [f"| interval error: {name.replace('_', ' ')} | {value:.4g} |" for name, value in report.get("interval_error", {}).items()]
    counts += [f"| solver: {name.replace('_', ' ')} | {value:.4g} |" for name, value in report.get("solver", {}).items()]
    counts += [f"| bonds formed | {report['bonds']} |"] if "bonds" in report else []
    counts += [f"| bonds broken in {mode} | {count} |" for mode, count in report.get("bonds_broken", {}).items()]
    lines += ["", "| count | |", "|---|---|", *counts] if counts else []
    lines += ["", "## What was taken", "", "| input or interpretation | value |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in report["interpretations"].items()]
    lines += [f"| pack: {name} | {value} |" for name, value in report["pack"].items()]
    lines += ["", "## How long", ""]
    lines += [f"{report['steps']} steps of {report['grains']} grains on {report['ranks']} ranks: {report['loading_wall_s']:.1f} s, "
              f"{report['loading_cpu_s']:.1f} CPU s"]
    lines += [f"without the stages before loading; {report['grain_steps_per_cpu_s']:.3g} grain-steps per CPU second, "
              f"{report['grain_steps_per_engine_cpu_s']:.3g} in the"]
    lines += [f"engine alone. Peak memory: {', '.join(f'{peak / 1e6:.0f}' for peak in report['peak_memory_bytes_by_rank'])} MB by rank."]
    if restarts := report["restarted_at_steps"]:
        times = "once, at step" if len(restarts) == 1 else f"{len(restarts)} times, at steps"
        lines += ["", f"Restarted from a checkpoint {times} {', '.join(map(str, restarts))}. Steps, seconds and counts are those of the whole run, without what was",
                  "made between a checkpoint and the restart from it; memory, and what is told of the pore network by rank, are those of the last part."]
    lines += [""]
    lines += ["| phase | CPU s of all ranks | wall s of the slowest | calls |", "|---|---|---|---|"]
    parts = report["cpu_s_by_phase_and_rank"]
    for name in parts[0]:
        spent = [part[name] for part in parts if name in part]
        lines.append(f"| {name} | {sum(one['cpu_s'] for one in spent):.2f} | {max(one['wall_s'] for one in spent):.2f} | {spent[0]['calls']} |")
    lines += ["", "## At the end", "", "| | |", "|---|---|"]
    lines += [f"| {name} | {value:.6g} |" for name, value in report["last"].items()]
    return "\n".join(lines) + "\n"


def _plain(value):
    """Numbers of numpy as those of Python, for JSON."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
