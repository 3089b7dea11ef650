"""A peer's mesh of a pressed pack: away from ties and walls the tetrahedra are the same."""

from __future__ import annotations

import pytest
from peer_pack import network_of, peer_pack


@pytest.mark.parametrize("grains", [1000, 8000])
def test_same_tetrahedra_as_the_peer(grains):
    peer = peer_pack(grains)
    net = network_of(peer)
    ours = {tuple(sorted(v)) for v in net.grains_of_pore.tolist()}
    theirs = {tuple(v) for v in peer["cell_vertices"].tolist()}
    inside = lambda cells: {c for c in cells if c[0] >= 0}  # noqa: E731
    assert inside(ours) == inside(theirs) and len(inside(ours)) > 4 * grains
    # cells at walls differ only where the peer's wall spheres, 5e4 boxes wide, are not flat enough
    assert len(ours) == len(theirs)
    assert len(ours - theirs) <= 4
