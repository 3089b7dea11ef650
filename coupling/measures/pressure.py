"""Pore pressures as a history and a snapshot hold them: beside the gouge, and around each grain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coupling.scene.fault_geometry import FaultGeometry

if TYPE_CHECKING:
    from flowsolver.network import PoreNetwork

#: Width of the band of either block beside the gouge, in mean diameters: as wide as the bands that slip is measured between.
BAND_DIAMETERS = 1.5


def beside_gouge(network: PoreNetwork, pressure: np.ndarray, fault: FaultGeometry, mean_diameter: float) -> tuple[float, float]:
    """Mean pressure of the left and the right block within BAND_DIAMETERS of the gouge, Pa, by volume of the pores' cells; collective.

    pressure: (m,) Pa, of the pores that this rank sees.
    """
    owned = network.owned
    distance, volume, held = fault.across(network.pore_centre)[owned], network.cell_volume[owned], pressure[owned]
    half, band = 0.5 * fault.width, BAND_DIAMETERS * mean_diameter
    bands = (-half - band < distance) & (distance < -half), (half < distance) & (distance < half + band)
    sums = network.comm.allreduce(np.array([[(volume * held)[inside].sum(), volume[inside].sum()] for inside in bands]))
    left, right = sums[:, 0] / sums[:, 1]
    return float(left), float(right)


def around_grains(network: PoreNetwork, pressure: np.ndarray, id: np.ndarray) -> np.ndarray:
    """(n,) Pa: mean pressure of the pores around each of this rank's grains `id` (n,), by volume of the cells; NaN where a grain has none.

    pressure: (m,) Pa, of the pores that this rank sees; id: (n,) as of the network's last update, in any order.
    """
    grains, volume = network.grains_of_pore, network.cell_volume
    order = np.argsort(id)
    slot = np.minimum(np.searchsorted(id, grains, sorter=order), len(id) - 1) if len(id) else np.zeros(grains.shape, int)
    place = order[slot] if len(id) else slot
    own = id[place] == grains if len(id) else np.zeros(grains.shape, bool)
    sums = [np.bincount(place[own], np.repeat(part, 4).reshape(grains.shape)[own], len(id)) for part in (volume * pressure, volume)]
    with np.errstate(invalid="ignore"):
        return sums[0] / sums[1]
