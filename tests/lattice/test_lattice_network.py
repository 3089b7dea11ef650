"""Lattices: cospherical ties everywhere, and closed forms for the conductances."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import ComputationError, PoreNetwork

SC = [[0, 0, 0]]
BCC = [[0, 0, 0], [0.5, 0.5, 0.5]]
FCC = [[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]


def lattice(basis: list[list[float]], repeats: int) -> np.ndarray:
    """Centres in a box of `repeats` cubic cells of side 1 each way, none on its faces."""
    cells = np.stack(np.meshgrid(*[np.arange(repeats)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return (cells[:, None, :] + np.array(basis) + 0.25).reshape(-1, 3)


def network(basis, repeats: int, diameter: float, periodic=(True,) * 3) -> tuple[PoreNetwork, np.ndarray]:
    x = lattice(basis, repeats)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [repeats] * 3, periodic)
    net.update(np.arange(len(x)), x, np.full(len(x), diameter / 2))
    return net, x


def permeability(net: PoreNetwork, repeats: int) -> float:
    """k along x in a periodic box, from a plain dense solve of the network under a unit pressure gradient, (6) and (8)."""
    s = net.throat_sections()
    owned = net.owned_throats
    conductance = (3 * s["open_area"] ** 3 / (5 * s["perimeter"] ** 2) / s["length"])[owned]
    centre = net.pore_centre
    # pores by their place modulo the period: a rank holds two copies of those at the box's faces
    key = np.round(np.mod(centre, repeats), 9) % repeats
    _, pore = np.unique(np.hstack([key, np.round(net.cell_volume, 9)[:, None]]), axis=0, return_inverse=True)
    pore = pore.ravel()
    left, right = net.pores_of_throat[owned].T
    step = centre[right, 0] - centre[left, 0]
    step -= repeats * np.round(step / repeats)
    matrix, source = np.zeros((pore.max() + 1,) * 2), np.zeros(pore.max() + 1)
    for i, j, c, d in zip(pore[left], pore[right], conductance, step):
        matrix[[i, j, i, j], [i, j, j, i]] += [c, c, -c, -c]
        source[i] += c * d
        source[j] -= c * d
    p = np.linalg.lstsq(matrix, source, rcond=None)[0]
    return float((conductance * (p[pore[right]] - p[pore[left]] + step) ** 2).sum() / repeats**3)


def test_bcc_closed_form():
    """Touching BCC: every throat is the same, k = 8 C l."""
    d = np.sqrt(3) / 2
    net, _ = network(BCC, 3, d)
    s = net.throat_sections()
    area = np.sqrt(2) / 4 - 3 * np.pi / 32
    # the facet has edges d, d, 1: arcs of its whole angle sum, and one open gap
    angles = 2 * np.arctan(np.sqrt(2) / 1), np.arctan(1 / np.sqrt(2))
    np.testing.assert_allclose(2 * angles[1] + (np.pi - 2 * angles[1]), np.pi)
    perimeter = np.pi * d / 2 + (1 - d)
    length = np.sqrt(2) / 4
    np.testing.assert_allclose(s["open_area"], area, rtol=1e-11)
    np.testing.assert_allclose(s["perimeter"], perimeter, rtol=1e-12)
    np.testing.assert_allclose(s["length"], length, rtol=1e-12)
    exact = 8 * 3 * area**3 / (5 * perimeter**2) * length
    assert exact / d**2 == pytest.approx(2.08422e-4, rel=1e-5)
    assert permeability(net, 3) == pytest.approx(exact, rel=1e-10)


def test_simple_cubic_ties():
    """Touching SC: every cube is a tie of eight grains. However it falls, the mesh is one mesh and k lies in a narrow range."""
    net, x = network(SC, 4, 1.0)
    report = net.report()
    assert 5 * len(x) <= report["pores"] <= 6 * len(x) and report["throats"] == 2 * report["pores"]
    assert net.cell_volume.min() > 0.1
    assert 5.5e-4 < permeability(net, 4) < 5.8e-4


@pytest.mark.parametrize("periodic", [(True,) * 3, (False,) * 3])
@pytest.mark.parametrize("basis, diameter", [(SC, 1.0), (BCC, np.sqrt(3) / 2), (FCC, np.sqrt(0.5))])
def test_ties_close(basis, diameter, periodic):
    net, x = network(basis, 3, 0.98 * diameter * (1 if all(periodic) else 0.5), periodic)
    assert net.cell_volume[net.owned].sum() == pytest.approx(27, rel=1e-12)
    r = 0.49 * diameter * (1 if all(periodic) else 0.5)
    assert net.pore_volume[net.owned].sum() == pytest.approx(27 - len(x) * 4 / 3 * np.pi * r**3, rel=1e-12)
    centre = net.pore_centre
    force, wall_force = net.forces(np.sin(2 * np.pi * centre[:, 0] / 3) + np.cos(2 * np.pi * centre[:, 2] / 3))
    walls = wall_force[0, 1::2] - wall_force[0, ::2]
    assert np.abs(force.sum(axis=0) + walls).max() < 1e-11
    assert net.update(np.arange(len(x)), x, np.full(len(x), r)) == "kept"  # a tie stays valid


def test_bcc_closed_form_by_the_flow_solver():
    """Driven by a body force, periodic all round: nothing fixes the pressure but its mean."""
    from flowsolver.flow import Boundary, PoreFlow

    d = np.sqrt(3) / 2
    net, _ = network(BCC, 3, d)
    flow = PoreFlow(net, viscosity=1.0)
    flow.refresh(body_force=(1.0, 0.0, 0.0))
    result = flow.steady(Boundary(), tolerance=1e-13)
    left, right = net.pores_of_throat[net.owned_throats].T
    centre = net.pore_centre
    step = centre[right, 0] - centre[left, 0]
    step -= 3 * np.round(step / 3)
    darcy = (flow.conductance * (result.pressure[left] - result.pressure[right] + step) * step).sum() / 27
    area, perimeter = np.sqrt(2) / 4 - 3 * np.pi / 32, np.pi * d / 2 + 1 - d
    assert darcy == pytest.approx(8 * 3 * area**3 / (5 * perimeter**2) * np.sqrt(2) / 4, rel=1e-10)


def along_each_axis(cells: tuple[int, int, int], periodic: tuple[bool, bool, bool], law: str) -> list[float]:
    """k along x, y and z of touching BCC in a box of these cells, whose walls lie halfway between two layers."""
    from flowsolver.flow import Boundary, PoreFlow
    from flowsolver.network import FACES

    x = (np.indices(cells).reshape(3, -1).T[:, None, :] + np.array(BCC) + 0.25).reshape(-1, 3)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, cells, periodic)
    net.update(np.arange(len(x)), x, np.full(len(x), np.sqrt(3) / 4))
    flow, found = PoreFlow(net, viscosity=1.0, conductance=law), []
    for axis, length in enumerate(cells):
        if periodic[axis]:
            flow.refresh(np.eye(3)[axis])
            found.append(flow.darcy_velocity(flow.steady(Boundary()).pressure)[axis])
        else:
            flow.refresh()
            low, high = FACES[2 * axis : 2 * axis + 2]
            found.append(flow.steady(Boundary(pressure={low: 1.0, high: 0.0})).outflow[high] * length**2 / np.prod(cells))
    return found


@pytest.mark.parametrize("law", ["duct", "hydraulic-radius"])
@pytest.mark.parametrize("periodic", [p for p in itertools.product((True, False), repeat=3) if any(p)])
def test_one_cell_is_as_good_as_several_along_a_period(periodic, law):
    """With any mix of walls and periods: at walls that grains' spheres are centred in, which no copy of a cell may take otherwise than the others."""
    one, several = (along_each_axis(tuple(n if p else 1 for p in periodic), periodic, law) for n in (1, 3))
    np.testing.assert_allclose(several, one, rtol=1e-9)
    # and alike along all walls, and along all periods
    for kind in (True, False):
        alike = [k for k, p in zip(one, periodic) if p is kind]
        np.testing.assert_allclose(alike, alike[:1] * len(alike), rtol=1e-9)


def test_a_tie_that_copies_break_otherwise_is_refused_with_what_helps():
    """Walls by as much further in as the triangulation takes them further out: the grains' spheres are centred in its walls."""
    from flowsolver.flow import PoreFlow

    x, further_in = lattice(BCC, 1), 1.3e-6

    def made(further_in: float) -> PoreFlow:
        net = PoreNetwork(MPI.COMM_SELF, [further_in, 0, 0], [1 - further_in, 1, 1], (False, True, True))
        net.update(np.arange(2), x, np.full(2, np.sqrt(3) / 4))
        return PoreFlow(net, viscosity=1.0)

    with pytest.raises(ComputationError, match="cospherical, .* move one, or the wall, by a hundred-thousandth of the box"):
        made(further_in)
    made(further_in + 1e-5)
