"""Normals of the surface without its noise: what decides which photo looks at a face.

On a noisy surface every second face is turned away from each photo, or hidden by the bump next to
it, though a photo shows all of the ground there. Judged by their own normals its faces fall into
charts of one or two. So a face counts as turned the way that the surface around it is, and as
hidden only by what stands out of the surface by more than the noise does
(:mod:`terraport_pipeline.geometry.photos.occlusion`).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.mesh.face_vector import face_vector

__all__ = ["smooth_normals"]

_ROUNDS: Final = 4
"""Averages over the faces around each vertex, one after the other: some four edges far."""


@numba.njit(cache=True, nogil=True)
def smooth_normals(vertices: Float32, faces: Int32) -> Float32:
    """Average the directions of the faces around every vertex.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32

    Returns
    -------
    ndarray of shape (V, 3), float32
        Unit vectors; zero where no face has an area.
    """
    normals = np.zeros((len(vertices), 3), np.float32)
    total = np.empty((len(vertices), 3))
    for turn in range(_ROUNDS):
        # (1) Faces add their area in the direction that they have so far: their own at first, that
        # of their corners afterwards.
        total[:] = 0.0
        for f in range(len(faces)):
            x, y, z = face_vector(vertices, faces, f)
            if turn > 0:
                area = np.sqrt(x * x + y * y + z * z)
                i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
                x = area * (np.float64(normals[i, 0]) + normals[j, 0] + normals[k, 0])
                y = area * (np.float64(normals[i, 1]) + normals[j, 1] + normals[k, 1])
                z = area * (np.float64(normals[i, 2]) + normals[j, 2] + normals[k, 2])
            for c in range(3):
                v = faces[f, c]
                total[v, 0] += x
                total[v, 1] += y
                total[v, 2] += z
        # (2) Unit length, so that a sharp ridge counts as much as a plain.
        for v in range(len(vertices)):
            x, y, z = total[v, 0], total[v, 1], total[v, 2]
            length = np.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            normals[v, 0], normals[v, 1], normals[v, 2] = x * scale, y * scale, z * scale
    return normals
