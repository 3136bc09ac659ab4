"""Vertex and face order of a GLB for GPU caches and for the codec, by meshoptimizer.

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

__all__ = ["cache_order"]


def cache_order(mesh: SegmentMesh) -> tuple[UInt32, Int64]:
    """Order faces for the vertex cache, and vertices by first use.

    Parameters
    ----------
    mesh : SegmentMesh
        Never modified.

    Returns
    -------
    faces : ndarray of shape (F, 3), uint32
        In new vertex numbers.
    order : ndarray of shape (V,), int64
        For each new vertex its old number. Unused vertices come last in their old order, so none
        is lost.
    """
    faces, remap, used = meshopt.reorder_mesh(mesh.faces.reshape(-1), True, True)
    remap = remap.astype(np.int64)
    if len(remap) < len(mesh.positions):  # meshopt counts vertices by the largest index
        remap = np.concatenate([remap, np.full(len(mesh.positions) - len(remap), 0xFFFFFFFF)])
    unused = np.flatnonzero(remap == 0xFFFFFFFF)
    remap[unused] = used + np.arange(len(unused))
    order = np.zeros(len(remap), dtype=np.int64)
    order[remap] = np.arange(len(remap))
    return faces.reshape(-1, 3), order
