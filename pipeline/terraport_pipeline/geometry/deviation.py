"""How far one mesh lies from another.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from terraport_pipeline.model import Float32, Float64, Int32

__all__ = ["distances_to_mesh", "point_triangle_distances"]

_CHUNK = 20_000
"""Points per step; with 16 candidate triangles each it bounds the scratch to about 150 MB."""


def distances_to_mesh(
    points: Float32, vertices: Float32, faces: Int32, *, candidates: int = 16, workers: int = -1
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
        Threads of the neighbour search; the result does not depend on it.

    Returns
    -------
    ndarray of shape (P,), float32
        Metres. Exact to the candidates; never less than the true distance, and more only where
        `candidates` smaller faces stand between.
    """
    centres = vertices[faces].mean(axis=1)
    tree = cKDTree(centres, balanced_tree=False)
    count = min(candidates, len(faces))
    out = np.empty(len(points), dtype=np.float32)
    for begin in range(0, len(points), _CHUNK):
        some = points[begin : begin + _CHUNK]
        _, near = tree.query(some, k=[*range(1, count + 1)], workers=workers)
        corners = vertices[faces[near]].astype(np.float64)
        repeated = np.broadcast_to(some[:, None].astype(np.float64), (*near.shape, 3))
        found = point_triangle_distances(repeated.reshape(-1, 3), corners.reshape(-1, 3, 3))
        out[begin : begin + _CHUNK] = found.reshape(near.shape).min(axis=1)
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
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    squared = _dot(normal, normal)
    inside = squared > 0
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _dot(np.cross(end - start, points - start), normal) >= 0
    height = np.abs(_dot(points - a, normal)) / np.sqrt(np.where(squared > 0, squared, 1.0))
    edge = np.minimum(_to_edge(points, a, b), _to_edge(points, b, c))
    edge = np.minimum(edge, _to_edge(points, c, a))
    return np.where(inside, height, edge)


def _dot(a: Float64, b: Float64) -> Float64:
    product: Float64 = np.einsum("ij,ij->i", a, b)
    return product


def _to_edge(points: Float64, start: Float64, end: Float64) -> Float64:
    along = end - start
    length = _dot(along, along)
    share = np.clip(_dot(points - start, along) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    distance: npt.NDArray[np.float64] = np.linalg.norm(
        points - (start + share[:, None] * along), axis=1
    )
    return distance
