"""Closed loops out of loose edges, and triangles into them.

Method of filling: G. Barequet and M. Sharir, "Filling gaps in the boundary of a polyhedron",
Computer Aided Geometric Design 12(2), 1995: of all triangulations the one of least area, by dynamic
programming.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64, Int64

__all__ = ["directed_loops", "fill_loop"]

_MAX_PLACES: Final = 200
"""Of a loop that is filled in one piece."""


def directed_loops(edges: Int64) -> tuple[list[Int64], int]:
    """Take directed edges apart into simple loops.

    Parameters
    ----------
    edges : ndarray of shape (E, 2), int64
        A few hundred: it is done in Python.

    Returns
    -------
    loops : list of ndarray of shape (n,), int64
        Vertices of each loop of three or more, in order; no vertex twice in one.
    lost : int
        Edges on the way to a dead end.

    Examples
    --------
    >>> directed_loops(np.array([[0, 1], [1, 2], [2, 0], [2, 5]]))
    ([array([0, 1, 2])], 1)
    """
    # (1) Edges by their start, highest end first, so that the lowest is taken first.
    following: dict[int, list[int]] = {}
    for u, v in sorted(map(tuple, edges.tolist()), reverse=True):
        following.setdefault(u, []).append(v)
    # (2) Walk on until a vertex comes again; what lies between is a loop. Invariant: `path` is
    # simple, `index_on_path` its inverse, and every edge is walked once.
    loops, lost = [], 0
    for start in sorted(following):
        while following[start]:
            path, index_on_path = [start], {start: 0}
            while path:
                ahead = following.get(path[-1])
                if not ahead:  # a dead end: this edge bounds nothing
                    dead = path.pop()
                    del index_on_path[dead]
                    lost += bool(path)
                    continue
                reached = ahead.pop()
                if reached not in index_on_path:
                    index_on_path[reached] = len(path)
                    path.append(reached)
                    continue
                loop = path[index_on_path[reached] :]
                for vertex in loop[1:]:
                    del index_on_path[vertex]
                del path[index_on_path[reached] + 1 :]
                loops.append(np.array(loop, dtype=np.int64))
                if len(path) == 1 and not following.get(path[0]):
                    break
    return [loop for loop in loops if len(loop) > 2], lost


def fill_loop(loop: Float64) -> Int64:
    """Triangulate a closed loop so that the area is least.

    A departure from the source: the time of least area grows with the cube of n, so a loop of more
    than 200 places is first cut by the shortest chord that leaves each part a quarter of it, and
    each part likewise. In a long sliver, which it mostly is, that chord runs across.

    Parameters
    ----------
    loop : ndarray of shape (n, 3), float64
        Places in order, n >= 3.

    Returns
    -------
    ndarray of shape (n - 2, 3), int64
        Places in the loop; every triangle runs the way the loop does.

    Examples
    --------
    >>> fill_loop(np.array([[0.0, 0, 0], [2, 0, 0], [0.5, 0.5, 0], [0, 2, 0]])).tolist()
    [[0, 2, 3], [0, 1, 2]]
    """
    loop = np.ascontiguousarray(loop, dtype=np.float64)
    faces = [np.zeros((0, 3), np.int64)]
    # Invariant: the faces and the parts that are left tile the loop; parts share chords alone.
    parts = [np.arange(len(loop))]
    while parts:
        part = parts.pop()
        if len(part) <= _MAX_PLACES:
            faces.append(part[_least_area(loop[part])])
            continue
        i, j = _shortest_chord(loop[part])
        parts += [part[i : j + 1], np.concatenate([part[j:], part[: i + 1]])]
    return np.concatenate(faces)


@numba.njit(cache=True)
def _shortest_chord(loop: Float64) -> tuple[int, int]:
    """Find places i < j that are nearest to each other, at least a quarter of the loop apart."""
    n = len(loop)
    apart = n // 4
    nearest, low, high = np.inf, 0, apart
    for i in range(n - apart):
        for j in range(i + apart, min(n, i + n - apart + 1)):
            gap = ((loop[i] - loop[j]) ** 2).sum()
            if gap < nearest:
                nearest, low, high = gap, i, j
    return low, high


@numba.njit(cache=True)
def _least_area(loop: Float64) -> Int64:
    """Triangulate a closed loop of n places by dynamic programming: (n - 2, 3) places in it."""
    n = len(loop)
    cost = np.zeros((n, n))
    split = np.zeros((n, n), dtype=np.int64)
    for width in range(2, n):
        for i in range(n - width):
            k = i + width
            best = np.inf
            for j in range(i + 1, k):
                u = loop[j] - loop[i]
                v = loop[k] - loop[i]
                x = u[1] * v[2] - u[2] * v[1]
                y = u[2] * v[0] - u[0] * v[2]
                z = u[0] * v[1] - u[1] * v[0]
                # A little for the length, so that flat loops are cut into short triangles.
                w = loop[k] - loop[j]
                size = np.sqrt(x * x + y * y + z * z) + 1e-3 * np.sqrt(
                    (u * u).sum() + (w * w).sum()
                )
                total = cost[i, j] + cost[j, k] + size
                if total < best:
                    best = total
                    split[i, k] = j
            cost[i, k] = best
    faces = np.empty((n - 2, 3), dtype=np.int64)
    stack = [(0, n - 1)]
    count = 0
    while len(stack) > 0:
        i, k = stack.pop()
        if k - i < 2:
            continue
        j = split[i, k]
        faces[count, 0], faces[count, 1], faces[count, 2] = i, j, k
        count += 1
        stack.append((i, j))
        stack.append((j, k))
    return faces
