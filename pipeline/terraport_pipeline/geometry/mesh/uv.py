"""Texture coordinates of corners (wedges) to coordinates of vertices.

Atlases, and files such as OBJ, give every corner of every face a coordinate of its own; engines and
glTF want one per vertex. A vertex on a seam is therefore there once per different coordinate
(thesis, section 3.5.4: "per-wedge to per-vertex").

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["SplitMesh", "split_wedges"]


@dataclass(frozen=True, slots=True, eq=False)
class SplitMesh:
    """A mesh with one texture coordinate per vertex."""

    vertex: Int32
    """(W,) vertex of the original mesh that each new vertex is a copy of."""
    faces: Int32
    """(F, 3) the original faces, corner by corner, in new vertex numbers."""
    uvs: Float32
    """(W, 2) coordinates of the new vertices."""
    labels: Int32
    """(W,) label of the faces that use each new vertex; zeros where none were given."""


def split_wedges(
    faces: AnyInt,
    wedge_uvs: AnyFloat,
    n_vertices: int,
    *,
    labels: AnyInt | None = None,
) -> SplitMesh:
    """Split vertices at seams.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), integer
        Vertex indices, below *n_vertices*.
    wedge_uvs : ndarray of shape (F, 3, 2), floating
        Coordinate of every corner. Corners of a vertex become one exactly where both numbers are
        equal as float32 (-0 equals 0); NaN equals NaN.
    n_vertices : int
        Number of vertices.
    labels : ndarray of shape (F,), integer, optional
        Of every face, for example its region: vertices are split where it changes, too.

    Returns
    -------
    SplitMesh
        New vertices are numbered by first use, so faces that are in cache order stay so. Vertices
        that no face uses are left out.

    Raises
    ------
    ValueError
        Wrong shapes, or an index outside 0..n_vertices-1.

    Notes
    -----
    Linear in F: variants of a vertex hang in a list behind it (hardly ever more than four). 30
    bytes per corner of scratch. 10 M faces take 0.9 CPU-s.

    Examples
    --------
    A square of two faces over the edge (1, 2); the second starts a new chart.

    >>> faces = np.array([[0, 1, 2], [2, 1, 3]])
    >>> wedges = np.array([[[0, 0], [1, 0], [0, 1]], [[0.5, 1], [1, 0], [1, 1]]], dtype=float)
    >>> split = split_wedges(faces, wedges, 4)
    >>> split.vertex.tolist(), split.faces.tolist()
    ([0, 1, 2, 2, 3], [[0, 1, 2], [3, 1, 4]])
    """
    # (1) Refuse what does not fit.
    corners = np.asarray(faces)
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise ValueError(f"faces have shape {corners.shape}, expected (F, 3)")
    if wedge_uvs.shape != (len(corners), 3, 2):
        raise ValueError(
            f"wedge uvs have shape {wedge_uvs.shape}, expected ({len(corners)}, 3, 2): a pair for "
            "every corner"
        )
    if labels is not None and labels.shape != (len(corners),):
        raise ValueError(f"labels have shape {labels.shape}, expected ({len(corners)},)")
    if len(corners) and not (corners.min() >= 0 and corners.max() < n_vertices):
        raise ValueError(
            f"vertices {corners.min()} to {corners.max()}, expected 0 to {n_vertices - 1}"
        )
    # (2) One number per pair of coordinates, bit by bit: -0 is 0 (by the sum), and NaN is one
    # NaN.
    pairs = np.ascontiguousarray(wedge_uvs, dtype=np.float32).reshape(-1, 2) + np.float32(0.0)
    pairs[np.isnan(pairs)] = np.nan  # one NaN of the many
    code = pairs.view(np.int64).reshape(-1)
    # (3) One vertex per (vertex, coordinates, label) that occurs.
    label = np.zeros(len(corners), np.int32) if labels is None else labels
    new_faces = np.empty((len(corners), 3), np.int32)
    first = _number_variants(
        as_kernel_input(corners, np.int32),
        as_kernel_input(code, np.int64),
        as_kernel_input(label, np.int32),
        n_vertices,
        new_faces,
    )
    return SplitMesh(
        vertex=corners.reshape(-1)[first].astype(np.int32),
        faces=new_faces,
        uvs=pairs[first],
        labels=np.asarray(label, dtype=np.int32)[first // 3],
    )


@numba.njit(cache=True, nogil=True)
def _number_variants(
    faces: Int32, code: Int64, label: Int32, n_vertices: int, new_faces: Int32
) -> Int64:
    """Give every variant of a vertex a number; return the first corner of each."""
    # Invariant: the variants of a vertex are a linked list from head[vertex], in order of their
    # first corner; first[:count] are these corners, ascending.
    head = np.full(n_vertices, -1, np.int32)
    following = np.empty(faces.size, np.int32)
    first = np.empty(faces.size, np.int64)
    count = 0
    for f in range(len(faces)):
        for c in range(3):
            corner = 3 * f + c
            vertex = faces[f, c]
            variant, last = head[vertex], -1
            while variant >= 0:
                same = first[variant]
                if code[same] == code[corner] and label[same // 3] == label[f]:
                    break
                last, variant = variant, following[variant]
            if variant < 0:
                variant = count
                first[variant] = corner
                following[variant] = -1
                if last < 0:
                    head[vertex] = variant
                else:
                    following[last] = variant
                count += 1
            new_faces[f, c] = variant
    return first[:count].copy()
