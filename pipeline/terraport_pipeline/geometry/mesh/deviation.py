"""How far one mesh lies from another.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["distances_to_mesh", "point_triangle_distances"]

_CHUNK = 20_000
"""Points per step; with 16 candidate triangles each it bounds the scratch to 5 MB."""


def distances_to_mesh(
    points: Float32, vertices: Float32, faces: Int32, *, candidates: int = 16, workers: int = 1
) -> Float32:
    """Measure the distance of points to a mesh.

    Parameters
    ----------
    points : ndarray of shape (P, 3), float32
        Metres.
    vertices : ndarray of shape (V, 3), float32
        Metres, the same frame.
    faces : ndarray of shape (F, 3), int32
        At least one.
    candidates : int
        Faces looked at per point: those with the nearest centres.
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    ndarray of shape (P,), float32
        Metres. Exact to the candidates; never less than the true distance, and more only where
        `candidates` smaller faces stand between.
    """
    centres = vertices[faces].mean(axis=1)
    tree = cKDTree(centres, balanced_tree=False)
    count = min(candidates, len(faces))
    samples = as_kernel_input(points, np.float32)
    corners, triangles = as_kernel_input(vertices, np.float32), as_kernel_input(faces, np.int32)
    out = np.empty(len(points), dtype=np.float32)

    def measure(begin: int, end: int) -> None:
        _, near = tree.query(points[begin:end], k=[*range(1, count + 1)])
        _least_distances(samples[begin:end], corners, triangles, near, out[begin:end])

    in_chunks(measure, len(points), threads=workers, chunk=_CHUNK)
    return out


def point_triangle_distances(points: Float64, triangles: Float64) -> Float64:
    """Measure the distance of each point to its own triangle.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
    triangles : ndarray of shape (N, 3, 3), float64
        Corners; triangles without area count as their longest edge.

    Returns
    -------
    ndarray of shape (N,), float64

    Examples
    --------
    >>> flat = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    >>> float(point_triangle_distances(np.array([[0.2, 0.2, 3.0]]), flat)[0])
    3.0
    >>> float(point_triangle_distances(np.array([[-4.0, 0.0, 3.0]]), flat)[0])
    5.0
    """
    return _own_distances(
        as_kernel_input(points, np.float64), as_kernel_input(triangles, np.float64)
    )


@numba.njit(cache=True, nogil=True)
def _least_distances(
    points: Float32, vertices: Float32, faces: Int32, near: Int64, out: Float32
) -> None:
    corners, point = np.empty((3, 3)), np.empty(3)
    for p in range(len(points)):
        for axis in range(3):
            point[axis] = points[p, axis]
        least = np.inf
        for rank in range(near.shape[1]):
            for corner in range(3):
                for axis in range(3):
                    corners[corner, axis] = vertices[faces[near[p, rank], corner], axis]
            least = min(least, _distance(point, corners))
        out[p] = least


@numba.njit(cache=True, nogil=True)
def _own_distances(points: Float64, triangles: Float64) -> Float64:
    out = np.empty(len(points))
    for p in range(len(points)):
        out[p] = _distance(points[p], triangles[p])
    return out


@numba.njit(cache=True, nogil=True)
def _distance(point: Float64, corners: Float64) -> float:
    """Distance of a point to a triangle: along its normal above it, else to its nearest edge."""
    normal = _cross(corners[0], corners[1], corners[0], corners[2])
    squared = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
    inside = squared > 0.0
    nearest = np.inf
    for corner in range(3):
        start, end = corners[corner], corners[(corner + 1) % 3]
        if inside:
            x, y, z = _cross(start, end, start, point)
            inside = x * normal[0] + y * normal[1] + z * normal[2] >= 0.0
        nearest = min(nearest, _to_edge(point, start, end))
    if not inside:
        return nearest
    height = 0.0
    for axis in range(3):
        height += (point[axis] - corners[0, axis]) * normal[axis]
    return float(abs(height) / np.sqrt(squared))


@numba.njit(cache=True, nogil=True)
def _cross(
    from_1: Float64, to_1: Float64, from_2: Float64, to_2: Float64
) -> tuple[float, float, float]:
    """Cross product of two edge vectors, given by their ends; scalars for the kernel."""
    x1, y1, z1 = to_1[0] - from_1[0], to_1[1] - from_1[1], to_1[2] - from_1[2]
    x2, y2, z2 = to_2[0] - from_2[0], to_2[1] - from_2[1], to_2[2] - from_2[2]
    return y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2


@numba.njit(cache=True, nogil=True)
def _to_edge(point: Float64, start: Float64, end: Float64) -> float:
    length = dot = 0.0
    for axis in range(3):
        along = end[axis] - start[axis]
        length += along * along
        dot += (point[axis] - start[axis]) * along
    share = min(max(dot / (length if length > 0.0 else 1.0), 0.0), 1.0)
    squared = 0.0
    for axis in range(3):
        away = point[axis] - (start[axis] + share * (end[axis] - start[axis]))
        squared += away * away
    return float(np.sqrt(squared))
