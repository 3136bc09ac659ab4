"""A hem around a surface: strips that go on outwards from its border, in its own plane.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.border_edges import open_edges

__all__ = ["add_hem"]


def add_hem(vertices: Float32, faces: Int32, *, width_m: float) -> tuple[Float32, Int32]:
    """Widen a surface beyond its border.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
        Wound consistently.
    width_m : float

    Returns
    -------
    vertices : ndarray of shape (V + B, 3), float32
        The old ones, then one outside each of the B border vertices, `width_m` from it along the
        mean of its edges' outward directions (less where these cancel out, as in a gap one face
        wide).
    faces : ndarray of shape (F + 2 E, 3), int32
        The old ones, then two for each of the E border edges, wound as their neighbours.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    >>> wide, _ = add_hem(square, np.array([[0, 1, 2], [0, 2, 3]], np.int32), width_m=1.0)
    >>> wide[4].astype(float).round(3).tolist()
    [-0.707, -0.707, 0.0]
    """
    edges = open_edges(faces, len(vertices)).astype(np.int64)
    if not len(edges):
        return vertices, faces
    start, end = edges.T
    # (1) Outward: to the right of an edge, as its face lies to the left.
    along = vertices[end].astype(np.float64) - vertices[start]
    outward = np.cross(along, _normals_at(vertices, faces, edges))
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    rim, local = np.unique(edges, return_inverse=True)
    local = local.reshape(-1, 2)
    total = np.zeros((len(rim), 3))
    for side in range(2):
        np.add.at(total, local[:, side], outward)
    direction = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1.0)
    outside = (vertices[rim] + width_m * direction).astype(np.float32)
    # (2) Two faces an edge.
    beyond = len(vertices) + local
    strip = np.concatenate(
        [
            np.stack([end, start, beyond[:, 0]], axis=1),
            np.stack([end, beyond[:, 0], beyond[:, 1]], axis=1),
        ]
    )
    return (
        np.concatenate([vertices, outside]),
        np.concatenate([faces, strip.astype(np.int32)]),
    )


def _normals_at(vertices: Float32, faces: Int32, edges: Int64) -> Float64:
    """Compute the normal of the face that each directed edge belongs to, (E, 3), of any length."""
    n_vertices = np.int64(len(vertices))
    wanted = edges[:, 0] * n_vertices + edges[:, 1]
    order = np.argsort(wanted)
    normals = np.zeros((len(edges), 3))
    on_rim = np.zeros(len(vertices), np.bool_)
    on_rim[edges.ravel()] = True
    some = faces[on_rim[faces].sum(axis=1) >= 2].astype(np.int64)
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        key = some[:, a] * n_vertices + some[:, b]
        at = np.minimum(np.searchsorted(wanted[order], key), len(order) - 1)
        found = np.flatnonzero(wanted[order][at] == key)
        first = vertices[some[found, a]].astype(np.float64)
        normal = np.cross(vertices[some[found, b]] - first, vertices[some[found, c]] - first)
        normals[order[at[found]]] = normal
    return normals
