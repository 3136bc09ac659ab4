"""Decimation by fast-simplification (quadric error metrics with a rising threshold).

M. Garland and P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997.
"""

from __future__ import annotations

import threading

import fast_simplification
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["decimate", "decimate_tracked"]

_LOCK = threading.Lock()
"""The library keeps its mesh in a global: one call at a time and process."""

_AGGRESSION = 5.0
"""How fast the threshold rises; lower follows the error order more closely (the library's default
is 7)."""


def decimate(
    vertices: Float32, faces: Int32, *, max_faces: int, aggression: float = _AGGRESSION
) -> tuple[Float32, Int32]:
    """Reduce a mesh to about a number of faces, leaving its border where it is.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
    max_faces : int
        Wanted. More can be left where the border alone needs more.
    aggression : float
        How fast the error threshold rises.

    Returns
    -------
    vertices : ndarray of shape (V', 3), float32
    faces : ndarray of shape (F', 3), int32
        Without faces that use a vertex twice. The input itself when it is small enough.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    with _LOCK:
        points, triangles = fast_simplification.simplify(
            vertices.astype(np.float64),
            np.ascontiguousarray(faces),
            target_count=max_faces,
            agg=aggression,
            preserve_border=True,
        )
    triangles = np.asarray(triangles, dtype=np.int32)
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    return np.asarray(points, dtype=np.float32), np.ascontiguousarray(triangles[proper])


def decimate_tracked(
    vertices: Float64, faces: Int32, *, max_faces: int, aggression: float = _AGGRESSION
) -> tuple[Float64, Int32, Int64]:
    """Reduce a mesh as :func:`decimate` does, and tell what became of each vertex.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float64
        Metres.
    faces : ndarray of shape (F, 3), int32
    max_faces : int
    aggression : float

    Returns
    -------
    vertices : ndarray of shape (V', 3), float64
        Those of the border are bit for bit what they were.
    faces : ndarray of shape (F', 3), int32
    merged_into : ndarray of shape (V,), int64
        The vertex of the result that each vertex of the input went into.
    """
    if len(faces) <= max_faces:
        return vertices, faces, np.arange(len(vertices))
    with _LOCK:
        _, _, collapses = fast_simplification.simplify(
            vertices,
            np.ascontiguousarray(faces),
            target_count=max_faces,
            agg=aggression,
            preserve_border=True,
            return_collapses=True,
        )
        points, triangles, merged_into = fast_simplification.replay_simplification(
            vertices, np.ascontiguousarray(faces), collapses
        )
    triangles = np.asarray(triangles, dtype=np.int32)
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    kept = np.ascontiguousarray(triangles[proper])
    return np.asarray(points, dtype=np.float64), kept, np.asarray(merged_into, dtype=np.int64)
