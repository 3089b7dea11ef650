"""A grain that touches its own image: the system of the pores around it is one of equal numbers and determines differences alone, so that the
coarsest level of the multigrid comes to an exact zero."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import ComputationError, PoreNetwork
from flowsolver.flow import Boundary, PoreFlow


def flow_around_it(options: str = "") -> PoreFlow:
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, (False, True, False))
    net.update(np.array([0]), np.full((1, 3), 0.5), np.array([0.5]))
    flow = PoreFlow(net, 10.0, petsc_options=options)
    flow.refresh((0.0, 1.0, 0.0))
    return flow


def moved(flow: PoreFlow) -> float:
    """m/s along the period. By symmetry no pressure differs from another: each throat carries conductance times body force times its step."""
    result = flow.steady(Boundary())
    assert np.ptp(result.pressure) < 1e-12
    return flow.darcy_velocity(result.pressure)[1]


def test_it_has_a_flow_along_the_period():
    flow = flow_around_it()
    left, right, step = flow._owned_throats()
    by_hand = (flow.conductance * step[:, 1] ** 2).sum()
    assert by_hand > 0 and moved(flow) == pytest.approx(by_hand, rel=1e-12)


def test_what_the_multigrid_could_not_do_leaves_nothing_behind():
    expected = moved(flow_around_it())
    with pytest.raises(ComputationError, match="PETSc error"):
        flow_around_it("-flow_pc_hypre_boomeramg_relax_type_coarse l1scaled-SOR/Jacobi").steady(Boundary())
    assert moved(flow_around_it()) == expected
