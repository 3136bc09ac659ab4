"""Edges along which regions end.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import AnyInt, Float64, Int32, Int64

__all__ = ["outline_edges", "times_around"]


def outline_edges(faces: AnyInt, regions: Int32) -> tuple[Int64, Int32]:
    """Find the edges that are not between two faces of one region.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), integer
        Vertex indices; vertices at one place are one.
    regions : ndarray of shape (F,), int32
        >= 0.

    Returns
    -------
    edges : ndarray of shape (E, 2), int64
        Vertices, in the direction in which the region's face has them: seen from outside the
        region lies to the left. Where more faces of a region meet, what does not cancel.
    of_region : ndarray of shape (E,), int32
        Ascending.

    Examples
    --------
    >>> edges, of_region = outline_edges(np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, np.int32))
    >>> edges.tolist()
    [[0, 1], [3, 0], [1, 2], [2, 3]]
    """
    corners = faces.astype(np.int64)
    start = corners.reshape(-1)
    end = np.roll(corners, -1, axis=1).reshape(-1)
    region = np.repeat(regions, 3)
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low, region))
    low, high, region = low[order], high[order], region[order]
    forwards = np.where(start[order] < end[order], 1, -1)
    first = np.ones(len(low), np.bool_)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1]) | (region[1:] != region[:-1])
    starts = np.flatnonzero(first)
    net = np.add.reduceat(forwards, starts) if len(starts) else np.zeros(0, np.int64)
    net[low[starts] == high[starts]] = 0  # the grid put both ends at one place
    open_ = np.repeat(starts[net != 0], np.abs(net[net != 0]))
    ahead = np.repeat(net[net != 0] > 0, np.abs(net[net != 0]))
    edges = np.where(
        ahead[:, None],
        np.stack([low[open_], high[open_]], axis=1),
        np.stack([high[open_], low[open_]], axis=1),
    )
    return edges, region[open_].astype(np.int32)


@numba.njit(cache=True, nogil=True)
def times_around(points: Float64, starts: Float64, ends: Float64) -> Int64:
    """Count how often directed edges go around places, anticlockwise: their winding number.

    Parameters
    ----------
    points : ndarray of shape (P, 2), float64
    starts, ends : ndarray of shape (E, 2), float64
        Closed loops altogether.

    Returns
    -------
    ndarray of shape (P,), int64
        0 outside. Of the outline of ground how many more times it lies above or below the place
        face up than face down.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    >>> ends = np.roll(square, -1, axis=0)
    >>> times_around(np.array([[1.0, 1.0], [3.0, 1.0]]), square, ends).tolist()
    [1, 0]
    """
    count = np.zeros(len(points), np.int64)
    for p in range(len(points)):
        x, y = points[p]
        for e in range(len(starts)):
            y0, y1 = starts[e, 1], ends[e, 1]
            if (y0 <= y) == (y1 <= y):
                continue
            side = (ends[e, 0] - starts[e, 0]) * (y - y0) - (x - starts[e, 0]) * (y1 - y0)
            if y1 > y0 and side > 0.0:
                count[p] += 1
            elif y1 < y0 and side < 0.0:
                count[p] -= 1
    return count
