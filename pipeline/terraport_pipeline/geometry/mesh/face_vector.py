"""A face's doubled area as a vector along its normal, for kernels.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Float32, Int32

__all__ = ["face_vector"]


@numba.njit(cache=True, nogil=True, inline="always")
def face_vector(vertices: Float32, faces: Int32, f: int) -> tuple[float, float, float]:
    """Cross two edges of face `f`.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
    f : int

    Returns
    -------
    tuple of float
        Along the side from which the corners run anticlockwise; as long as twice the area, square
        metres. Zero where the corners lie in a line.
    """
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    ax, ay, az = (
        np.float64(vertices[j, 0]) - vertices[i, 0],
        np.float64(vertices[j, 1]) - vertices[i, 1],
        np.float64(vertices[j, 2]) - vertices[i, 2],
    )
    bx, by, bz = (
        np.float64(vertices[k, 0]) - vertices[i, 0],
        np.float64(vertices[k, 1]) - vertices[i, 1],
        np.float64(vertices[k, 2]) - vertices[i, 2],
    )
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
