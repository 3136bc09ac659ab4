"""An order of faces in which most share an edge with the one before, which format 2 packs best.

Source: depth-first walks over the faces, right before left, as in strip generators since F. Evans,
S. Skiena, A. Varshney, "Optimizing triangle strips for fast rendering", 1996. Departure: no
look-ahead; a walk that ends goes on at the newest face that it left aside, so that walks lie side
by side and vertices are met again soon.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import AnyInt, Bool, Int64

__all__ = ["strip_order"]


def strip_order(faces: AnyInt) -> Int64:
    """Order faces so that each shares an edge with the one before it, where it can.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int
        Vertex indices; any triangles, also with edges of more than two faces.

    Returns
    -------
    ndarray of shape (F,), int64
        Permutation: ``faces[result]`` is the new order.

    Examples
    --------
    >>> strip_order(np.array([[0, 1, 2], [4, 5, 6], [2, 1, 3]])).tolist()
    [0, 2, 1]
    """
    corners = np.ascontiguousarray(faces, dtype=np.int64)
    return _walk(_opposite_half_edges(corners))


def _opposite_half_edges(faces: Int64) -> Int64:
    """For half-edge 3 f + k (from corner k to the next) that which runs the other way, or -1."""
    begins, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    size = int(faces.max(initial=0)) + 1
    keys = begins * size + ends
    order = np.argsort(keys, kind="stable")
    wanted = ends * size + begins
    place = np.minimum(np.searchsorted(keys, wanted, sorter=order), max(len(keys) - 1, 0))
    found = order[place] if len(keys) else place
    return np.where(keys[found] == wanted, found, -1) if len(keys) else found


@numba.njit(cache=True, nogil=True)
def _walk(opposite: Int64) -> Int64:
    count = len(opposite) // 3
    is_used = np.zeros(count, np.bool_)
    order = np.empty(count, np.int64)
    # Half-edges of faces that a walk left aside; each is put there once at most.
    aside = np.empty(len(opposite) + 1, np.int64)
    waiting = 0
    seed = 0
    done = 0
    while done < count:
        start = -1
        while waiting > 0 and start < 0:
            waiting -= 1
            if not is_used[aside[waiting] // 3]:
                start = aside[waiting]
        if start < 0:
            while is_used[seed]:
                seed += 1
            start = 3 * seed
        edge = start
        while edge >= 0:
            face = edge // 3
            is_used[face] = True
            order[done] = face
            done += 1
            right = _unused(opposite, is_used, 3 * face + (edge + 1) % 3)
            left = _unused(opposite, is_used, 3 * face + (edge + 2) % 3)
            if right >= 0 and left >= 0:
                aside[waiting] = left
                waiting += 1
            edge = right if right >= 0 else left
    return order


@numba.njit(cache=True, nogil=True)
def _unused(opposite: Int64, is_used: Bool, edge: int) -> int:
    other = opposite[edge]
    return -1 if other < 0 or is_used[other // 3] else other
