"""What a case file would do, without doing it: `poreslip run --dry-run`."""

from __future__ import annotations

from coupling.case.run_case import CaseFile, RunCase

#: For the estimate only, in round numbers for one core: grain-steps per second with bonds and damping, bytes per grain of the engine and of
#: the pore network, and the network's time per grain and update. What a run came to is in its report.json.
GRAIN_STEPS_PER_S = 4.0e6
ENGINE_BYTES_PER_GRAIN = 6.0e3
NETWORK_BYTES_PER_GRAIN = 4.0e3
UPDATE_S_PER_GRAIN = 1.0e-6
#: Two-way coupling: the pressures' answer to a step, and a solve of the flow.
RESPONSE_S_PER_GRAIN, SOLVE_S_PER_GRAIN = 4.0e-8, 5.0e-6
PACKING_STEPS = 15_000


def plan(case_file: CaseFile, ranks: int) -> str:
    """Stages, steps, and the estimated time and memory of each run."""
    lines = [f"{case_file.stem}: {len(case_file.runs)} run{'s' if len(case_file.runs) != 1 else ''} on {ranks} rank{'s' if ranks > 1 else ''}", ""]
    packs: set[tuple] = set()
    total = 0.0
    for run in case_file.runs:
        lines += _run_plan(run)
        seconds = _loading_seconds(run)
        pack = (run.pack, run.material, run.fault, run.bonds)
        if pack not in packs:
            packs.add(pack)
            packing = PACKING_STEPS * run.estimated_grains / GRAIN_STEPS_PER_S
            lines.append(f"    stages before loading, once for this pack and only if not kept from before: {_duration(packing / run.pack.ranks)}")
            total += packing * ranks / run.pack.ranks
        total += seconds
        lines.append(f"    loading: {_duration(seconds / ranks)}, {memory_bytes(run) / 1e6:.0f} MB")
        lines.append("")
    lines.append(f"estimated in all: {_duration(total / ranks)}; nothing was run")
    return "\n".join(lines)


def _run_plan(run: RunCase) -> list[str]:
    bonds = "contact bonds in the blocks" if run.bonded else "no bonds"
    pressure = f"{run.pressure.mode} pressure"
    if run.flow.kind == "solve":
        pressure = f"two-way flow ({run.flow.split})" if run.flow.two_way else "one-way flow"
    flow = f"{pressure}, {run.flow.forces} forces, {_intervals(run)}" if run.needs_mesh else "dry"
    return [
        f"  {run.name}: scene {run.scene}, about {run.estimated_grains} grains, {bonds}, {flow}",
        f"    k_n {run.normal_stiffness_N_per_m:.4g} N/m ({run.material.stiffness_reading}), step {run.time_step_s:.3g} s, {run.loading_steps} steps",
    ]


def _intervals(run: RunCase) -> str:
    tolerance = run.flow.interval_tolerance
    return f"every {run.flow.interval_steps} steps" + (f" or sooner, interval error {tolerance:g}" if tolerance > 0.0 else "")


def _loading_seconds(run: RunCase) -> float:
    seconds = run.loading_steps * run.estimated_grains / GRAIN_STEPS_PER_S
    if run.needs_mesh:
        seconds += run.loading_steps / run.flow.interval_steps * run.estimated_grains * UPDATE_S_PER_GRAIN
    if run.flow.kind == "solve":
        seconds += run.loading_steps / run.flow.interval_steps * run.estimated_grains * SOLVE_S_PER_GRAIN
        if run.flow.two_way:
            seconds += run.loading_steps * run.estimated_grains * RESPONSE_S_PER_GRAIN
    return seconds


def memory_bytes(run: RunCase) -> float:
    """Estimated memory of a run on all ranks."""
    return 1e8 + run.estimated_grains * (ENGINE_BYTES_PER_GRAIN + (NETWORK_BYTES_PER_GRAIN if run.needs_mesh else 0.0))


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
