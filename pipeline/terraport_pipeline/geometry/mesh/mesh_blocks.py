"""A mesh in another order: faces and vertices of one place beside each other.

Passes that ask of every photo which faces it sees leave out whole blocks that lie outside its cone.
Solvers write their faces in strips as long as the survey, whose boxes exclude nothing, so faces and
vertices are sorted into square columns of the ground, the columns along a Z-order curve.

PURE: no I/O, no clock. Time and memory linear in the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["MeshBlocks", "mesh_blocks"]

_FACES_PER_BLOCK: Final = 4096
"""Aimed at: a photo's border cuts blocks of 64 x 64 faces, a small part of what it sees, and
testing a block costs nothing beside projecting it."""

_MAX_SIDE: Final = 256
"""Columns along one side at most: 65,536 blocks are tested in under a millisecond."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshBlocks:
    """A mesh sorted into B compact blocks of faces, each with a bounding sphere."""

    vertices: Float32
    """(V, 3) metres, in the new order."""
    faces: Int32
    """(F, 3) into the new order of vertices, in the new order of faces."""
    vertex_order: Int32
    """(V,) old vertex of each new one."""
    face_order: Int32
    """(F,) old face of each new one."""
    vertex_starts: Int64
    """(B + 1,) first vertex of each block."""
    face_starts: Int64
    """(B + 1,) first face of each block."""
    spheres: Float64
    """(B, 4) centre and radius, metres, around the vertices of each block and the corners of its
    faces; radius -1 where it has neither."""

    def face_places(self) -> Int32:
        """Give the new place of every old face, (F,)."""
        back = np.empty_like(self.face_order)
        back[self.face_order] = np.arange(len(back), dtype=np.int32)
        return back


def mesh_blocks(vertices: Float32, faces: Int32) -> MeshBlocks:
    """Sort a mesh into blocks.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame (Y up).
    faces : ndarray of shape (F, 3), int32
        A face belongs to the block of its first corner. F may be 0.

    Returns
    -------
    MeshBlocks
        Within a block the old order stays.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], np.float32)
    >>> blocks = mesh_blocks(square, np.array([[0, 2, 1], [1, 2, 3]], np.int32))
    >>> blocks.face_starts.tolist(), blocks.spheres.round(3).tolist()
    ([0, 2], [[0.5, 0.0, 0.5, 0.707]])
    """
    points = as_kernel_input(vertices, np.float32)
    corners = as_kernel_input(faces, np.int32)
    side = 1
    while side < _MAX_SIDE and side * side * _FACES_PER_BLOCK < len(corners):
        side *= 2
    block = _block_of_vertices(points, side)
    vertex_order, vertex_starts = _counting_sort(block, side * side)
    new_row = np.empty(len(points), np.int32)
    new_row[vertex_order] = np.arange(len(points), dtype=np.int32)
    first = corners[:, 0] if len(corners) else np.zeros(0, np.int32)
    face_order, face_starts = _counting_sort(block[first], side * side)
    new_vertices = points[vertex_order]
    new_faces = new_row[corners[face_order]] if len(corners) else np.zeros((0, 3), np.int32)
    spheres = _spheres(new_vertices, new_faces, vertex_starts, face_starts)
    return MeshBlocks(
        new_vertices, new_faces, vertex_order, face_order, vertex_starts, face_starts, spheres
    )


@numba.njit(cache=True, nogil=True)
def _block_of_vertices(points: Float32, side: int) -> Int32:
    """Column of every vertex, numbered along a Z-order curve."""
    low_x, low_z, high_x, high_z = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points)):
        low_x, high_x = min(low_x, points[i, 0]), max(high_x, points[i, 0])
        low_z, high_z = min(low_z, points[i, 2]), max(high_z, points[i, 2])
    size = max(high_x - low_x, high_z - low_z)
    scale = side / size if size > 0.0 else 0.0
    block = np.empty(len(points), np.int32)
    for i in range(len(points)):
        column = min(int((points[i, 0] - low_x) * scale), side - 1)
        row = min(int((points[i, 2] - low_z) * scale), side - 1)
        code = 0
        for bit in range(8):
            code |= ((column >> bit) & 1) << (2 * bit)
            code |= ((row >> bit) & 1) << (2 * bit + 1)
        block[i] = code
    return block


@numba.njit(cache=True, nogil=True)
def _counting_sort(keys: Int32, n_keys: int) -> tuple[Int32, Int64]:
    """Stable order of the keys, and where each begins."""
    starts = np.zeros(n_keys + 1, np.int64)
    for key in keys:
        starts[key + 1] += 1
    for key in range(n_keys):
        starts[key + 1] += starts[key]
    cursor = starts[:-1].copy()
    order = np.empty(len(keys), np.int32)
    for i in range(len(keys)):
        order[cursor[keys[i]]] = i
        cursor[keys[i]] += 1
    return order, starts


@numba.njit(cache=True, nogil=True)
def _spheres(points: Float32, faces: Int32, vertex_starts: Int64, face_starts: Int64) -> Float64:
    n_blocks = len(vertex_starts) - 1
    spheres = np.empty((n_blocks, 4))
    low, high = np.empty(3), np.empty(3)
    for b in range(n_blocks):
        low[:], high[:] = np.inf, -np.inf
        # The box of the block's own vertices, and of those that its faces borrow from other
        # blocks.
        for v in range(vertex_starts[b], vertex_starts[b + 1]):
            for k in range(3):
                low[k], high[k] = min(low[k], points[v, k]), max(high[k], points[v, k])
        for f in range(face_starts[b], face_starts[b + 1]):
            for c in range(3):
                for k in range(3):
                    value = points[faces[f, c], k]
                    low[k], high[k] = min(low[k], value), max(high[k], value)
        square = 0.0
        for k in range(3):
            spheres[b, k] = 0.5 * (low[k] + high[k])
            square += (0.5 * (high[k] - low[k])) ** 2
        spheres[b, 3] = np.sqrt(square)
        # An empty block has radius -1: no test of visibility passes it.
        if low[0] > high[0]:
            spheres[b] = 0.0
            spheres[b, 3] = -1.0
    return spheres
