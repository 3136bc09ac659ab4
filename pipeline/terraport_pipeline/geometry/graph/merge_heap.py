"""The exact greedy order: always the first merge of all, by a heap that holds each edge once.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64, Int32, Int64, UInt64
from terraport_pipeline.geometry.regions.merge_order import merge_cost, scramble

__all__ = ["merge_by_heap", "record_merges", "unite_units"]


_ARITY: Final = 4
"""Children of a heap entry: four share a cache line, and the heap is half as deep as with two."""


@numba.njit(cache=True)
def merge_by_heap(
    ends: Int32,
    border: Int64,
    perimeter: Int64,
    area: Int64,
    name: Int32,
    small_area: int,
) -> tuple[Int32, Float64]:
    """Merge units one pair after the other, always the first in the order, until none is left.

    Parameters
    ----------
    ends : ndarray of shape (2 E,), int32
        The two units of every edge, one after the other; each pair of units once. Changed.
    border : ndarray of shape (E,), int64
        Weight B of every edge, >= 1. Changed.
    perimeter, area : ndarray of shape (U,), int64
        P and A of every unit; A >= 1. Changed.
    name : ndarray of shape (U,), int32
        Lowest face of every unit. Changed.
    small_area : int
        Only merges in which one unit is below this area count; beyond every area: all merges.

    Returns
    -------
    merged : ndarray of shape (M, 2), int32
        The units of every merge in their order, lower first; the union goes on as the lower one.
    cost : ndarray of shape (M,), float64

    Notes
    -----
    Half-edge 2e stands in the list of unit ``ends[2e]`` and points at ``ends[2e + 1]``, half-edge
    2e + 1 the other way. A merge joins two lists, adds up edges that now run twice to the same
    neighbour and gives every edge of the union its new cost: O(degree of the union * log E). The
    heap holds each edge once and knows its place, so nothing in it is ever stale.
    """
    # (1) The list of half-edges of every unit.
    n_units, n_edges = len(area), len(border)
    following = np.full(2 * n_edges, -1, np.int32)
    head = np.full(n_units, -1, np.int32)
    tail = np.full(n_units, -1, np.int32)
    for h in range(2 * n_edges):
        u = ends[h]
        if head[u] < 0:
            head[u] = h
        else:
            following[tail[u]] = h
        tail[u] = h
    # (2) The heap of all edges that count, ordered by cost, then by the scrambled names.
    dead = np.zeros(n_edges, np.bool_)
    cost = np.empty(n_edges, np.float64)
    tie = np.empty(n_edges, np.uint64)
    heap = np.empty(n_edges, np.int32)
    slot_of = np.full(n_edges, -1, np.int32)
    size = 0
    for e in range(n_edges):
        a, b = ends[2 * e], ends[2 * e + 1]
        cost[e] = merge_cost(perimeter[a], area[a], perimeter[b], area[b], border[e])
        tie[e] = scramble(name[a], name[b])
        if min(area[a], area[b]) < small_area:
            heap[size] = e
            slot_of[e] = size
            size += 1
    for at in range((size - 2) // _ARITY, -1, -1):
        _sift_down(heap, slot_of, size, at, cost, tie)
    # (3) Merge the first pair until the heap is empty. Invariant at the loop's head: of every
    # edge of two living units exactly one is alive; `slot_of[e]` is its index in the heap or -1;
    # `cost` and `tie` are those of its units as they are now; `seen` is -1 everywhere.
    merged = np.empty((max(n_units - 1, 0), 2), np.int32)
    paid = np.empty(max(n_units - 1, 0), np.float64)
    seen = np.full(n_units, -1, np.int32)  # half-edge of the union that leads to this unit
    count = 0
    while size > 0:
        best = heap[0]
        keep, gone = ends[2 * best], ends[2 * best + 1]
        if keep > gone:
            keep, gone = gone, keep
        merged[count, 0] = keep
        merged[count, 1] = gone
        paid[count] = cost[best]
        count += 1
        perimeter[keep] += perimeter[gone] - 2 * border[best]
        area[keep] += area[gone]
        name[keep] = min(name[keep], name[gone])
        size = _remove(heap, slot_of, size, best, cost, tie)
        dead[best] = True
        # Then, for the union:
        # (1) one list, without dead edges, each neighbour once
        following[tail[keep]] = head[gone]
        h, last = head[keep], -1
        head[keep] = -1
        while h >= 0:
            after = following[h]
            e = h >> 1
            if not dead[e]:
                other = ends[h ^ 1]
                ends[h] = keep
                twice = seen[other]
                if twice >= 0:
                    border[twice >> 1] += border[e]
                    dead[e] = True
                    if slot_of[e] >= 0:
                        size = _remove(heap, slot_of, size, e, cost, tie)
                else:
                    seen[other] = h
                    if last < 0:
                        head[keep] = h
                    else:
                        following[last] = h
                    last = h
            h = after
        if last >= 0:
            following[last] = -1
        tail[keep] = last
        # (2) new costs
        h = head[keep]
        while h >= 0:
            e = h >> 1
            other = ends[h ^ 1]
            seen[other] = -1
            # One key changes at a time, and its edge finds its place before the next changes: keys
            # that changed together would leave the heap out of order.
            if min(area[keep], area[other]) >= small_area:
                if slot_of[e] >= 0:
                    size = _remove(heap, slot_of, size, e, cost, tie)
            else:
                cost[e] = merge_cost(
                    perimeter[keep], area[keep], perimeter[other], area[other], border[e]
                )
                tie[e] = scramble(name[keep], name[other])
                _sift_up(heap, slot_of, slot_of[e], cost, tie)
                _sift_down(heap, slot_of, size, slot_of[e], cost, tie)
            h = following[h]
    return merged[:count].copy(), paid[:count].copy()


@numba.njit(cache=True)
def unite_units(merged: Int32, union: Int32) -> None:
    """Write to ``union``, at first every unit itself, the lowest unit of each one's union."""
    for m in range(len(merged)):
        union[merged[m, 1]] = merged[m, 0]
    for u in range(len(union)):  # a union is lower than what joined it: one pass will do
        union[u] = union[union[u]]


@numba.njit(cache=True)
def record_merges(merged: Int32, node: Int32, children: Int32, first: int) -> None:
    """Write merges of units as nodes ``first``, ``first`` + 1, ... of the tree.

    ``node`` holds the node of every unit and is changed.
    """
    for m in range(len(merged)):
        keep, gone = merged[m, 0], merged[m, 1]
        children[m, 0] = node[keep]
        children[m, 1] = node[gone]
        node[keep] = first + m


@numba.njit(cache=True, inline="always")
def _before(e: int, f: int, cost: Float64, tie: UInt64) -> bool:
    """Whether edge e comes before edge f in the order of merges."""
    return bool(cost[e] < cost[f] or (cost[e] == cost[f] and tie[e] < tie[f]))


@numba.njit(cache=True)
def _sift_up(heap: Int32, slot_of: Int32, at: int, cost: Float64, tie: UInt64) -> None:
    e = heap[at]
    while at > 0:
        above = (at - 1) // _ARITY
        if not _before(e, heap[above], cost, tie):
            break
        heap[at] = heap[above]
        slot_of[heap[at]] = at
        at = above
    heap[at] = e
    slot_of[e] = at


@numba.njit(cache=True)
def _sift_down(heap: Int32, slot_of: Int32, size: int, at: int, cost: Float64, tie: UInt64) -> None:
    e = heap[at]
    while True:
        first = at * _ARITY + 1
        if first >= size:
            break
        best = first
        for child in range(first + 1, min(first + _ARITY, size)):
            if _before(heap[child], heap[best], cost, tie):
                best = child
        if not _before(heap[best], e, cost, tie):
            break
        heap[at] = heap[best]
        slot_of[heap[at]] = at
        at = best
    heap[at] = e
    slot_of[e] = at


@numba.njit(cache=True)
def _remove(heap: Int32, slot_of: Int32, size: int, e: int, cost: Float64, tie: UInt64) -> int:
    """Take edge e out of the heap; returns the new size."""
    at = slot_of[e]
    slot_of[e] = -1
    size -= 1
    if at < size:
        heap[at] = heap[size]
        slot_of[heap[at]] = at
        _sift_down(heap, slot_of, size, at, cost, tie)
        _sift_up(heap, slot_of, slot_of[heap[at]], cost, tie)
    return size
