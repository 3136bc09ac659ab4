"""Faces in blocks of the ground, so that work on a large mesh holds one block at a time.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.mesh.trim import compact

__all__ = ["block_meshes", "face_blocks", "same_places", "weld", "welded_places"]

_SIDE_BITS: Final = 9
"""The ground is divided into 512 x 512 squares: a block's border is as coarse as a square, and the
counts take 1 MB."""


def face_blocks(vertices: Float32, faces: Int32, *, max_faces: int) -> Int32:
    """Put every face into a block of the ground.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    max_faces : int
        Faces in a block, about: a square of the ground is never divided.

    Returns
    -------
    ndarray of shape (F,), int32
        Block of every face, 0, 1, 2, ... along a Z-order curve of squares. Depends on the faces'
        places alone.
    """
    if not len(faces):
        return np.zeros(0, dtype=np.int32)
    low = vertices.min(axis=0).astype(np.float64)
    side_m = max(float(np.ptp(vertices, axis=0)[[0, 2]].max()), 1e-9)
    square = _squares(
        as_kernel_input(vertices, np.float32), as_kernel_input(faces, np.int32), low, side_m
    )
    counts = np.bincount(square, minlength=1 << (2 * _SIDE_BITS))
    before = np.cumsum(counts) - counts
    block_of_square = before // max_faces
    _, dense = np.unique(block_of_square[counts > 0], return_inverse=True)
    numbers = np.zeros(len(counts), dtype=np.int32)
    numbers[counts > 0] = dense
    blocks: Int32 = numbers[square]
    return blocks


def block_meshes(vertices: Float32, faces: Int32, blocks: Int32) -> Iterator[tuple[Float32, Int32]]:
    """Yield every block as a mesh of its own; faces keep their order."""
    order = np.argsort(blocks, kind="stable")
    ends = np.cumsum(np.bincount(blocks))
    begin = 0
    for end in ends:
        some = faces[order[begin:end]]
        yield compact(vertices, some, np.ones(len(some), dtype=bool))
        begin = int(end)


def same_places(positions: Float64) -> tuple[Int64, Int64]:
    """Find vertices at the same place.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float64

    Returns
    -------
    first : ndarray of shape (W,), int64
        A vertex of every place, in the order in which places come first.
    number : ndarray of shape (V,), int64
        The place of every vertex.

    Examples
    --------
    >>> first, number = same_places(np.array([[5.0, 0, 0], [1, 0, 0], [5, 0, 0]]))
    >>> first.tolist(), number.tolist()
    ([0, 1], [0, 1, 0])
    """
    # + 0.0 makes -0.0 the same bytes as 0.0.
    rows = np.ascontiguousarray(positions + 0.0).view("V24").reshape(-1)
    _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return first[order].astype(np.int64), rank[number.reshape(-1)]


def welded_places(vertices: Float32) -> tuple[Bool, Int64]:
    """Give the places that vertices stand at numbers.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32

    Returns
    -------
    stays : ndarray of shape (V,), bool
        Whether a vertex is the first of its place.
    number : ndarray of shape (V,), int64
        The place of every vertex, in the order in which places come first.
    """
    bits = np.ascontiguousarray(vertices + np.float32(0.0)).view(np.int32)
    order = np.lexsort((bits[:, 2], bits[:, 1], bits[:, 0]))
    new = np.ones(len(order), dtype=bool)
    new[1:] = (bits[order[1:]] != bits[order[:-1]]).any(axis=1)
    # lexsort is stable: the first of each run is the lowest row.
    first = np.empty(len(order), dtype=np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    stays = first == np.arange(len(order))
    number = (np.cumsum(stays) - 1)[first]
    return stays, number


def weld(vertices: Float32, faces: Int32) -> tuple[Float32, Int32]:
    """Make vertices at one place one vertex.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32

    Returns
    -------
    vertices : ndarray of shape (V', 3), float32
        The first of each place, in their old order.
    faces : ndarray of shape (F', 3), int32
        Those that still have three corners.
    """
    stays, number = welded_places(vertices)
    welded = number[faces].astype(np.int32)
    a, b, c = welded.T
    return vertices[stays], np.ascontiguousarray(welded[(a != b) & (b != c) & (c != a)])


@numba.njit(cache=True, nogil=True)
def _squares(vertices: Float32, faces: Int32, low: Float64, side_m: float) -> Int32:
    """Z-order code of the square that each face's centre stands on."""
    squares = np.empty(len(faces), np.int32)
    scale = ((1 << _SIDE_BITS) - 1) / side_m
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x = (np.float64(vertices[a, 0]) + vertices[b, 0] + vertices[c, 0]) / 3.0
        z = (np.float64(vertices[a, 2]) + vertices[b, 2] + vertices[c, 2]) / 3.0
        i, j = int((x - low[0]) * scale), int((z - low[2]) * scale)
        code = 0
        for bit in range(_SIDE_BITS):
            code |= ((i >> bit) & 1) << (2 * bit) | ((j >> bit) & 1) << (2 * bit + 1)
        squares[f] = code
    return squares
