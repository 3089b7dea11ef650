"""The law of the hydraulic radius on lattices, whose cells are cospherical: closed forms, and the mass that flows."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow

BASIS = {"sc": [[0, 0, 0]], "bcc": [[0, 0, 0], [0.5, 0.5, 0.5]], "fcc": [[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]}
DIAMETER = {"sc": 1.0, "bcc": np.sqrt(3) / 2, "fcc": np.sqrt(0.5)}  # of touching grains, in lattice constants


def lattice(kind: str, periodic, cells: int = 3) -> tuple[PoreNetwork, float]:
    """A network of touching grains in a unit box, and their diameter."""
    corner = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x = np.concatenate([corner + 0.5 * (kind == "sc") + 0.25 * (kind != "sc") + b for b in np.array(BASIS[kind])]) / cells
    d = DIAMETER[kind] / cells
    network = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    network.update(np.arange(len(x)), x, np.full(len(x), d / 2))
    return network, d


def simple_cubic() -> float:
    """Cubes join through squares of two throats: k/d^2 = A R_h^2 / 2, a sixth of a cube's void over a sixth of its surface."""
    return (1 - np.pi / 4) * ((1 - np.pi / 6) / np.pi) ** 2 / 2


def face_centred_cubic() -> float:
    """Octahedra join tetrahedra through triangles; by symmetry a linear pressure is the solution: k = 8 K L^2 / 3 for each octahedron's d^3 / sqrt(2)."""
    length = 3 / (2 * np.sqrt(6))
    angle = 4 * np.arcsin(1 / 3) * 6 / 8 + (3 * np.arccos(1 / 3) - np.pi)  # solid, of a throat's body: six corners over eight faces, four over four
    void, surface = np.sqrt(2) / 16 - angle / 24, angle / 4
    area = np.sqrt(3) / 4 - np.pi / 8
    return area * (void / surface) ** 2 / 2 * length * 8 / 3 * np.sqrt(2)


@pytest.mark.parametrize("kind, expected", [("sc", simple_cubic()), ("fcc", face_centred_cubic())])
def test_permeability_of_a_periodic_lattice(kind, expected):
    """Pores between cospherical grains are as good as one: their throats are of the least length, 3e-4 radii."""
    network, d = lattice(kind, [True] * 3)
    flow = PoreFlow(network, 1.0, conductance="hydraulic-radius")
    for axis in range(3):
        flow.refresh(np.eye(3)[axis])
        result = flow.steady(Boundary())
        assert flow.darcy_velocity(result.pressure)[axis] / d**2 == pytest.approx(expected, rel=1e-4)
        assert result.mass_residual < 1e-10
    assert 0 < result.report["limited_throats"] < network.report()["throats"]


@pytest.mark.parametrize("kind", BASIS)
@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True), (False, False, True)])
def test_lattices_between_walls(kind, periodic):
    network, d = lattice(kind, periodic)
    flow = PoreFlow(network, 1.0, conductance="hydraulic-radius")
    result = flow.steady(Boundary(pressure={"ymin": 1.0, "ymax": 0.0}))
    assert result.mass_residual < 1e-10 and result.report["isolated_pores"] == 0
    # each pore's balance too, though some throats conduct a million times as well as others
    assert result.pore_residual < 3e-8
    assert result.pressure.min() >= -1e-9 and result.pressure.max() <= 1 + 1e-9
    assert result.outflow["ymax"] > 0


def test_flat_cells_of_a_lattice_have_a_centre():
    """Four grains on one circle make a cell that is flat but for rounding: where its centre lies is a matter of the order of its corners. Flow through
    a diamond's lattice is the same whichever grains come first, and however the box lies, but for how ties fall (a sixth more or less, without)."""
    corner = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    basis = np.concatenate([np.array(BASIS["fcc"]) + shift for shift in (0.0, 0.25)])
    x = np.concatenate([corner + [1 / 3, 0.1, 0.125] + b for b in basis]) % 3 / 3
    rng, found = np.random.default_rng(1), []
    for k in range(6):
        order = rng.permutation(len(x))
        axes = np.roll([0, 1, 2], k)
        network = PoreNetwork(MPI.COMM_SELF, [k] * 3, [k + 1] * 3)
        network.update(np.arange(len(x)), x[order][:, axes] + k, np.full(len(x), np.sqrt(3) / 8 / 3))
        driven = "xyz"[list(axes).index(0)]
        found.append(PoreFlow(network, 1.0, conductance="hydraulic-radius").steady(Boundary({f"{driven}min": 1.0, f"{driven}max": 0.0})).outflow[f"{driven}max"])
    assert np.ptp(found) < 1e-4 * found[0], found
