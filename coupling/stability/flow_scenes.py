"""Scenes of the pore network and the flow through it, on packs that are given: extremes of fluid, geometry and time step."""

from __future__ import annotations

import dataclasses

import numpy as np

from coupling.stability.scene import FAILED, REFUSED, STABLE, Outcome, Scene, bisected, limit

SIDE, DIAMETER, WATER, VISCOSITY = 0.01, 2e-3, 4.6e-10, 1e-3
GRADIENT = {"xmin": 1e5, "xmax": 0.0}


def grains(count: int = 5, spread: float = 0.1, seed: int = 1, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) m and radii (n,) m of count^3 grains in a box of SIDE, off a lattice by a part `spread` of its spacing; scale: of the radii."""
    random, spacing = np.random.default_rng(seed), SIDE / count
    centre = (np.stack(np.meshgrid(*[np.arange(count)] * 3), axis=-1).reshape(-1, 3) + 0.5) * spacing
    centre = centre + random.uniform(-spread, spread, centre.shape) * spacing
    return centre, 0.5 * spacing * scale * random.uniform(0.85, 1.0, len(centre))


def network_of(centre: np.ndarray, radius: np.ndarray):
    """Of the grains of all ranks, which are shared out in slabs."""
    from flowsolver import PoreNetwork
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    own = np.array_split(np.argsort(centre[:, 0], kind="stable"), comm.size)[comm.rank]
    network = PoreNetwork(comm, [0.0] * 3, [SIDE] * 3)
    network.update(own, centre[own], radius[own])
    return network


def everywhere(network, *facts: bool) -> bool:
    """Whether facts hold on all ranks."""
    return all(network.comm.allgather(all(map(bool, facts))))


def flow_of(network, viscosity: float = VISCOSITY, compressibility: float = WATER):
    from flowsolver.flow import PoreFlow

    return PoreFlow(network, viscosity, compressibility)


def driven(pressure=GRADIENT):
    from flowsolver.boundary import Boundary

    return Boundary(pressure=dict(pressure))


def geometry(centre: np.ndarray, radius: np.ndarray, tolerance: float = 1e-9) -> Outcome:
    """Volumes fill the box, a uniform pressure pushes no grain, the forces close against the walls, and a flow goes through."""
    network = network_of(centre, radius)
    filled = abs(network.comm.allreduce(network.cell_volume[network.owned].sum()) / SIDE**3 - 1.0)
    force, wall = network.forces(np.full(network.pores, 1e7))
    size = 1e7 * (2.0 * radius.max()) ** 2
    # Grains feel nothing of a uniform pressure but what the overlaps with walls leave; grains and walls together nothing at all.
    resultant = np.abs(network.comm.allreduce(force.sum(axis=0)) + (wall[:, 1::2] - wall[:, 0::2]).sum(axis=0)).max() / size
    result = flow_of(network).steady(driven())
    inside = everywhere(network, (result.pressure >= -1e-3).all(), (result.pressure <= 1e5 + 1e-3).all())
    pores, throats = network.limited()
    count = network.comm.allreduce(int(network.owned.sum()))
    words = (f"{len(radius)} grains, {count} pores, volume off by {filled:.1e}, resultant {resultant:.1e} p d^2, mass {result.mass_residual:.1e}, "
             f"limited {pores} pores, {throats} throats")  # fmt: skip
    sound = filled < tolerance and resultant < tolerance and result.mass_residual < 1e-8 and inside
    return Outcome(STABLE if sound else FAILED, words, ranks=network.comm.size)


def viscosity(value: float) -> Outcome:
    """Permeability does not depend on it, nor does the steady pressure."""
    network = network_of(*grains())
    reference, found = (flow_of(network, eta).steady(driven()) for eta in (VISCOSITY, value))
    share = found.outflow["xmax"] * value / (reference.outflow["xmax"] * VISCOSITY)
    step = flow_of(network, value).implicit(driven(), np.zeros(network.pores), 1e-7)
    words = f"k over that with 1e-3 Pa s - 1: {share - 1:.1e}; implicit step of 1e-7 s: mass {step.mass_residual:.1e}, {step.report['iterations']} iterations"
    sound = abs(share - 1.0) < 1e-8 and step.mass_residual < 1e-8 and everywhere(network, np.isfinite(step.pressure).all())
    return Outcome(STABLE if sound else FAILED, words, ranks=network.comm.size)


def compressibility(factor: float) -> Outcome:
    """Implicit steps between the pressures before and after: nothing over- or undershoots, and mass closes."""
    network = network_of(*grains())
    flow = flow_of(network, compressibility=factor * WATER)
    steady = flow.steady(driven()).pressure
    worst, bounded = 0.0, True
    for dt in (1e-14, 1e-10, 1e-6, 1e-2):
        result = flow.implicit(driven(), np.zeros(network.pores), dt)
        worst = max(worst, result.mass_residual)
        bounded &= everywhere(network, (result.pressure >= -1e-3).all(), (result.pressure <= steady * (1 + 1e-6) + 1e-3).all())
    words = f"steps of 1e-14 to 1e-2 s: mass {worst:.1e}, pressures within 0 and the steady ones"
    return Outcome(STABLE if bounded and worst < 1e-8 else FAILED, words, ranks=network.comm.size)


def contrast(decades: float) -> Outcome:
    """Conductances at random over so many decades, against dense elimination in the variables that are free."""
    network = network_of(*grains(4))
    flow = flow_of(network)
    flow.conductance = flow.conductance * 10.0 ** np.random.default_rng(1).uniform(-decades, 0.0, flow.conductance.shape)
    boundary = driven()
    result = flow.steady(boundary, tolerance=1e-13)
    given = flow.given(boundary)
    left, right = network.pores_of_throat[network.owned_throats].T
    matrix = np.zeros((network.pores, network.pores))
    for i, j in ((left, right), (right, left)):
        np.add.at(matrix, (i, i), flow.conductance)
        np.add.at(matrix, (i, j), -flow.conductance)
    exact = result.pressure.copy()
    free = ~given
    exact[free] = np.linalg.solve(matrix[np.ix_(free, free)], -matrix[np.ix_(free, given)] @ exact[given])
    off = np.abs(result.pressure - exact).max() / 1e5
    flow_off = abs(sum(result.outflow.values())) / abs(result.outflow["xmax"])
    words = f"pressure off dense elimination by {off:.1e} of the drop, outflow by {flow_off:.1e}, {result.report['iterations']} iterations"
    return Outcome(STABLE if off < 1e-6 and flow_off < 1e-6 else FAILED, words)


def _explicit():
    """A network with its flow and boundary, the pressures at the start, and the step beta V / sum(C / l), s."""
    network = network_of(*grains(4))
    flow, boundary = flow_of(network), driven()
    total = np.zeros(network.pores)
    left, right = network.pores_of_throat[network.owned_throats].T
    np.add.at(total, left, flow.conductance)
    np.add.at(total, right, flow.conductance)
    free = ~flow.given(boundary)
    return network, flow, boundary, float((flow.storage[free] / total[free]).min())


def explicit_limit() -> Outcome:
    """The native scheme with steps that the program never makes, from a pressure that changes sign from pore to pore."""
    from flowsolver.boundary import Conditions

    network, flow, boundary, predicted = _explicit()
    at = Conditions.of(network, boundary, np.random.default_rng(1).uniform(-1e5, 1e5, network.pores))

    def stable(share: float) -> bool:
        after, *_ = flow._native.step_explicit(at.fixed, at.given, at.source, at.volume_rate, 4000 * share * predicted, share, 10**7)
        return bool(np.abs(after).max() < 1e6)

    # 2 / (largest rate) of M-matrices: at least beta V / sum(C / l), where a pore alone would overshoot, and at most twice it.
    found = bisected(stable, 0.5, 2.2)
    return limit(found, 1.0, "of beta V / sum(C / l)", "largest steps whose pressures do not grow in 4000 of them", 1.05)


def explicit_step(share: float) -> Outcome:
    """Asked for a step of that share of the limit, the program makes as many as hold."""
    network, flow, boundary, predicted = _explicit()
    start = np.random.default_rng(1).uniform(-1e5, 1e5, network.pores)
    result = flow.explicit(boundary, start, share * predicted)
    exact = flow.explicit(boundary, start, share * predicted / 1000)
    for _ in range(999):
        exact = flow.explicit(boundary, exact.pressure, share * predicted / 1000)
    off = np.abs(result.pressure - exact.pressure).max() / 2e5
    words = f"{result.report['substeps']} steps, off a thousand by {off:.1e} of the pressures' range"
    return Outcome(STABLE if np.abs(result.pressure).max() <= 1e5 * (1 + 1e-9) and off < 0.2 else FAILED, words)


def explicit_for_long() -> Outcome:
    """1 s in steps of 1e-13 s: refused with the number of steps."""
    from flowsolver import InputError

    network, flow, boundary, _ = _explicit()
    try:
        flow.explicit(boundary, np.zeros(network.pores), 1.0)
    except InputError as error:
        return Outcome(REFUSED, str(error))
    return Outcome(FAILED, "made 1e13 steps in no time")


def pressure_jump() -> Outcome:
    """1e8 Pa on one side at once: between the given pressures at all times."""
    network = network_of(*grains())
    flow, boundary = flow_of(network), driven({"xmin": 1e8, "xmax": 0.0})
    pressure, worst, bounded = np.zeros(network.pores), 0.0, True
    for dt in np.geomspace(1e-13, 1e-3, 21):
        result = flow.implicit(boundary, pressure, dt, tolerance=1e-12)
        pressure, worst = result.pressure, max(worst, result.mass_residual)
        bounded &= everywhere(network, (pressure >= -1.0).all(), (pressure <= 1e8 + 1.0).all())
    words = f"21 implicit steps of 1e-13 to 1e-3 s: mass {worst:.1e}, pressures within 0 and 1e8 Pa"
    return Outcome(STABLE if bounded and worst < 1e-8 else FAILED, words, ranks=network.comm.size)


def none_at_all() -> Outcome:
    """No grains: there is no pore network."""
    from flowsolver import InputError
    from mpi4py import MPI

    try:
        network_of(np.zeros((0, 3)), np.zeros(0))
    except InputError as error:
        return Outcome(REFUSED, str(error), ranks=MPI.COMM_WORLD.size)
    return Outcome(FAILED, "a network of nothing")


def lattice(kind: str, off: float) -> tuple[np.ndarray, np.ndarray]:
    """Touching grains of a simple, body- or face-centred cubic lattice in the box, each moved by up to `off`, m."""
    base = {"sc": [[0.5] * 3], "bcc": [[0.25] * 3, [0.75] * 3], "fcc": [[0.25, 0.25, 0.25], [0.75, 0.75, 0.25], [0.75, 0.25, 0.75], [0.25, 0.75, 0.75]]}[kind]
    touching = {"sc": 0.5, "bcc": 3**0.5 / 4, "fcc": 2**0.5 / 4}[kind]
    cell = SIDE / 4
    corners = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 1, 3)
    centre = ((corners + np.array(base)) * cell).reshape(-1, 3) + np.random.default_rng(1).uniform(-off, off, (64 * len(base), 3))
    return centre, np.full(len(centre), touching * cell * (1.0 - 1e-9))


def graded() -> tuple[np.ndarray, np.ndarray]:
    """Radii ten to one apart, at random places that do not overlap by much."""
    random = np.random.default_rng(2)
    radius = np.sort(random.uniform(2e-4, 2e-3, 400) ** 1.0)[::-1]
    centre, kept = np.zeros((0, 3)), []
    for r in radius:
        for _ in range(60):
            x = random.uniform(r, SIDE - r, 3)
            if not len(kept) or (np.linalg.norm(centre - x, axis=1) > 0.97 * (np.array(kept) + r)).all():
                centre, kept = np.vstack([centre, x]), [*kept, r]
                break
    return centre, np.array(kept)


def slivers() -> tuple[np.ndarray, np.ndarray]:
    """Layers of grains that are flat to 1e-9 of the spacing, square in the plane: nearly flat and nearly cospherical cells throughout."""
    centre, radius = grains(5, 0.0)
    return centre + np.random.default_rng(3).uniform(-1e-9, 1e-9, centre.shape) * SIDE / 5, radius


def scenes() -> list[Scene]:
    """All of them, in the order of the table."""

    def on(function, *arguments):
        return lambda directory: function(*arguments)

    one, four = np.full((1, 3), 0.4 * SIDE), np.array([[0.3, 0.3, 0.3], [0.7, 0.3, 0.3], [0.5, 0.7, 0.3], [0.5, 0.45, 0.7]]) * SIDE
    found = [Scene(f"flow/viscosity/{eta:g}", f"viscosity {eta:g} Pa s", (STABLE,), on(viscosity, eta)) for eta in (1e-6, 1.0, 1e3)]
    found += [Scene(f"flow/compressibility/{c:g}", f"{c:g} times water's compressibility" if c else "incompressible", (STABLE,), on(compressibility, c), quick=c == 0)
              for c in (1e-4, 1e-2, 1e2, 1e4, 0.0)]  # fmt: skip
    found += [Scene(f"flow/contrast/1e{d}", f"conductances at random over {d} decades", (STABLE,), on(contrast, d), quick=d == 8) for d in (4, 8)]
    found += [Scene("flow/explicit/limit", "longest explicit step", (STABLE,), on(explicit_limit), quick=True)]
    found += [Scene(f"flow/explicit/{s:g}", f"explicit step asked for at {s:g} of its limit", (STABLE,), on(explicit_step, s), quick=s == 2) for s in (0.5, 1.0, 2.0)]
    found += [
        Scene("flow/explicit/long", "explicit steps for 1 s", (REFUSED,), on(explicit_for_long)),
        Scene("flow/jump", "pressure that jumps by 1e8 Pa", (STABLE,), on(pressure_jump), quick=True),
        Scene("flow/slivers", "layers flat to 1e-9 of the spacing", (STABLE,), lambda _: geometry(*slivers()), quick=True),
        *(Scene(f"flow/lattice/{k}", f"{k} lattice, all ties", (STABLE,), lambda _, k=k: geometry(*lattice(k, 0.0))) for k in ("sc", "bcc", "fcc")),
        Scene("flow/lattice/fcc_shaken", "fcc lattice, ties broken by 1e-12 of the box", (STABLE,), lambda _: geometry(*lattice("fcc", 1e-12 * SIDE))),
        Scene("flow/one_grain", "one grain", (STABLE,), lambda _: geometry(one, np.array([0.2 * SIDE]))),
        Scene("flow/four_grains", "four grains: a single pore between them", (STABLE,), lambda _: geometry(four, np.full(4, 0.18 * SIDE))),
        Scene("flow/no_grains", "no grains", (REFUSED,), on(none_at_all), quick=True),
        Scene("flow/overlap_5", "grains that overlap by up to 5 % of d", (STABLE,), lambda _: geometry(*grains(5, 0.0, scale=1.05))),
        Scene("flow/overlap_20", "grains that overlap by up to 20 % of d: three at a time", (STABLE,), lambda _: geometry(*grains(5, 0.05, scale=1.2))),
        Scene("flow/fluidised", "porosity 0.9", (STABLE,), lambda _: geometry(*grains(5, 0.2, scale=0.62))),
        Scene("flow/graded", "radii 10 to 1 apart", (STABLE,), lambda _: geometry(*graded())),
    ]  # fmt: skip
    # Matrices of whole packs, and pressures at random for each pore, are of one rank.
    return [dataclasses.replace(scene, spread=not scene.name.startswith(("flow/contrast", "flow/explicit"))) for scene in found]
