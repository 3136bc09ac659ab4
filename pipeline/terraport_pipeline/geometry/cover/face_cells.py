"""Faces in cubes of space, for what single faces are too small and too noisy to decide.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["CellGrid", "cells_around", "face_cells"]

_MAX_SIDE: Final = 2**21 - 4
"""Cells along one axis at most: three axes fit a 63-bit key, with room for one beyond at each
end."""


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """Where cells lie: for pieces of one surface that must have the same."""

    low: Float64
    """(3,) corner of the first cell, metres; nothing lies below it."""
    edge_m: float
    """Mean edge. Nothing may lie 2,097,148 cells from the corner."""


def face_cells(
    vertices: Float32, faces: Int32, edges: float, grid: CellGrid | None = None
) -> tuple[Int32, Int64]:
    """Sort faces into cells by their first corner.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    edges : float
        Side of a cell in mean edges of the faces.
    grid : CellGrid, optional
        Where the cells begin and what the mean edge is; the faces' own by default.

    Returns
    -------
    order : ndarray of shape (F,), int32
        Faces cell by cell, ascending inside each.
    starts : ndarray of shape (C + 1,), int64
        Where each cell's faces begin in `order`; no cell is empty.

    Examples
    --------
    >>> place = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    >>> row = np.concatenate([place, place + np.float32(9)])
    >>> order, starts = face_cells(row, np.array([[3, 5, 4], [0, 2, 1]], np.int32), 4.0)
    >>> order.tolist(), starts.tolist()
    ([1, 0], [0, 1, 2])
    """
    if not len(faces):
        return np.zeros(0, np.int32), np.zeros(1, np.int64)
    low, size_m = _cell_size(vertices, faces, edges, grid)
    keys = _keys(vertices, faces, low, size_m)
    order = np.argsort(keys, kind="stable").astype(np.int32)
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1)).astype(np.int64)
    return order, np.append(starts, len(faces))


def cells_around(
    vertices: Float32,
    faces: Int32,
    order: Int32,
    starts: Int64,
    edges: float,
    grid: CellGrid | None = None,
) -> Int32:
    """Find the cells around each.

    Parameters
    ----------
    vertices, faces, edges, grid
        As :func:`face_cells` was given them.
    order, starts : ndarray
        What it gave.

    Returns
    -------
    ndarray of shape (C, 27), int32
        Cell itself (at 13) and its neighbours, -1 where there are no faces.

    Examples
    --------
    >>> place = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    >>> row = np.concatenate([place, place + np.float32([5, 0, 0])])
    >>> faces = np.array([[0, 2, 1], [3, 5, 4]], np.int32)
    >>> near = cells_around(row, faces, *face_cells(row, faces, 4.0), 4.0)
    >>> near[:, [4, 13, 22]].tolist()
    [[-1, 0, 1], [0, 1, -1]]
    """
    low, size_m = _cell_size(vertices, faces, edges, grid)
    return _rows_around(_keys(vertices, faces[order[starts[:-1]]], low, size_m))


def _cell_size(
    vertices: Float32, faces: Int32, edges: float, grid: CellGrid | None
) -> tuple[Float64, float]:
    """Corner of the first cell, and the side of each, metres."""
    if grid is not None:
        return grid.low, edges * grid.edge_m
    low, extent, edge_m = _extent(vertices, faces)
    return low, max(edges * edge_m, extent / _MAX_SIDE, 1e-9)


@numba.njit(cache=True, nogil=True)
def _rows_around(keys: Int64) -> Int32:
    """Rows of the 27 cells around every cell, of keys that ascend."""
    rows = np.empty((len(keys), 27), np.int32)
    for c in range(len(keys)):
        for n in range(27):
            dx, dy, dz = n // 9 - 1, (n // 3) % 3 - 1, n % 3 - 1
            wanted = keys[c] + ((((dx << 21) + dy) << 21) + dz)
            at = np.searchsorted(keys, wanted)
            rows[c, n] = at if at < len(keys) and keys[at] == wanted else -1
    return rows


@numba.njit(cache=True, nogil=True)
def _extent(vertices: Float32, faces: Int32) -> tuple[Float64, float, float]:
    """Lowest corner, widest side and mean edge."""
    low = np.full(3, np.inf)
    extent = 0.0
    total, count = 0.0, 0
    for k in range(3):
        high = -np.inf
        for v in range(len(vertices)):
            low[k], high = min(low[k], vertices[v, k]), max(high, vertices[v, k])
        extent = max(extent, high - low[k])
    for f in range(0, len(faces), 7):
        square = 0.0
        for k in range(3):
            square += (np.float64(vertices[faces[f, 0], k]) - vertices[faces[f, 1], k]) ** 2
        total += np.sqrt(square)
        count += 1
    return low, extent, total / count


@numba.njit(cache=True, nogil=True)
def _keys(vertices: Float32, faces: Int32, low: Float64, size: float) -> Int64:
    """Key of the cell of every face's first corner."""
    keys = np.empty(len(faces), np.int64)
    for f in range(len(faces)):
        key = 0
        for k in range(3):
            # from 1 on, so that a neighbour's number never borrows from the next axis
            key = (key << 21) | (int((vertices[faces[f, 0], k] - low[k]) / size) + 1)
        keys[f] = key
    return keys
