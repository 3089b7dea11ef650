"""Flow: balances that close, solutions that are known, steps that converge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import ComputationError, InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

DRIVEN = Boundary(pressure={"xmin": 1e5, "xmax": 0.0})
SEALED = Boundary()


def make_network(count=150, radius=(0.05, 0.09), seed=4, periodic=(False,) * 3) -> PoreNetwork:
    x, r = random_pack(count, radius, seed)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    net.update(np.arange(count), x, r)
    return net


@pytest.fixture(scope="module")
def network() -> PoreNetwork:
    return make_network()


@pytest.fixture(scope="module")
def small() -> PoreNetwork:
    return make_network(20, (0.1, 0.16), seed=1)


def dense(flow: PoreFlow) -> np.ndarray:
    """The matrix of flow out of each pore, column by column."""
    m = flow.network.pores
    return np.array([flow._native.outflow(column) for column in np.eye(m)]).T


@pytest.mark.parametrize("law", ["duct", "hydraulic-radius"])
def test_steady_balances(network, law):
    flow = PoreFlow(network, viscosity=1e-3, conductance=law)
    result = flow.steady(DRIVEN)
    assert result.outflow["xmax"] > 0
    assert result.outflow["xmin"] == pytest.approx(-result.outflow["xmax"], rel=1e-9)
    assert result.mass_residual < 1e-10
    assert 0 <= result.pressure.min() and result.pressure.max() <= 1e5
    force, wall_force = network.forces(result.pressure)
    walls = wall_force[0, 1::2] - wall_force[0, ::2]
    np.testing.assert_allclose(force.sum(axis=0) + walls, 0, atol=1e-10 * 1e5)
    assert force[:, 0].sum() == pytest.approx(1e5, rel=1e-10)  # the drop times the area


@pytest.mark.parametrize("boundary", [Boundary(pressure={"xmin": 3e5, "zmax": 3e5}), SEALED], ids=["even", "sealed"])
def test_mass_residual_where_nothing_flows(network, boundary):
    """Rounding over rounding would be of order 1, whatever the solver did; it is taken of what pressures could drive."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    even = np.full(network.pores, 3e5)
    for result in (flow.steady(boundary, even), flow.implicit(boundary, even, 1e-6)):
        assert abs(sum(result.outflow.values())) < 1e-12 * flow.conductance.sum() * 3e5
        assert result.mass_residual < 1e-10


def test_pore_residual_tells_what_is_missing(network):
    """Against a balance made by hand: a solve that is stopped early misses as much as it says, pore by pore."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    start = 1e5 * np.sin(5 * network.pore_centre @ [1.0, 2.0, 3.0])
    free = ~flow.given(DRIVEN)
    for dt in (1e-12, 1e-8):
        result = flow.implicit(DRIVEN, start, dt, tolerance=0.01)
        stored = flow.storage * (result.pressure - np.where(free, start, result.pressure)) / dt
        lost = flow._native.outflow(result.pressure) + stored
        # what the walls bring in or take, stores there included, and what free pores store
        brought = np.abs(lost + flow.storage * (result.pressure - start) / dt)[~free].sum() + np.abs(flow.storage * (result.pressure - start) / dt).sum()
        assert result.pore_residual == pytest.approx(np.abs(lost[free]).sum() / brought, rel=1e-6) and result.pore_residual > 1e-6


def test_matrix_is_symmetric_with_no_positive_neighbours(small):
    matrix = dense(PoreFlow(small, 1e-3))
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-15 * matrix.max())
    assert (matrix - np.diag(np.diag(matrix))).max() <= 0
    np.testing.assert_allclose(matrix.sum(axis=0), 0, atol=1e-13 * matrix.max())


def test_a_manufactured_solution_returns(network):
    flow = PoreFlow(network, 1e-3)
    centre = network.pore_centre
    exact = 1e5 * np.cos(3 * centre[:, 0]) * (1 + centre[:, 1] * centre[:, 2])
    faces = Boundary(pressure={"zmin": lambda c: 1e5 * np.cos(3 * c[:, 0]) * (1 + c[:, 1] * c[:, 2])})
    # a source equal to the outflow of the exact solution, handed over as a shrinking of the pores
    result = flow.steady(faces, volume_rate=-flow._native.outflow(exact), tolerance=1e-10)
    assert np.abs(result.pressure - exact).max() < 10 * 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("order", [1, 2])
def test_implicit_is_of_its_order(small, order):
    """Against the exponential of the matrix, sealed and drained: order 1.0 +- 0.1, and 2.0 +- 0.1 in two stages."""
    from numpy.linalg import eigh

    flow = PoreFlow(small, 1e-3, compressibility=4.5e-10)
    storage, matrix = flow.storage, dense(flow)
    for boundary in (SEALED, Boundary(pressure={"xmin": 0.0})):
        fixed = np.zeros(small.pores, bool) if boundary is SEALED else (small.grains_of_pore == -1).any(axis=1)
        free = np.flatnonzero(~fixed)
        root = np.sqrt(storage[free])
        rate, mode = eigh(matrix[np.ix_(free, free)] / root[:, None] / root)
        start = np.where(fixed, 0.0, np.sin(5 * small.pore_centre @ [1.0, 2.0, 3.0]))
        time = 2.0 / np.median(rate)
        exact = mode @ (np.exp(-rate * time) * (mode.T @ (root * start[free]))) / root
        errors = []
        for steps in (40, 80):
            p = start
            for _ in range(steps):
                p = flow.implicit(boundary, p, time / steps, tolerance=1e-12, order=order).pressure
            errors.append(np.abs(p[free] - exact).max())
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def test_the_slowest_mode_decays_as_it_must(small):
    flow = PoreFlow(small, 1e-3, compressibility=4.5e-10)
    root = np.sqrt(flow.storage)
    rate, mode = np.linalg.eigh(dense(flow) / root[:, None] / root)
    dt = 0.5 / rate[1]
    start = mode[:, 1] / root
    p = flow.implicit(SEALED, start, dt, tolerance=1e-13).pressure
    np.testing.assert_allclose(p, start / (1 + rate[1] * dt), atol=1e-9 * np.abs(start).max())


def test_two_stages_damp_what_drains_at_once(small):
    """In a step far longer than any decay nothing is left of a rough start, and the rate at the end is that of the pressures at the end."""
    flow = PoreFlow(small, 1e-3, compressibility=4.5e-10)
    start = np.random.default_rng(0).normal(size=small.pores)
    rate = np.linalg.eigvalsh(dense(flow) / np.sqrt(flow.storage)[:, None] / np.sqrt(flow.storage))[1]
    result = flow.implicit(Boundary(pressure={"xmin": 0.0}), start, 1e6 / rate, order=2)
    assert np.abs(result.pressure).max() < 1e-4
    sealed = flow.implicit(SEALED, start, 0.1 / rate, order=2, tolerance=1e-12)
    expected = -flow._native.outflow(sealed.pressure) / flow.storage
    np.testing.assert_allclose(sealed.rate, expected, atol=1e-7 * np.abs(expected).max())


def test_mass_closes_every_step_with_moving_grains(network):
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    velocity = np.random.default_rng(0).normal(size=(150, 3))
    rate = network.volume_rate(velocity)
    pressure = np.zeros(network.pores)
    for dt in (1e-9, 1e-7, 1e-5, 1e-3):
        result = flow.implicit(Boundary(pressure={"ymin": 1e4}, inflow={"ymax": 1e-3}), pressure, dt, rate)
        assert result.mass_residual < 1e-10
        pressure = result.pressure


@pytest.mark.parametrize("order", [1, 2])
def test_mass_closes_whatever_the_tolerance(network, order):
    """Of all pores together; what the tolerance leaves is the imbalance of each."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    rate = network.volume_rate(np.random.default_rng(0).normal(size=(150, 3)))
    results = [flow.implicit(DRIVEN, np.zeros(network.pores), 1e-7, rate, tolerance, order) for tolerance in (1e-2, 1e-10)]
    assert all(result.mass_residual < 1e-13 for result in results)
    assert results[0].pore_residual > 1e-4 > 1e-7 > results[1].pore_residual


def test_a_closed_box_at_rest_keeps_its_pressure_whatever_the_steps(network):
    """The peer's matrix keeps the old time step: there the pressure doubles each time the step is halved."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    pressure = np.full(network.pores, 1e6)
    for dt in (1e-3, 5e-4, 2.5e-4, 1e-6, 1e-2):
        pressure = flow.implicit(SEALED, pressure, dt).pressure
        np.testing.assert_allclose(pressure, 1e6, rtol=1e-10)


def test_sealed_box_takes_up_a_squeeze(network):
    """Undrained: the mean pressure rises by the squeezed volume over beta V."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    squeeze = network.roof_area("zmax") * -1e-3
    result = flow.implicit(SEALED, np.zeros(network.pores), 1.0, squeeze)
    rise = -squeeze.sum() / flow.storage.sum()
    assert (flow.storage * result.pressure).sum() / flow.storage.sum() == pytest.approx(rise, rel=1e-9)
    np.testing.assert_allclose(result.pressure, rise, rtol=1e-6)  # a second is for ever


def test_sealed_without_storage(network):
    flow = PoreFlow(network, 1e-3)
    both = Boundary(inflow={"xmin": 1e-6, "xmax": -1e-6})
    start = np.full(network.pores, 7.0)
    result = flow.steady(both, start)
    assert result.pressure.mean() == pytest.approx(7.0, rel=1e-9)
    assert result.outflow == pytest.approx({"xmin": -1e-6, "xmax": 1e-6})
    driven = flow.steady(DRIVEN)
    slope = lambda r: np.polyfit(network.pore_centre[:, 0], r.pressure, 1)[0]  # noqa: E731
    assert slope(result) * driven.outflow["xmax"] / 1e-6 == pytest.approx(slope(driven), rel=0.1)
    with pytest.raises(InputError, match="no pressure is given anywhere.*do not balance.*1e-06"):
        flow.steady(Boundary(inflow={"xmin": 1e-6}))


def test_body_force_is_balanced_by_hydrostatic_pressure(network):
    flow = PoreFlow(network, 1e-3)
    flow.refresh(body_force=(0, 0, -9810.0))
    centre = network.pore_centre
    result = flow.steady(Boundary(points=[(*centre[5], 3000.0)]))
    np.testing.assert_allclose(result.pressure, 3000 - 9810 * (centre[:, 2] - centre[5, 2]), atol=1e-4)


def test_explicit_agrees_with_implicit(small):
    flow = PoreFlow(small, 1e-3, compressibility=4.5e-10)
    start = np.sin(5 * small.pore_centre @ [1.0, 2.0, 3.0])
    limit = (flow.storage / np.diag(dense(flow))).min()
    explicit = flow.explicit(DRIVEN, start, 100 * limit)
    assert explicit.report["substeps"] == 112  # 100 / 0.9
    p = start
    for _ in range(400):
        p = flow.implicit(DRIVEN, p, limit / 4, tolerance=1e-12).pressure
    np.testing.assert_allclose(explicit.pressure, p, atol=5e-3 * 1e5)
    assert explicit.mass_residual < 1e-12 and explicit.pore_residual < 1e-9
    # Over the step: what the pores hold more of at its end has come in through the faces.
    held = flow.given(DRIVEN)
    before = np.where(held, explicit.pressure, start)
    gained = (flow.storage * (explicit.pressure - before)).sum()
    at_faces = (flow.storage * (before - start)).sum()
    assert sum(explicit.outflow.values()) * 100 * limit == pytest.approx(-gained - at_faces, rel=1e-9)
    one = flow.explicit(DRIVEN, start, 0.5 * limit)
    assert one.report["substeps"] == 1
    with pytest.raises(InputError, match="explicit flow over 1 s needs .* use the implicit scheme"):
        flow.explicit(DRIVEN, start, 1.0)
    with pytest.raises(InputError, match="compressibility above 0"):
        PoreFlow(small, 1e-3).explicit(DRIVEN, start, limit)


def test_preconditioner_and_start_are_kept_while_that_pays(network):
    flow = PoreFlow(network, 1e-3)
    first = flow.steady(DRIVEN)
    again = flow.steady(DRIVEN, first.pressure)
    assert not first.report["preconditioner_kept"] and again.report["preconditioner_kept"]
    assert again.report["iterations"] <= 1
    np.testing.assert_allclose(again.pressure, first.pressure, atol=1e-9 * 1e5)


def test_a_relaxation_for_all_ways_takes_the_place_of_both(network):
    """Symmetric relaxation both ways takes fewer iterations than one way down and the other up."""
    both, half = (PoreFlow(network, 1e-3, petsc_options=options).steady(DRIVEN).report["iterations"]
                  for options in ("-flow_pc_hypre_boomeramg_relax_type_all symmetric-SOR/Jacobi", ""))  # fmt: skip
    assert both < half


def test_a_preconditioner_that_no_longer_serves_is_made_anew(network):
    """One made for a step in which nothing flows, for the steady state: given up after few iterations."""
    flow = PoreFlow(network, 1e-3, compressibility=4.5e-10)
    still = flow.implicit(DRIVEN, np.zeros(network.pores), 1e-18)
    result = flow.steady(DRIVEN, still.pressure)
    assert not result.report["preconditioner_kept"]
    assert 20 < result.report["iterations"] < 100
    np.testing.assert_allclose(result.pressure, PoreFlow(network, 1e-3).steady(DRIVEN).pressure, atol=1e-4)


def test_limiter_is_counted_and_leaves_no_pore_cut_off():
    x, r = random_pack(100, (0.03, 0.12), seed=2)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update(np.arange(100), x, 1.25 * r)
    limited = net.limited()
    flow = PoreFlow(net, 1e-3, compressibility=1e-9)
    result = flow.steady(DRIVEN)
    assert (result.report["limited_pores"], result.report["limited_throats"]) == limited
    assert limited[1] > 0 and result.report["isolated_pores"] == 0
    # without it some throats are shut; whatever is cut off keeps its pressure, and nothing turns into a NaN
    bare = PoreFlow(net, 1e-3, least_open_share=0.0).steady(DRIVEN)
    assert np.isfinite(bare.pressure).all() and bare.outflow["xmax"] <= result.outflow["xmax"]


def test_a_face_may_be_open_in_part(network):
    """Where a face's function is masked the wall is closed: what is open there is what has the pressure."""
    flow = PoreFlow(network, 1e-3)
    whole = flow.steady(DRIVEN)
    part = flow.steady(Boundary(pressure={"xmin": lambda c: np.ma.masked_array(np.full(len(c), 1e5), c[:, 2] >= 0.5), "xmax": 0.0}))
    low = (network.grains_of_pore == -1).any(axis=1)
    below = network.pore_centre[:, 2] < 0.5
    assert np.all(part.pressure[low & below] == 1e5)
    assert np.all(part.pressure[low & ~below] < 1e5)
    assert 0.2 * whole.outflow["xmax"] < part.outflow["xmax"] < whole.outflow["xmax"]
    assert part.mass_residual < 1e-10


def test_pressures_given_inside(network):
    """A known field given in one half: the other half solves for what a face at their border would do, and a face comes first."""
    flow = PoreFlow(network, 1e-3)
    centre = network.pore_centre
    half = centre[:, 0] < 0.5
    result = flow.steady(Boundary(pressure={"xmin": 3e5, "xmax": 0.0}, inside=lambda c: np.ma.masked_array(1e5 * c[:, 1], c[:, 0] >= 0.5)))
    touching = (network.grains_of_pore == -1).any(axis=1)
    np.testing.assert_array_equal(result.pressure[half & ~touching], 1e5 * centre[half & ~touching, 1])
    assert np.all(result.pressure[touching] == 3e5)
    assert set(result.outflow) == {"xmin", "xmax", "inside"}
    assert sum(result.outflow.values()) == pytest.approx(0.0, abs=1e-9 * max(map(abs, result.outflow.values())))
    assert 0.0 <= result.pressure[~half].min() and result.pressure[~half].max() <= 3e5


def test_nothing_drives_the_flow_however_far_off_the_start_is(network):
    """Equal pressures all round are the answer everywhere; the start says otherwise by far more than rounding."""
    flow = PoreFlow(network, 1e-3)
    for pressure in (1e7 / 3, 0.0):
        result = flow.steady(Boundary(pressure={"xmin": pressure, "zmax": pressure}), 1e8 * np.random.default_rng(1).random(network.pores))
        np.testing.assert_allclose(result.pressure, pressure, rtol=0, atol=1e-9 * 1e8)


def test_pores_cut_off_from_every_pressure_keep_their_own(network):
    """A cluster of pores around one grain, all throats out of it shut."""
    flow = PoreFlow(network, 1e-3)
    inside = (network.grains_of_pore == 75).any(axis=1) & (network.grains_of_pore >= 0).all(axis=1)
    assert inside.sum() > 5
    left, right = network.pores_of_throat[network.owned_throats].T
    conductance = flow.conductance
    conductance[inside[left] != inside[right]] = 0
    flow.conductance = conductance
    start = np.full(network.pores, 123.0)
    result = flow.steady(DRIVEN, start)
    assert result.report["isolated_pores"] == inside.sum()
    assert np.all(result.pressure[inside] == 123.0) and result.mass_residual < 1e-10
    # given some storage, they are unknowns like all others
    flow = PoreFlow(network, 1e-3, compressibility=1e-9)
    flow.conductance = conductance
    stored = flow.implicit(DRIVEN, start, 1e-6)
    assert stored.report["isolated_pores"] == 0
    np.testing.assert_allclose(stored.pressure[inside], 123.0)


FAULTS = {
    "viscosity": (lambda n: PoreFlow(n, 0.0), "viscosity is 0.0"),
    "compressibility": (lambda n: PoreFlow(n, 1.0, -1.0), "compressibility is -1.0"),
    "law": (lambda n: PoreFlow(n, 1.0, conductance="pipe"), "conductance is 'pipe'"),
    "face": (lambda n: PoreFlow(n, 1.0).steady(Boundary(pressure={"top": 0.0})), "face 'top' is not known"),
    "both": (lambda n: PoreFlow(n, 1.0).steady(Boundary({"xmin": 0.0}, {"xmin": 0.0})), "both a pressure and an inflow"),
    "nan": (lambda n: PoreFlow(n, 1.0).steady(Boundary({"xmin": np.nan})), "is not a finite number in Pa"),
    "inflow": (lambda n: PoreFlow(n, 1.0).steady(Boundary({"xmax": 0.0}, {"xmin": np.inf})), "inflow of face 'xmin' is not a finite"),
    "step": (lambda n: PoreFlow(n, 1.0).implicit(DRIVEN, np.zeros(n.pores), 0.0), "dt is 0.0 s"),
    "tolerance": (lambda n: PoreFlow(n, 1.0).steady(DRIVEN, tolerance=2.0), "tolerance is 2.0"),
    "shape": (lambda n: PoreFlow(n, 1.0).steady(DRIVEN, np.zeros(3)), r"pressure has shape \(3,\)"),
    "start": (lambda n: PoreFlow(n, 1.0).steady(DRIVEN, np.full(n.pores, np.nan)), "pressure has entries that are not finite"),
    "conductance": (lambda n: setattr(PoreFlow(n, 1.0), "conductance", [1.0]), "conductance has shape"),
    "gravity": (lambda n: PoreFlow(n, 1.0).refresh([0, 1]), r"body_force has shape \(2,\)"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_input(network, fault):
    act, message = FAULTS[fault]
    with pytest.raises(InputError, match=message):
        act(network)


def test_a_preconditioner_that_fails_is_not_for_more_iterations(network):
    """Relaxation far beyond its limit makes multigrid indefinite; what is told then holds."""
    flow = PoreFlow(network, 1.0, petsc_options="-flow_pc_hypre_boomeramg_relax_type_all Jacobi -flow_pc_hypre_boomeramg_relax_weight_all 5.0")
    with pytest.raises(ComputationError, match=r"DIVERGED_INDEFINITE_PC\).*take another \(-flow_pc_type jacobi\)"):
        flow.steady(DRIVEN)
    assert PoreFlow(network, 1.0, petsc_options="-flow_pc_type jacobi").steady(DRIVEN).mass_residual < 1e-12


def test_options_are_of_one_solver(network, capfd):
    """PETSc has one table of options for all solvers of a process; each has its own here, in any order of use, and refuses what it cannot use."""
    plain, other = PoreFlow(network, 1.0), PoreFlow(network, 1.0, petsc_options="-flow_pc_type jacobi")
    iterations = [flow.steady(DRIVEN).report["iterations"] for flow in (plain, other, PoreFlow(network, 1.0))]
    assert iterations[0] == iterations[2] < iterations[1]
    for options, message in (("-flow_ksp_max_itt 5", "-flow_ksp_max_itt is no option .*: did you mean -flow_ksp_max_it?"), ("-flow_pc_type none_such", "none_such")):
        with pytest.raises(InputError, match=message):
            PoreFlow(network, 1.0, petsc_options=options).steady(DRIVEN)
    assert plain.steady(DRIVEN).report["iterations"] <= iterations[0]


def test_periodic_faces_take_no_pressure():
    net = make_network(30, (0.08, 0.12), periodic=(False, True, False))
    with pytest.raises(InputError, match="face 'ymin' is periodic"):
        PoreFlow(net, 1.0).steady(Boundary(pressure={"ymin": 0.0}))


@pytest.mark.parallel
def test_failure_to_converge_is_an_error_on_both_ranks(mpirun):
    """Two ranks, one iteration allowed."""
    done = mpirun(2, [Path(__file__).with_name("flow_diverging.py")])
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("did not converge (DIVERGED_ITS) after 1 iterations: residual") == 2
    assert done.stdout.count("worst pore at (") == 2
