"""Explicit flow over a time that needs too many steps is refused, and the time that the message names is not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mpi4py import MPI

from flowsolver import PoreNetwork
from flowsolver.flow import Boundary, PoreFlow
from flowsolver.network import InputError


def test_the_time_that_the_message_names_is_accepted():
    network = PoreNetwork(MPI.COMM_SELF, [0.0] * 3, [4e-3] * 3)
    centre = (np.stack(np.meshgrid(*[np.arange(2)] * 3), axis=-1).reshape(-1, 3) + 0.5) * 2e-3 + np.random.default_rng(1).uniform(-1e-4, 1e-4, (8, 3))
    network.update(np.arange(8), centre, np.full(8, 0.9e-3))
    flow, held = PoreFlow(network, 1e-3, 4.6e-10), Boundary(pressure={"zmin": 1.0})
    pressure = np.zeros(network.pores)
    with pytest.raises(InputError, match="use the implicit scheme, or steps of at most") as refused:
        flow.explicit(held, pressure, 1.0)
    longest = float(re.search(r"or steps of at most (\S+) s in all", str(refused.value))[1])
    # Of the most steps that are allowed; and all of the fluid comes to the pressure that is held.
    assert flow.explicit(held, pressure, longest).report["substeps"] == pytest.approx(1e6, rel=0.02)
    np.testing.assert_allclose(flow.explicit(held, pressure, longest).pressure, 1.0, rtol=1e-6)
    with pytest.raises(InputError):
        flow.explicit(held, pressure, 1.02 * longest)
