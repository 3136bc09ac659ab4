"""Which of many points can lie near any of a few: a cheap sieve before an exact search.

A search tree over every face of a survey takes seconds; often it is asked about a handful of loose
pieces only. The sieve marks the cells of a coarse grid around those and keeps the points in marked
cells, so that the tree is built over few.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Bool, Float64, UInt8
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["may_be_near"]


_MAX_CELLS: Final = 2**22
"""Cells of the grid at most (4 MiB)."""
_CELLS_PER_RADIUS: Final = 4.0
"""Cells are at least the largest radius over this, so that a query marks at most 10^3 of them."""
_SLACK: Final = 1e-6
"""Share by which radii are enlarged against rounding."""


def may_be_near(points: AnyFloat, queries: Float64, radius_m: Float64, *, threads: int = 1) -> Bool:
    """Points that may be within a query's radius.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float
        Points to sieve, metres; finite.
    queries : ndarray of shape (Q, 3), float64
        Places of interest, metres; Q >= 1.
    radius_m : ndarray of shape (Q,), float64
        How far around each, metres, >= 0.
    threads : int
        Threads at most.

    Returns
    -------
    ndarray of shape (N,), bool
        True for every point within ``radius_m[q]`` of any ``queries[q]``, and for some others.
    """
    reach = radius_m * (1.0 + _SLACK)
    widest = float(reach.max())
    low = (queries - reach[:, None]).min(axis=0)
    extent = (queries + reach[:, None]).max(axis=0) - low
    longest = float(extent.max())
    cell = max(longest / 512.0, widest / _CELLS_PER_RADIUS, np.finfo(np.float64).tiny)
    while True:
        shape = np.floor(extent / cell).astype(np.int64) + 3  # one cell of margin on each side
        if float(np.prod(shape.astype(np.float64))) <= _MAX_CELLS:
            break
        cell *= 1.25
    marked = np.zeros(tuple(shape.tolist()), np.uint8)
    _mark(as_kernel_input(queries, np.float64), reach, low - cell, cell, marked)
    near = np.empty(len(points), np.bool_)
    given = as_kernel_input(points, np.float32 if points.dtype == np.float32 else np.float64)
    corner = low - cell
    in_chunks(
        lambda begin, end: _sieve(given, corner, cell, marked, near, begin, end),
        len(points), threads=threads,
    )  # fmt: skip
    return near


@numba.njit(cache=True, nogil=True)
def _mark(queries: Float64, reach: Float64, low: Float64, cell: float, marked: UInt8) -> None:
    first = np.empty(3, np.int64)
    last = np.empty(3, np.int64)
    for q in range(len(queries)):
        for axis in range(3):
            side = marked.shape[axis] - 1
            start = int((queries[q, axis] - reach[q] - low[axis]) / cell)
            stop = int((queries[q, axis] + reach[q] - low[axis]) / cell)
            first[axis], last[axis] = max(start, 0), min(stop, side)
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    marked[i, j, k] = 1


@numba.njit(cache=True, nogil=True)
def _sieve(
    points: AnyFloat,
    low: Float64,
    cell: float,
    marked: UInt8,
    near: Bool,
    begin: int,
    end: int,
) -> None:
    for p in range(begin, end):
        near[p] = False
        x = np.float64(points[p, 0]) - low[0]
        y = np.float64(points[p, 1]) - low[1]
        z = np.float64(points[p, 2]) - low[2]
        if x < 0.0 or y < 0.0 or z < 0.0:
            continue
        u, v, w = x / cell, y / cell, z / cell
        if u >= marked.shape[0] or v >= marked.shape[1] or w >= marked.shape[2]:
            continue
        near[p] = marked[int(u), int(v), int(w)] == 1
