"""Faces in cubes of space, for what single faces are too small and too noisy to decide.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
import numpy.typing as npt

from terraport_pipeline.model import Float32, Float64, Int32

__all__ = ["CellGrid", "face_cells"]

_MAX_SIDE: Final = 2**21 - 1
"""Cells along one axis at most: three axes fit a 63-bit key."""

_Int64 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class CellGrid:
    """Where cells lie: for pieces of one surface that must have the same."""

    low: Float64
    """(3,) corner of the first cell, metres; nothing lies below it."""
    edge_m: float
    """Mean edge. Nothing may lie 2,097,151 cells from the corner."""


def face_cells(
    vertices: Float32, faces: Int32, edges: float, grid: CellGrid | None = None
) -> tuple[Int32, _Int64]:
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
    if grid is None:
        low, extent, edge_m = _extent(vertices, faces)
        size_m = max(edges * edge_m, extent / _MAX_SIDE, 1e-9)
    else:
        low, size_m = grid.low, edges * grid.edge_m
    keys = _keys(vertices, faces, low, size_m)
    order = np.argsort(keys, kind="stable").astype(np.int32)
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1)).astype(np.int64)
    return order, np.append(starts, len(faces))


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
def _keys(vertices: Float32, faces: Int32, low: Float64, size: float) -> _Int64:
    """Key of the cell of every face's first corner."""
    keys = np.empty(len(faces), np.int64)
    for f in range(len(faces)):
        key = 0
        for k in range(3):
            key = (key << 21) | int((vertices[faces[f, 0], k] - low[k]) / size)
        keys[f] = key
    return keys
