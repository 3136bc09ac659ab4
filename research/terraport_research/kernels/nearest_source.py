"""Shortest ways along a graph's edges, from several sources at once (Dijkstra's algorithm).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import AnyInt, Float64, Int32, Int64

__all__ = ["nearest_source", "rows_of_edges"]


def rows_of_edges(n: int, edges: AnyInt, lengths: Float64) -> tuple[Int64, Int32, Float64]:
    """Put edges into rows, one an item.

    Parameters
    ----------
    n : int
        Items.
    edges : ndarray of shape (E, 2), integer
        Each edge once.
    lengths : ndarray of shape (E,), float64

    Returns
    -------
    starts : ndarray of shape (n + 1,), int64
        Where each item's row begins.
    neighbours : ndarray of shape (2E,), int32
    lengths : ndarray of shape (2E,), float64
        Of the edges to them.
    """
    both = np.concatenate([edges, edges[:, ::-1]]).astype(np.int64)
    order = np.argsort(both[:, 0], kind="stable")
    starts = np.searchsorted(both[order, 0], np.arange(n + 1)).astype(np.int64)
    return starts, both[order, 1].astype(np.int32), np.tile(lengths, 2)[order]


def nearest_source(
    starts: Int64,
    neighbours: Int32,
    lengths: Float64,
    sources: Int32,
    labels: Int32 | None = None,
) -> tuple[Float64, Int32]:
    """Find the nearest source of every item, and how far it is.

    Parameters
    ----------
    starts, neighbours, lengths
        Result of :func:`rows_of_edges`; lengths >= 0.
    sources : ndarray of shape (S,), int32
        Different items.
    labels : ndarray of shape (n,), int32, optional
        Ways stay among items of one label.

    Returns
    -------
    distance : ndarray of shape (n,), float64
        Infinite where no source can be reached.
    source : ndarray of shape (n,), int32
        Place among the sources; -1 where none can be reached.
    """
    alike = np.zeros(len(starts) - 1, np.int32) if labels is None else labels
    return _nearest(starts, neighbours, lengths, sources, alike)


@numba.njit(cache=True)
def _nearest(
    starts: Int64, neighbours: Int32, lengths: Float64, sources: Int32, labels: Int32
) -> tuple[Float64, Int32]:
    n = len(starts) - 1
    distance, nearest = np.full(n, np.inf), np.full(n, -1, np.int32)
    heap = np.empty(n, np.int32)
    at = np.full(n, -1, np.int32)  # place in the heap; -1: not there
    size = 0
    for place in range(len(sources)):
        distance[sources[place]] = 0.0
        nearest[sources[place]] = place
        heap[size] = sources[place]
        at[sources[place]] = size
        size += 1
    while size > 0:
        item = heap[0]
        at[item] = -1
        size -= 1
        if size > 0:
            heap[0] = heap[size]
            at[heap[0]] = 0
            _sink(heap, at, distance, size)
        for row in range(starts[item], starts[item + 1]):
            other = neighbours[row]
            through = distance[item] + lengths[row]
            if through < distance[other] and labels[item] == labels[other]:
                distance[other] = through
                nearest[other] = nearest[item]
                if at[other] < 0:
                    heap[size] = other
                    at[other] = size
                    size += 1
                _rise(heap, at, distance, at[other])
    return distance, nearest


@numba.njit(cache=True, inline="always")
def _sink(heap: Int32, at: Int32, distance: Float64, size: int) -> None:
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            return
        if child + 1 < size and distance[heap[child + 1]] < distance[heap[child]]:
            child += 1
        if distance[heap[i]] <= distance[heap[child]]:
            return
        heap[i], heap[child] = heap[child], heap[i]
        at[heap[i]], at[heap[child]] = i, child
        i = child


@numba.njit(cache=True, inline="always")
def _rise(heap: Int32, at: Int32, distance: Float64, i: int) -> None:
    while i > 0:
        parent = (i - 1) // 2
        if distance[heap[parent]] <= distance[heap[i]]:
            return
        heap[i], heap[parent] = heap[parent], heap[i]
        at[heap[i]], at[heap[parent]] = i, parent
        i = parent
