"""Least cuts of graphs with two ends, and labels by alpha-expansion.

Dinic's algorithm: ways of fewest steps from what wants one end to what wants the other, filled
until none is left. Whole numbers, so that it ends.

PURE: no I/O, no clock.

References
----------
E. Dinic, "Algorithm for solution of a problem of maximum flow in a network with power estimation",
Soviet Mathematics Doklady 11, 1970. Y. Boykov, O. Veksler, R. Zabih, "Fast approximate energy
minimization via graph cuts", IEEE PAMI 23(11), 2001.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from terraport_payload.types import AnyInt, Bool, Float64, Int32, Int64

__all__ = ["Arcs", "arcs_of_pairs", "expand_labels", "least_cut"]

_STEPS: Final = 1e4
"""Whole steps in a cost of 1."""


class Arcs(NamedTuple):
    """Every pair in both directions, row by row."""

    starts: Int64
    """(n + 1,) where each item's row begins."""
    targets: Int32
    """(2P,)"""
    back: Int32
    """(2P,) place of the same pair's other direction."""
    pair: Int32
    """(2P,) pair that an arc is of; those from its first item have ``forward``."""
    forward: Bool
    """(2P,)"""


def arcs_of_pairs(n: int, pairs: AnyInt) -> Arcs:
    """Put pairs (P, 2) of n items into rows."""
    count = len(pairs)
    both = np.concatenate([pairs, pairs[:, ::-1]]).astype(np.int64)
    order = np.argsort(both[:, 0], kind="stable")
    starts = np.searchsorted(both[order, 0], np.arange(n + 1)).astype(np.int64)
    place = np.empty(2 * count, np.int32)
    place[order] = np.arange(2 * count, dtype=np.int32)
    other = (order + count) % max(2 * count, 1)
    return Arcs(
        starts,
        both[order, 1].astype(np.int32),
        place[other],
        (order % max(count, 1)).astype(np.int32),
        order < count,
    )


def least_cut(arcs: Arcs, there: Float64, back: Float64, pull: Float64) -> Bool:
    """Part items into two sides at the least cost.

    Parameters
    ----------
    arcs : Arcs
    there, back : ndarray of shape (P,), float64
        What it costs to have a pair's first item on the near side and its second on the far, and
        the other way round. >= 0.
    pull : ndarray of shape (n,), float64
        What it costs more to have an item on the far side than on the near; negative: less.

    Returns
    -------
    ndarray of shape (n,), bool
        True on the near side: what could just as well lie on either is on the far side.
    """
    room = np.where(arcs.forward, there[arcs.pair], back[arcs.pair])
    held = np.rint(room * _STEPS).astype(np.int64)
    excess = np.rint(pull * _STEPS).astype(np.int64)
    return np.asarray(_fill(arcs.starts, arcs.targets, arcs.back, held, excess))


def expand_labels(labels: Int32, costs: Float64, pairs: Int32, weights: Float64) -> Int32:
    """Lower the costs of labels and of borders between them, until no label gains by growing.

    Parameters
    ----------
    labels : ndarray of shape (n,), int32
        To begin with, 0..K-1.
    costs : ndarray of shape (n, K), float64
        Of every label at every item.
    pairs : ndarray of shape (P, 2), int32
    weights : ndarray of shape (P,), float64
        What it costs that a pair's labels differ. >= 0.

    Returns
    -------
    ndarray of shape (n,), int32
    """
    arcs = arcs_of_pairs(len(labels), pairs)
    a, b = pairs[:, 0], pairs[:, 1]
    items = np.arange(len(labels))
    least = _energy(labels, costs, pairs, weights)
    grown = True
    while grown:
        grown = False
        for label in range(costs.shape[1]):
            # Costs of a pair: both keep, the second takes, the first takes; 0 where both take.
            keep = weights * (labels[a] != labels[b])
            second = weights * (labels[a] != label)
            first = weights * (labels[b] != label)
            pull = costs[:, label] - costs[items, labels]
            pull += np.bincount(a, first - keep, len(labels))
            pull -= np.bincount(b, first, len(labels))
            keeps = least_cut(arcs, second + first - keep, np.zeros(len(pairs)), pull)
            tried = np.where(keeps, labels, label).astype(np.int32)
            energy = _energy(tried, costs, pairs, weights)
            if energy < least - 1e-9 * abs(least) - 1e-12:
                labels, least, grown = tried, energy, True
    return labels


def _energy(labels: Int32, costs: Float64, pairs: Int32, weights: Float64) -> float:
    apart = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    return float(costs[np.arange(len(labels)), labels].sum() + weights[apart].sum())


@numba.njit(cache=True)
def _fill(starts: Int64, targets: Int32, back: Int32, room: Int64, excess: Int64) -> Bool:
    n = len(starts) - 1
    level = np.empty(n, np.int32)
    queue = np.empty(n, np.int32)
    path = np.empty(n, np.int32)
    while True:
        # (1) Levels: steps from what has excess. Without a way to what lacks, all is filled.
        level[:] = -1
        first, last = 0, 0
        for item in range(n):
            if excess[item] > 0:
                level[item] = 0
                queue[last] = item
                last += 1
        open_way = False
        while first < last:
            item = queue[first]
            first += 1
            for arc in range(starts[item], starts[item + 1]):
                target = targets[arc]
                if room[arc] > 0 and level[target] < 0:
                    level[target] = level[item] + 1
                    open_way = open_way or excess[target] < 0
                    queue[last] = target
                    last += 1
        if not open_way:
            return level >= 0
        # (2) Fill ways of one step a level. Invariant: arcs before `cursor` lead nowhere.
        cursor = starts[:-1].copy()
        for begin in range(n):
            while excess[begin] > 0:
                item, depth = begin, 0
                while excess[item] >= 0:
                    while cursor[item] < starts[item + 1]:
                        arc = cursor[item]
                        if room[arc] > 0 and level[targets[arc]] == level[item] + 1:
                            break
                        cursor[item] += 1
                    if cursor[item] < starts[item + 1]:
                        path[depth] = cursor[item]
                        depth += 1
                        item = targets[cursor[item]]
                    elif depth == 0:
                        break
                    else:
                        depth -= 1
                        item = targets[back[path[depth]]]
                        cursor[item] += 1
                if excess[item] >= 0:
                    break
                flow = min(excess[begin], -excess[item])
                for step in range(depth):
                    flow = min(flow, room[path[step]])
                for step in range(depth):
                    room[path[step]] -= flow
                    room[back[path[step]]] += flow
                excess[begin] -= flow
                excess[item] += flow
