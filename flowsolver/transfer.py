"""Pressures from one mesh to the next, with the fluid that the pores hold conserved."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike, NDArray

from flowsolver.checks import checked_array, checked_type, checked_whole
from flowsolver.network import InputError, PoreNetwork


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


def _summed_by_grain(comm: MPI.Comm, grains: NDArray, value: NDArray, wanted: NDArray) -> NDArray[np.float64]:
    """(l, 2) float64: of each of these pores, whose grains are wanted (l, 4), the sum over its grains of the values (k, 2) of all pores with
    grains (k, 4) that touch them. Walls touch none. Every grain's sum is made on the rank that its id names."""

    def by_home(name: NDArray) -> list[NDArray]:
        return [np.flatnonzero(name % comm.size == rank) for rank in range(comm.size)]

    touched = grains.ravel() >= 0
    name, place = np.unique(grains.ravel()[touched], return_inverse=True)
    sums = np.stack([np.bincount(place, np.repeat(column, 4)[touched], len(name)) for column in value.T], axis=1)
    parts = comm.alltoall([(name[k], sums[k]) for k in by_home(name)])
    name, place = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
    received = np.concatenate([part[1] for part in parts])
    sums = np.stack([np.bincount(place, column, len(name)) for column in received.T], axis=1)

    asked, back = np.unique(wanted, return_inverse=True)
    homes, known = by_home(asked), np.zeros((len(asked), 2))
    answers = []
    for theirs in comm.alltoall([asked[k] for k in homes]):
        slot = np.minimum(np.searchsorted(name, theirs), max(len(name) - 1, 0))
        answers.append(np.where((name[slot] == theirs)[:, None], sums[slot], 0.0) if len(name) else np.zeros((len(theirs), 2)))
    for k, part in zip(homes, comm.alltoall(answers)):
        known[k] = part
    return known[back.reshape(-1, 4)].sum(axis=1)


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
    faults: list[str] = []
    if not checked_type("network", network, PoreNetwork, faults):
        # Without a network no rank can tell the others.
        raise InputError(faults[0])
    comm, pores_before = network.comm, checked_whole("pores_before", pores_before, 0, faults)
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

    # What the vanished pores held, by grain.
    gone = ~kept
    volume, held = np.abs(old_volume[gone]), (np.abs(old_volume) * old_pressure)[gone]
    sums = np.array([(old_volume * old_pressure)[gone].sum(), 0.0, 0.0])
    whole = comm.allreduce(np.array([held.sum(), volume.sum()]))
    if whole[1] > 0:
        around, weight = _summed_by_grain(comm, old_grains[gone], np.stack([held, volume], axis=1), new_grains[new]).T
        new_pressure[new] = np.where(weight > 0, around / np.where(weight > 0, weight, 1.0), whole[0] / whole[1])
    else:
        new_pressure[new] = 0.0
    sums[1:] = (new_volume * new_pressure)[new].sum(), new_volume[new].sum()
    comm.Allreduce(MPI.IN_PLACE, sums)
    if sums[2] > 0:
        new_pressure[new] += (sums[0] - sums[1]) / sums[2]
    everywhere = np.zeros(network.pores)
    everywhere[own] = new_pressure
    return network.native.share(everywhere)
