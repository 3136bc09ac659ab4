"""Vertex and face orders for GPU caches and for the codec, by meshoptimizer.

This work is based on: P. V. Sander, D. Nehab, J. Barczak, "Fast Triangle Reordering for Vertex
Locality and Reduced Overdraw", 2007, as implemented in meshoptimizer (``optimizeVertexCacheStrip``,
``optimizeVertexFetchRemap``).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import meshopt
import numpy as np

from terraport_payload.mesh import SegmentMesh
from terraport_payload.types import Int64, UInt32

__all__ = ["cache_order", "order_for_cache"]


def cache_order(mesh: SegmentMesh, *, keep_face_order: bool) -> tuple[UInt32, Int64]:
    """Order vertices by first use, and faces too unless they must keep theirs.

    Parameters
    ----------
    mesh : SegmentMesh
        Never modified.
    keep_face_order : bool
        Reorder vertices alone.

    Returns
    -------
    faces : ndarray of shape (F, 3), uint32
        In new vertex numbers.
    order : ndarray of shape (V,), int64
        For each new vertex its old number. Unused vertices come last in their old order, so none
        is lost.
    """
    faces, remap, used = meshopt.reorder_mesh(mesh.faces.reshape(-1), not keep_face_order, True)
    remap = remap.astype(np.int64)
    if len(remap) < len(mesh.positions):  # meshopt counts vertices by the largest index
        remap = np.concatenate([remap, np.full(len(mesh.positions) - len(remap), 0xFFFFFFFF)])
    unused = np.flatnonzero(remap == 0xFFFFFFFF)
    remap[unused] = used + np.arange(len(unused))
    order = np.zeros(len(remap), dtype=np.int64)
    order[remap] = np.arange(len(remap))
    return faces.reshape(-1, 3), order


def order_for_cache(faces: UInt32) -> Int64:
    """Put faces in the order that GPU vertex caches and the index codec like.

    For meshes that something else refers to by face number: order the faces with this, then number
    them, then encode with ``keep_face_order=True`` at no loss of size.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), uint32
        Vertex indices.

    Returns
    -------
    ndarray of shape (F,), int64
        Permutation: ``faces[result]`` is the new order.

    Notes
    -----
    meshoptimizer returns faces, not their numbers, and may rotate corners: faces are matched by
    their rotated corners, and equal faces (duplicates) by their old order.

    Examples
    --------
    >>> order_for_cache(np.array([[0, 1, 2], [2, 1, 3]], dtype=np.uint32)).tolist()
    [0, 1]
    """
    flat = np.ascontiguousarray(faces, dtype=np.uint32).reshape(-1)
    ordered, remap, _ = meshopt.reorder_mesh(flat, True, True)
    wanted = _rotated(ordered.reshape(-1, 3))
    given = _rotated(remap[flat].reshape(-1, 3))
    result = np.zeros(len(faces), dtype=np.int64)
    result[np.lexsort(wanted.T)] = np.lexsort(given.T)
    return result


def _rotated(faces: UInt32) -> UInt32:
    """Rotate each face so that its smallest corner comes first; winding stays."""
    first = np.argmin(faces, axis=1)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
