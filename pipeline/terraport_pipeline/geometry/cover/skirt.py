"""A strip hung below the border of a surface.

Quadric decimation knows no border: its errors are distances to planes, and a border may slide
within the plane for nothing. It is either held vertex by vertex, which leaves it as fine as it was,
or it frays. A strip that hangs from the border along the surface's normals adds the missing planes:
the border may be thinned where it is straight and not leave its line. (The planes are those of M.
Garland and P. Heckbert, "Surface simplification using quadric error metrics", 1997, section 6; here
they are triangles, because the library takes nothing else.)

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.mesh.border_edges import border_edges
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals

__all__ = ["add_skirt", "drop_skirt"]


def add_skirt(vertices: Float32, faces: Int32, *, drop_m: float) -> tuple[Float32, Int32, Float32]:
    """Hang a strip from every border edge.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
        Wound consistently.
    drop_m : float
        How far the strip hangs.

    Returns
    -------
    vertices : ndarray of shape (V + B, 3), float32
        The old ones, then one below each border vertex.
    faces : ndarray of shape (F + 2 E, 3), int32
        The old ones, then two for each border edge.
    hem : ndarray of shape (B, 3), float32
        The strip's lower vertices, to know it by.
    """
    edges = border_edges(faces, len(vertices)).astype(np.int64)
    rim = np.unique(edges)
    below = np.zeros(len(vertices), dtype=np.int64)
    below[rim] = len(vertices) + np.arange(len(rim))
    hem = (vertices[rim] - np.float32(drop_m) * vertex_normals(vertices, faces)[rim]).astype(
        np.float32
    )
    start, end = edges.T
    strip = np.concatenate(
        [
            np.stack([end, start, below[start]], axis=1),
            np.stack([end, below[start], below[end]], axis=1),
        ]
    )
    return (
        np.concatenate([vertices, hem]),
        np.concatenate([faces, strip.astype(np.int32)]),
        hem,
    )


def drop_skirt(vertices: Float32, faces: Int32, hem: Float32) -> Int32:
    """Take the strip away again after vertices and faces were renumbered.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        The hem's are still where they were, bit for bit.
    faces : ndarray of shape (F, 3), int32
    hem : ndarray of shape (B, 3), float32
        From :func:`add_skirt`.

    Returns
    -------
    ndarray of shape (F', 3), int32
        Faces without a corner on the hem.
    """
    on_hem = np.isin(_rows(vertices), _rows(hem))
    return np.ascontiguousarray(faces[~on_hem[faces].any(axis=1)])


def _rows(vertices: Float32) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """View positions as one sortable value a row, to compare them bit by bit."""
    packed = np.ascontiguousarray(vertices, dtype="<f4")
    return packed.view([("x", "<i4"), ("y", "<i4"), ("z", "<i4")]).reshape(-1)
