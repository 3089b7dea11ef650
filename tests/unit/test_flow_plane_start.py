"""The plane through given pressures that a steady flow's iteration starts from."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import random_pack
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.boundary import Conditions
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.plane_start import plane_through

LOWER, UPPER = np.array([10.0, -3.0, 0.0]), np.array([11.0, -1.0, 1.0])


def make_network(periodic=(False,) * 3) -> PoreNetwork:
    x, r = random_pack(150, (0.05, 0.09), 4)
    net = PoreNetwork(MPI.COMM_SELF, LOWER, UPPER, periodic)
    net.update(np.arange(150), LOWER + x * (UPPER - LOWER), r)
    return net


@pytest.fixture(scope="module")
def network() -> PoreNetwork:
    return make_network()


def start(network: PoreNetwork, boundary: Boundary) -> np.ndarray | None:
    conditions = Conditions.of(network, boundary)
    return plane_through(network, conditions.fixed, conditions.given)


def test_pressures_in_a_plane_are_found_everywhere(network):
    """Wherever the plane stays within the range of what is given, at whatever size of the pressures."""
    for size in (1e-200, 3e5, 1e300):
        plane = lambda x: size * (0.3 + (x - LOWER) @ [0.2, -0.05, 0.1])  # noqa: E731
        found = start(network, Boundary(pressure={"xmin": plane, "xmax": plane, "zmin": plane, "ymax": plane}))
        given = Conditions.of(network, Boundary(pressure={"xmin": plane, "xmax": plane, "zmin": plane, "ymax": plane}))
        least, most = given.given[given.fixed].min(), given.given[given.fixed].max()
        np.testing.assert_allclose(found, np.clip(plane(network.pore_centre), least, most), rtol=1e-9)


def test_one_pressure_is_had_everywhere_and_none_gives_no_plane(network):
    np.testing.assert_array_equal(start(network, Boundary(pressure={"ymax": 7.0, "zmin": 7.0})), 7.0)
    assert start(network, Boundary()) is None


def test_no_pressure_beyond_those_that_are_given(network):
    """One corner of a face is pressed: a plane through it would be below what is given at the other end."""
    found = start(network, Boundary(pressure={"ymax": lambda x: np.where(x[:, 0] < LOWER[0] + 0.3, 2.0, 1.0)}))
    assert found.min() == 1.0 and 1.0 < found.max() <= 2.0


def test_no_slope_along_a_period():
    network = make_network((True, False, False))
    found = start(network, Boundary(pressure={"ymin": lambda x: 1.0 + 0.3 * (x[:, 0] - LOWER[0]), "ymax": 0.0}))
    inside = (found > found.min()) & (found < found.max())
    place = np.column_stack([np.ones(inside.sum()), network.pore_centre[inside, 1:]])
    plane = np.linalg.lstsq(place, found[inside])[0]
    assert plane[1] < -0.4  # per m, over 2 m
    np.testing.assert_allclose(place @ plane, found[inside], rtol=1e-9)


def test_same_pressures_in_fewer_iterations(network):
    """Beside a start from 0; the pores that nothing determines keep 0 all the same."""
    driven = Boundary(pressure={"xmin": 1e5, "xmax": 2e4})
    flow = PoreFlow(network, 1e-3)
    conductance = flow.conductance
    conductance[(np.asarray(network.pores_of_throat) == network.pores // 2).any(axis=1)] = 0.0
    flow.conductance = conductance
    assert not flow.given(driven)[network.pores // 2]
    from_zero, from_plane = flow.steady(driven, np.zeros(network.pores)), PoreFlow(network, 1e-3)
    from_plane.conductance = conductance
    found = from_plane.steady(driven)
    np.testing.assert_allclose(found.pressure, from_zero.pressure, atol=1e-7)
    assert found.pressure[network.pores // 2] == 0.0
    # To the default tolerance, 1e-13, the two are one iteration apart, more or less.
    coarse = [flow.steady(driven, first, tolerance=1e-6).report["iterations"] for first in (np.zeros(network.pores), None)]
    assert coarse[1] < coarse[0]
