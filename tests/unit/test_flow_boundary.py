"""What is given at the edges of a flow: which pores a point means, also where periods are short; functions that fail."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow


def make_flow(position, radius, upper, periodic, viscosity=1e-3, compressibility=0.0, body_force=(0.0, 0.0, 0.0)) -> PoreFlow:
    network = PoreNetwork(MPI.COMM_SELF, [0.0] * 3, upper, periodic)
    network.update(np.arange(len(position)), position, np.broadcast_to(radius, len(position)).copy())
    flow = PoreFlow(network, viscosity, compressibility)
    flow.refresh(body_force)
    return flow


@pytest.mark.parametrize("count", [1, 4])
def test_a_point_is_one_pore_where_several_are_of_the_same_grains(count):
    """In boxes of one or a few grains pores differ by the images of their grains alone."""
    x = np.random.default_rng(2).uniform(size=(count, 3))
    flow = make_flow(x, 0.2 * count ** (-1 / 3), [1.0] * 3, (True,) * 3, compressibility=1e-9)
    network = flow.network
    vertices = np.sort(network.grains_of_pore[network.owned], axis=1)
    assert len(np.unique(vertices, axis=0)) < len(vertices)
    place = network.pore_centre[network.owned][3]
    assert np.count_nonzero(flow.given(Boundary(points=[(*place, 1.0)])) & network.owned) == 1
    rate = 1e-6
    after = flow.implicit(Boundary(sources=[(*place, rate)]), np.zeros(network.pores), 2.0)
    assert flow.storage[network.owned] @ after.pressure[network.owned] == pytest.approx(2.0 * rate, rel=1e-9)
    drained = flow.steady(Boundary(points=[(*place, 5.0)], sources=[(0.1, 0.2, 0.3, rate)]))
    assert drained.outflow["points"] == pytest.approx(0.0, abs=1e-6 * rate)


@pytest.mark.parametrize("periodic", [(False,) * 3, (True, False, True), (True,) * 3, (False, True, False)])
@pytest.mark.parametrize("count", [1, 5, 80])
def test_cells_share_out_the_box(count, periodic):
    """Each point of the box is in one cell, of whatever kind, and the centre of a cell in that cell."""
    rng = np.random.default_rng(7)
    x, r = rng.uniform(0.02, 0.98, (count, 3)), rng.uniform(0.05, 0.1, count) * count ** (-1 / 3)
    network = make_flow(x, r, [1.0] * 3, periodic).network
    found = set()
    for point in rng.uniform(size=(300, 3)) + np.where(periodic, rng.integers(-2, 3, (300, 3)), 0):
        depth = np.where(network.owned, network.native.depth(point.tolist()), -np.inf)
        assert np.count_nonzero(depth > 0.0) == 1
        found.add(int(depth.argmax()))
    walls = {int(np.count_nonzero(vertices < 0)) for vertices in network.grains_of_pore[sorted(found)]}
    assert walls >= (set() if any(periodic) else {3} if count == 1 else {1, 2})
    for pore in np.flatnonzero(network.owned):
        depth = network.native.depth(network.pore_centre[pore].tolist())
        assert depth[pore] > 0.0 and np.count_nonzero(depth[network.owned] > 0.0) == 1


@pytest.mark.parametrize("kind", ["points", "sources"])
def test_a_point_beyond_the_walls_is_refused(kind):
    x, r = random_pack(30, (0.08, 0.12), 5)
    flow = make_flow(x, r, [1.0] * 3, (True, False, False))
    assert flow.steady(Boundary(pressure={"zmin": 0.0}, **{kind: [(7.3, 0.5, 1.0, 1e-3)]})).outflow["zmin"] > 0.0
    with pytest.raises(InputError, match=r"no pore holds the point \(0\.3, 0\.5, 1\.01\): expected one between the walls"):
        flow.steady(Boundary(pressure={"zmin": 0.0}, **{kind: [(0.3, 0.5, 1.01, 1e-3)]}))


def test_a_point_is_found_across_a_period_too():
    """A pack, and the same moved along the period together with its point, so that the point comes to lie at the other end."""
    x, r = random_pack(60, (0.08, 0.12), 5)
    found = []
    for moved in (0.0, 0.37):
        flow = make_flow((x + [moved, 0.0, 0.0]) % 1.0, r, [1.0] * 3, (True, False, False))
        result = flow.steady(Boundary(pressure={"zmin": 0.0}, points=[((0.62 + moved) % 1.0, 0.5, 0.5, 1.0)]))
        found.append(result.outflow["zmin"])
    for moved in (0.375, 0.379, 0.385):
        flow = make_flow((x + [moved, 0.0, 0.0]) % 1.0, r, [1.0] * 3, (True, False, False))
        found.append(flow.steady(Boundary(pressure={"zmin": 0.0}, points=[((0.62 + moved) % 1.0, 0.5, 0.5, 1.0)])).outflow["zmin"])
    np.testing.assert_allclose(found, found[0], rtol=1e-8)


@pytest.mark.parametrize("periodic", [(True, True, True), (False, True, True), (False, True, False)])
def test_flow_along_a_short_period(periodic):
    """Its pack nine times over has the same flow: beside walls, pores reach further than half a period."""
    x = np.random.default_rng(2).uniform([0.05, 0.0, 0.05], [0.95, 0.15, 0.95], (7, 3))
    found = []
    for times in (1, 9):
        repeated = np.concatenate([x + [0.0, 0.15 * k, 0.0] for k in range(times)])
        flow = make_flow(repeated, 0.04, [1.0, 0.15 * times, 1.0], periodic, body_force=(0.0, 1.0, 0.0))
        found.append(flow.darcy_velocity(flow.steady(Boundary(), tolerance=1e-12).pressure)[1])
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def of_wrong_shape(place):
    return np.zeros(len(place) + 1)


def failing(place):
    raise KeyError("no such table")


@pytest.mark.parametrize(
    ("boundary", "words"),
    [
        (Boundary(pressure={"xmin": of_wrong_shape}), "the pressure of face 'xmin' has shape"),
        (Boundary(pressure={"xmin": failing}), "the pressure of face 'xmin' cannot be had: KeyError"),
        (Boundary(pressure={"xmin": lambda place: np.where(place[:, 1] > 0.5, 1.0, np.nan)}), "the pressure of face 'xmin' is not a finite number in Pa everywhere"),
        (Boundary(pressure={"xmin": "low"}), "the pressure of face 'xmin' is 'low': expected a number in Pa, or a function of places"),
        (Boundary(pressure={"xmin": 0.0}, inflow={"xmax": of_wrong_shape}), "the inflow of face 'xmax' has shape"),
        (Boundary(pressure={"xmin": lambda place: 1j * place[:, 0]}), "the pressure of face 'xmin' cannot be had: TypeError: it yields complex numbers"),
        (Boundary(inside=of_wrong_shape), "the pressure inside has shape"),
        (Boundary(points=[(0.5, 0.5, 1.0)]), "not of four finite numbers"),
        (Boundary(points=(0.5, 0.5, 0.5, 1.0)), "the point 0.5 is not of four finite numbers"),
        (Boundary(points=[("a", 0.5, 0.5, 1.0)]), "not of four finite numbers"),
        (Boundary(pressure={"xmin": 0.0}, sources=[(0.5, 0.5, 0.5, 1.0, 2.0)]), "not of four finite numbers"),
    ],
)
def test_values_that_do_not_fit_are_refused(boundary, words):
    x, r = random_pack(20, (0.1, 0.15), 3)
    flow = make_flow(x, r, [1.0] * 3, (False,) * 3)
    with pytest.raises(InputError, match=words):
        flow.steady(boundary)


def test_where_an_inflow_is_masked_nothing_flows_in():
    x, r = random_pack(40, (0.1, 0.13), 3)
    flow = make_flow(x, r, [1.0] * 3, (False,) * 3)

    def upper_half(place):
        return np.ma.masked_array(np.full(len(place), 2.0), place[:, 2] < 0.5)

    result = flow.steady(Boundary(pressure={"xmax": 0.0}, inflow={"xmin": upper_half}))
    whole = flow.steady(Boundary(pressure={"xmax": 0.0}, inflow={"xmin": lambda place: np.where(place[:, 2] < 0.5, 0.0, 2.0)}))
    assert result.outflow == pytest.approx(whole.outflow, rel=1e-9)


def test_a_flow_of_pores_that_are_no_more_is_refused():
    """Its throats would be looked up among those of another mesh."""
    x, r = random_pack(60, (0.08, 0.12), 5)
    flow = make_flow(x, r, [1.0] * 3, (False,) * 3, compressibility=1e-9)
    network, driven = flow.network, Boundary(pressure={"xmin": 1.0, "xmax": 0.0})
    network.update(np.arange(20), x[:20], r[:20])
    at_rest = np.zeros(network.pores)
    for solve in (lambda: flow.steady(driven), lambda: flow.implicit(driven, at_rest, 1.0), lambda: flow.explicit(driven, at_rest, 1e-12), lambda: flow.darcy_velocity(at_rest)):
        with pytest.raises(InputError, match=r"call refresh\(\) after each update"):
            solve()
    flow.refresh()
    assert flow.steady(driven).mass_residual < 1e-9
    # Grains that leave the mesh as it is leave the flow's throats where they are.
    assert network.update(np.arange(20), x[:20] + 1e-12, r[:20]) == "kept"
    flow.steady(driven)


@pytest.mark.parametrize("bad", [[[0.1, 0.2, 0.3], [0.4]], np.ma.masked_greater(np.linspace(0.1, 0.9, 6).reshape(2, 3), 0.5)])
def test_positions_that_are_no_whole_array_are_refused(bad):
    network = PoreNetwork(MPI.COMM_SELF, [0.0] * 3, [1.0] * 3)
    with pytest.raises(InputError, match="position (is no array|has masked entries)"):
        network.update([0, 1], bad, [0.1, 0.1])


@pytest.mark.parallel
def test_what_differs_between_ranks_is_refused_on_all(mpirun):
    """Two ranks, which would wait for each other for ever, or solve a system of two halves."""
    done = mpirun(2, [Path(__file__).with_name("flow_alike_ranks.py")])
    assert done.returncode == 0, done.stderr
    lines = [line.split("|") for line in done.stdout.splitlines()]
    assert len(lines) == 12
    for case, one, two in lines:
        assert one == two and one.startswith(f"{case.split()[0]} differs between ranks: "), (case, one, two)
