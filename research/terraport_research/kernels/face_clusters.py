"""Faces united two parts at a time, always where the union fits a primitive best.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import heapq
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_research.kernels.primitive_fits import fit_error

__all__ = ["unite_by_fit"]

_EVEN: Final = 1e-9
"""Of the squared area, added to a union's cost; both are length^4."""


@numba.njit(cache=True)
def unite_by_fit(pairs: Int32, sums: Float64) -> Int32:
    """Unite neighbours until none is left.

    Parameters
    ----------
    pairs : ndarray of shape (P, 2), int32
        Neighbours, each pair once.
    sums : ndarray of shape (n, 41), float64
        Of every part (:func:`~.primitive_fits.part_sums`). Changed.

    Returns
    -------
    ndarray of shape (M, 2), int32
        Unions in their order: the part that goes on, the lower, and the one that it takes in.

    Notes
    -----
    On a plane all errors are alike but for rounding; the square of the area is added, too small to
    matter elsewhere, so that parts grow evenly there: one that took in all others in turns would
    have its whole border fitted at every step (25 s for 30,000 faces, now .4). Of equal costs the
    pair of the lowest parts is first. O(n log n) fits.
    """
    n, edges = len(sums), len(pairs)
    # (1) The half-edges of every part in a list: 2 e leads from the first of pair e.
    ends = pairs.reshape(-1).copy()
    following = np.full(2 * edges, -1, np.int32)
    head, tail = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    for half in range(2 * edges):
        part = ends[half]
        if head[part] < 0:
            head[part] = half
        else:
            following[tail[part]] = half
        tail[part] = half
    # (2) All pairs by error. An entry holds how often its parts had grown: later it is stale.
    grown = np.zeros(n, np.int32)
    heap = [(0.0, np.int32(0), np.int32(0), np.int32(0), np.int32(0)) for _ in range(0)]
    for edge in range(edges):
        a, b = min(pairs[edge, 0], pairs[edge, 1]), max(pairs[edge, 0], pairs[edge, 1])
        heap.append((_cost(sums[a] + sums[b]), a, b, np.int32(0), np.int32(0)))
    heapq.heapify(heap)
    unions = np.empty((max(n - 1, 0), 2), np.int32)
    seen = np.full(n, -1, np.int32)
    dead = np.zeros(edges, np.bool_)  # within a part, or beside another of the same two parts
    count = 0
    while len(heap) > 0:
        _, keep, gone, of_keep, of_gone = heapq.heappop(heap)
        if grown[keep] != of_keep or grown[gone] != of_gone:
            continue
        unions[count, 0], unions[count, 1] = keep, gone
        count += 1
        sums[keep] += sums[gone]
        grown[keep] += 1
        grown[gone] = -1
        # (3) One list for the union, every neighbour once.
        following[tail[keep]] = head[gone]
        half, last = head[keep], -1
        head[keep] = -1
        while half >= 0:
            after = following[half]
            other = ends[half ^ 1]
            ends[half] = keep
            if dead[half >> 1]:
                pass
            elif other in (keep, gone) or seen[other] == count:
                dead[half >> 1] = True
            else:
                seen[other] = count
                if last < 0:
                    head[keep] = half
                else:
                    following[last] = half
                last = half
                a, b = min(keep, other), max(keep, other)
                tried = _cost(sums[a] + sums[b])
                heapq.heappush(heap, (tried, a, b, grown[a], grown[b]))
            half = after
        if last >= 0:
            following[last] = -1
        tail[keep] = last
    return unions[:count].copy()


@numba.njit(cache=True)
def _cost(sums: Float64) -> float:
    return float(fit_error(sums) + _EVEN * sums[0] * sums[0])
