"""The report of a run: what it took, how long, and how good it is, as report.json and as a page to read."""

from __future__ import annotations

import resource

import numpy as np

from coupling.case_schema import RunCase
from coupling.engine.interface import Engine
from coupling.loading import Ending, Loading
from coupling.output import RunOutput
from coupling.phases import Phases

#: What the report says of the pack, from the stage's manifest.
PACK_FIGURES = ("grains", "floaters", "porosity_aim", "porosity", "porosity_bulk", "size_m", "stress_Pa", "friction")
#: Figures with the range in which a run counts as quasi-static and its contacts as stiff; outside it the report warns.
STATED_RANGES = {
    "unbalanced_force_ratio": (5e-2, "the loading is not quasi-static: lower loading.strain_rate_per_s"),
    "wall_stress_difference": (0.1, "left and right wall do not bear the same stress: lower loading.strain_rate_per_s"),
    "inertial_number": (1e-2, "the gouge flows inertially: lower loading.strain_rate_per_s"),
    "momentum_residual": (1e-10, "the fluid's forces on grains and walls do not sum to zero: a defect, please report it"),
    "work_residual": (1e-10, "the fluid's work is not that on grains and walls: a defect, please report it"),
    # Of an interval's throughput, which is next to nothing in a sealed pack at rest.
    "mass_residual": (1e-8, "the balance of the fluid's mass does not close: the linear solver did not converge far enough"),
    "remesh_mass_residual": (1e-12, "fluid was lost in a change of mesh: a defect, please report it"),
    "overlap_max_over_d": (2e-2, "grains overlap by more than 2 % of d: raise material.modulus_Pa, or lower the stress"),
}


def write_report(
    case: RunCase, comm, output: RunOutput, stage, state: dict, loading: Loading, flow, engine: Engine, ending: Ending, phases: Phases, wall_s: float
) -> None:  # fmt: skip
    """Write report.json and report.md, and print the warnings once; collective."""
    peak = comm.gather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    times = comm.gather(phases.to_dict())
    network = comm.gather(flow.report())
    if comm.rank:
        return
    steps = engine.step - state["step"]
    engine_cpu = sum(part["engine"]["cpu_s"] for part in times)
    warnings = [
        f"{name} reached {loading.worst[name]:.3g}, its range ends at {limit:g}: {advice}"
        for name, (limit, advice) in STATED_RANGES.items()
        if loading.worst.get(name, 0.0) > limit
    ]
    report = {
        "run": case.name,
        "ended": ending.reason,
        "complete": ending.complete,
        "grains": engine.total_grains,
        "steps": steps,
        "wall_s": wall_s,
        "cpu_s_by_phase_and_rank": times,
        "grain_steps_per_cpu_s": steps * engine.total_grains / engine_cpu if engine_cpu > 0 else 0.0,
        "peak_memory_bytes_by_rank": peak,
        "ranks": comm.size,
        "interpretations": {
            "stiffness_reading": case.material.stiffness_reading,
            "normal_stiffness_N_per_m": case.normal_stiffness_N_per_m,
            "bond_strength": "Table I's 1e9 Pa times pi min(R)^2" if case.bonded else "no bonds",
            "forces": case.flow.forces if case.needs_mesh else "none",
            "wall_stress": "total: contact force and fluid force over the wall's area",
            "contact_areas": "the pore pressure acts all round a grain, contact areas included",
        },
        "pack": {name: stage.manifest[name] for name in PACK_FIGURES if name in stage.manifest},
        "bonds": stage.manifest.get("bonds", 0),
        "reference": state["reference"],
        "quasi_static_checks": loading.worst,
        "wall_speed_limited_steps": {name: engine.wall(name).limited for name in loading.walls.plates},
        "pore_network_by_rank": network,
        **{name: loading.worst[name] for name in flow.residuals},
        "last": loading.last,
        "warnings": warnings,
    }
    output.json("report.json", _plain(report))
    output.text("report.md", page(case, report))
    for warning in warnings:
        print(f"{case.name}  warning: {warning}", flush=True)


def page(case: RunCase, report: dict) -> str:
    """The report as a page of Markdown."""
    lines = [f"# {case.title or case.case}: {case.name}", "", f"Ended: {report['ended']}.", ""]
    lines += [f"- {warning}" for warning in (f"**Warning**: {w}" for w in report["warnings"])]
    lines += ["", "## How good", "", "| figure | worst value | stated range ends at |", "|---|---|---|"]
    for name, value in report["quasi_static_checks"].items():
        limit = STATED_RANGES.get(name)
        lines.append(f"| {name} | {value:.4g} | {limit[0] if limit else ''} |")
    lines += ["", "## What was taken", "", "| input or interpretation | value |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in report["interpretations"].items()]
    lines += [f"| pack: {name} | {value} |" for name, value in report["pack"].items()]
    lines += [f"| bonds formed | {report['bonds']} |"]
    lines += ["", "## How long", "", f"{report['steps']} steps of {report['grains']} grains on {report['ranks']} ranks, {report['wall_s']:.1f} s,"]
    lines += [f"{report['grain_steps_per_cpu_s']:.3g} grain-steps per CPU second in the engine.", "", "| phase (rank 0) | CPU s | wall s | calls |", "|---|---|---|---|"]
    for name, spent in report["cpu_s_by_phase_and_rank"][0].items():
        lines.append(f"| {name} | {spent['cpu_s']:.2f} | {spent['wall_s']:.2f} | {spent['calls']} |")
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
