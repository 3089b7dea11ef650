"""What the pores' volumes do when grains and walls move: the work that those gain is what the fluid gives."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_reference import UNIT_BOX, random_pack
from mpi4py import MPI

from flowsolver import InputError, PoreNetwork


@pytest.mark.parametrize("periodic", [(False,) * 3, (False, True, False), (True,) * 3])
@pytest.mark.parametrize("groups", [1, 3])
def test_work_of_forces_is_pressure_times_volume_rate(periodic, groups):
    x, r = random_pack(150, (0.05, 0.09), seed=6)
    r = 1.03 * r  # some overlap
    rng = np.random.default_rng(3)
    group = np.digitize(x[:, 0], [0.4, 0.6]).astype(np.int32) if groups > 1 else None
    planes = np.repeat(UNIT_BOX, groups, axis=0) + (0 if groups == 1 else 0.004 * np.array([-1, 1] * 3) * rng.random((groups, 6)))
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3, periodic)
    net.update(np.arange(len(r)), x, r, planes, group)
    pressure = np.sin(9 * net.pore_centre @ [1.0, 2.0, 3.0])
    velocity, wall_velocity = rng.normal(size=x.shape), rng.normal(size=(groups, 6))
    force, wall_force = net.forces(pressure)
    walls = np.repeat(np.logical_not(periodic), 2)
    rate = net.volume_rate(velocity, wall_velocity)
    work = (force * velocity).sum() + (wall_force * wall_velocity)[:, walls].sum()
    owned = net.owned
    assert work == pytest.approx((pressure * rate)[owned].sum(), abs=1e-12 * np.abs(pressure * rate).sum())


def test_rates_are_those_of_the_volumes():
    x, r = random_pack(80, (0.07, 0.11), seed=8)
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    ids = np.arange(len(r))
    net.update(ids, x, r)
    rng = np.random.default_rng(0)
    velocity, wall_velocity = rng.normal(size=x.shape), rng.normal(size=(1, 6))
    rate = net.volume_rate(velocity, wall_velocity)
    outward = np.array([-1, 1] * 3)

    def volumes(t):
        assert net.update(ids, x + t * velocity, r, UNIT_BOX + t * outward * wall_velocity) == "kept"
        return net.pore_volume

    slope = (8 * (volumes(1e-5) - volumes(-1e-5)) - (volumes(2e-5) - volumes(-2e-5))) / 12e-5
    np.testing.assert_allclose(rate, slope, atol=1e-9)
    # all pores together gain what the walls sweep
    assert rate.sum() == pytest.approx(wall_velocity.sum(), abs=1e-13)


def test_velocity_is_checked():
    net = PoreNetwork(MPI.COMM_SELF, [0] * 3, [1] * 3)
    net.update([0], [[0.5] * 3], [0.1])
    with pytest.raises(InputError, match=r"velocity has shape \(1, 2\).*expected \(1, 3\)"):
        net.volume_rate(np.zeros((1, 2)))
