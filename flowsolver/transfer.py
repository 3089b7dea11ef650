"""Pressures from one mesh to the next, with the fluid that the pores hold conserved."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray

from flowsolver.network import PoreNetwork, checked_array


def _keys(grains: NDArray[np.int64]) -> NDArray[np.uint64]:
    """(k,) a number for each pore, from its four vertices in any order."""
    key = np.zeros(len(grains), np.uint64)
    for column in np.sort(grains, axis=1).T:
        key = (key ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    return key


def _ask(comm: MPI.Comm, known: NDArray, value: NDArray, wanted: NDArray) -> tuple[NDArray, NDArray]:
    """Values of keys that any rank knows, NaN for those that none does; and which of this rank's known keys were wanted.

    Every key is looked up on the rank that its value names. A key that occurs twice is not matched.
    """
    def places(keys: NDArray) -> list[NDArray]:
        home = (keys % np.uint64(comm.size)).astype(int)
        return [np.flatnonzero(home == rank) for rank in range(comm.size)]

    def deal(parts: list[NDArray]) -> tuple[NDArray, NDArray]:
        """What all ranks send to this one, and where each rank's part ends."""
        received = comm.alltoall(parts)
        return np.concatenate(received), np.cumsum([len(part) for part in received])[:-1]

    def answer(replies: NDArray, ends: NDArray, to: list[NDArray], size: int) -> NDArray:
        out = np.empty(size, replies.dtype)
        for place, part in zip(to, comm.alltoall(np.split(replies, ends))):
            out[place] = part
        return out

    known_places, wanted_places = places(known), places(wanted)
    keys, key_ends = deal([known[k] for k in known_places])
    values, _ = deal([value[k] for k in known_places])
    asked, asked_ends = deal([wanted[k] for k in wanted_places])
    found, used = np.full(len(asked), np.nan), np.zeros(len(keys), bool)
    if len(keys) and len(asked):
        order = np.argsort(keys)
        ordered = keys[order]
        twice = np.zeros(len(keys), bool)
        twice[1:] = ordered[1:] == ordered[:-1]
        twice[:-1] |= twice[1:]
        slot = np.minimum(np.searchsorted(ordered, asked), len(keys) - 1)
        match = (ordered[slot] == asked) & ~twice[slot]
        match &= np.bincount(slot[match], minlength=len(keys))[slot] == 1
        found[match] = values[order[slot[match]]]
        used[order[slot[match]]] = True
    return answer(found, asked_ends, wanted_places, len(wanted)), answer(used, key_ends, known_places, len(known))


def carry_pressure(network: PoreNetwork, pressure: ArrayLike, pores_before: int) -> NDArray[np.float64]:
    """Pressures on the present mesh from those on the one before. Collective.

    Call it after an update that returned "repaired" or "rebuilt", on a network with `remember_previous` set. Pores that are the same keep
    their pressure; those that are new get the mean of the vanished ones around them, and all of these one common shift, so that
    the sum of volume times pressure, and with it the fluid's mass, is what it was.

    Parameters
    ----------
    pressure : (m before,) float64, Pa, of the pores before the update
    pores_before
        `network.pores` before the update.

    Returns
    -------
    (m,) float64, Pa
    """
    comm, faults = network.comm, []
    before = checked_array("pressure", pressure, np.float64, (pores_before,), faults)
    network.agree(faults)
    old_grains, old_volume, old_index = network.native.previous()
    old_pressure = before[old_index]
    own = np.flatnonzero(network.owned)
    new_grains, new_volume = network.grains_of_pore[own], network.pore_volume[own]
    same = network.native.same_pore_before()
    if comm.allreduce(len(same)):
        # A repaired mesh knows which of its pores are the same, and they belong to the same ranks; ranks without grains have none.
        own_same = same[own]
        new_pressure = np.where(own_same >= 0, before[own_same], np.nan) if len(own) else np.zeros(0)
        still_there = np.zeros(pores_before, bool)
        still_there[own_same[own_same >= 0]] = True
        kept = still_there[old_index]
    else:
        new_pressure, kept = _ask(comm, _keys(old_grains), old_pressure, _keys(new_grains))
    new = np.isnan(new_pressure)

    # What the vanished pores held, by grain; they are few, and every rank gets them all.
    gone = ~kept
    grains, volume, held = (
        np.concatenate(parts)
        for parts in zip(*comm.allgather((old_grains[gone], np.abs(old_volume[gone]), (np.abs(old_volume) * old_pressure)[gone])))
    )
    sums = np.array([(old_volume * old_pressure)[gone].sum(), 0.0, 0.0])
    if volume.sum() > 0:
        name, place = np.unique(grains, return_inverse=True)
        by_grain = [np.bincount(place.ravel(), np.repeat(value, 4), len(name)) for value in (held, volume)]
        slot = np.minimum(np.searchsorted(name, new_grains[new]), len(name) - 1)
        near = (name[slot] == new_grains[new]) & (new_grains[new] >= 0)
        weight = np.where(near, by_grain[1][slot], 0.0).sum(axis=1)
        around = np.where(near, by_grain[0][slot], 0.0).sum(axis=1)
        new_pressure[new] = np.where(weight > 0, around / np.where(weight > 0, weight, 1.0), held.sum() / volume.sum())
    else:
        new_pressure[new] = 0.0
    sums[1:] = (new_volume * new_pressure)[new].sum(), new_volume[new].sum()
    comm.Allreduce(MPI.IN_PLACE, sums)
    if sums[2] > 0:
        new_pressure[new] += (sums[0] - sums[1]) / sums[2]
    everywhere = np.zeros(network.pores)
    everywhere[own] = new_pressure
    return network.native.share(everywhere)
