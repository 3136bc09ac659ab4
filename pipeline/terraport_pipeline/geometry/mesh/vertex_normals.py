"""Vertex normals of a triangle mesh.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.model import UP

__all__ = ["normal_sums", "unit_normals", "vertex_normals"]


def vertex_normals(vertices: Float32, faces: Int32) -> Float32:
    """Average the adjacent faces' normals, weighted by area.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
        Counter-clockwise seen from outside.

    Returns
    -------
    ndarray of shape (V, 3), float32
        Unit. Vertices that no face with area uses point up.

    Notes
    -----
    Sums run in float64 over faces in their order: the same mesh gives the same bits.

    Examples
    --------
    >>> flat = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float32)
    >>> vertex_normals(flat, np.array([[0, 1, 2]], dtype=np.int32)).tolist()[0]
    [0.0, 1.0, 0.0]
    """
    return unit_normals(normal_sums(vertices, faces))


def normal_sums(vertices: Float32, faces: Int32) -> Float64:
    """Sum the adjacent faces' normals, each as long as twice its area: (V, 3) float64.

    Sums over the pieces of a mesh add up to those of the whole.
    """
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    doubled = np.cross(b - a, c - a)
    del a, b, c
    count = len(vertices)
    total = np.zeros((count, 3))
    for axis in range(3):
        for corner in range(3):
            total[:, axis] += np.bincount(faces[:, corner], doubled[:, axis], minlength=count)
    return total


def unit_normals(total: Float64) -> Float32:
    """Make sums of normals unit length, (V, 3) float32; those without length point up."""
    total = total.copy()
    length = np.linalg.norm(total, axis=1)
    lost = length < np.finfo(np.float32).tiny
    total[lost] = UP
    length[lost] = 1.0
    normals: Float32 = (total / length[:, None]).astype(np.float32)
    return normals
