"""A mesh for pictures from afar: vertices of one cell become one.

Vertex clustering on a grid (J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for
rendering complex scenes", 1993), with the cell's first vertex for all: it keeps its colour and
normal. Vertices on the mesh's border stay, so that no cracks open between pieces thinned by
themselves.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Int32, Int64

__all__ = ["thin_by_cells"]


def thin_by_cells(vertices: AnyFloat, faces: AnyInt, cell_m: float) -> tuple[Int64, Int32, Int64]:
    """Unite the vertices of every cube of space.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    cell_m : float
        Side of the cubes, > 0.

    Returns
    -------
    kept : ndarray of shape (W,), int64
        Vertices that stand for their cubes.
    faces : ndarray of shape (G, 3), int32
        Faces between three different ones of ``kept``.
    origin : ndarray of shape (G,), int64
        The face that each of them was.

    Examples
    --------
    A hexagon with two vertices inside, which lie in one cell: its rim stays.

    >>> turn = np.arange(6) * np.pi / 3
    >>> rim = np.stack([3 * np.cos(turn), 0 * turn, 3 * np.sin(turn)], axis=1)
    >>> corners = np.concatenate([rim, [[0.2, 0, 0.2], [0.4, 0, 0.4]]])
    >>> inner = [[7, 6, 1], [7, 6, 4]]
    >>> outer = [[0, 1, 7], [0, 5, 7], [5, 4, 7], [1, 2, 6], [2, 3, 6], [3, 4, 6]]
    >>> kept, left, origin = thin_by_cells(corners, np.array(inner + outer), 1.0)
    >>> len(kept), origin.tolist()
    (7, [2, 3, 4, 5, 6, 7])
    """
    if not len(faces):
        return np.zeros(0, np.int64), np.zeros((0, 3), np.int32), np.zeros(0, np.int64)
    cell = np.floor(np.asarray(vertices, np.float64) / cell_m).astype(np.int64)
    cell -= cell.min(axis=0)
    _, span_y, span_z = (int(n) + 1 for n in cell.max(axis=0))
    key = (cell[:, 0] * span_y + cell[:, 1]) * span_z + cell[:, 2]
    border = _border_vertices(faces, len(vertices))
    key[border] = -1 - border
    _, kept, node = np.unique(key, return_index=True, return_inverse=True)
    corners = node[faces]
    real = (
        (corners[:, 0] != corners[:, 1])
        & (corners[:, 1] != corners[:, 2])
        & (corners[:, 2] != corners[:, 0])
    )
    origin = np.flatnonzero(real)
    return kept, corners[origin].astype(np.int32), origin


def _border_vertices(faces: AnyInt, n_vertices: int) -> Int64:
    """Vertices of edges that only one face has, ascending."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64)
    key, count = np.unique(edges.min(axis=1) * n_vertices + edges.max(axis=1), return_counts=True)
    return np.unique(np.stack(np.divmod(key[count == 1], n_vertices)))
