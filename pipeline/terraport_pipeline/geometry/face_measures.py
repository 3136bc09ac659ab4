"""Plain measures of faces and of sets of faces that several steps need.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = [
    "automatic_extent",
    "dense_labels",
    "edge_steps",
    "face_boxes",
    "face_centres",
    "first_faces",
    "label_boxes",
]

_Float32 = npt.NDArray[np.float32]
_Float64 = npt.NDArray[np.float64]
_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]

_AUTO_EXTENT: Final = 2.0
"""Automatic extent: this many sides of the square that ``max_faces`` faces of mean area would
fill."""
_LENGTH_STEPS: Final = 2**20
"""Steps in the longest edge: finer than float32 rounding, and 2^43 edges fit an int64 sum."""


def face_centres(vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]) -> _Float64:
    """Mean of each face's three corners, (F, 3) float64, in the vertices' unit and frame."""
    centres: _Float64 = vertices[faces[:, 0]].astype(np.float64)
    centres += vertices[faces[:, 1]]
    centres += vertices[faces[:, 2]]
    centres /= 3.0
    return centres


def face_boxes(
    vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]
) -> tuple[_Float32, _Float32]:
    """Least and greatest corner of every face, two (F, 3) float32, in the vertices' unit."""
    positions = vertices.astype(np.float32, copy=False)
    a, b, c = positions[faces[:, 0]], positions[faces[:, 1]], positions[faces[:, 2]]
    low = np.minimum(a, b)
    high = np.maximum(a, b)
    return np.minimum(low, c, out=low), np.maximum(high, c, out=high)


def label_boxes(
    labels: _Int32, size: _Int64, low: _Float32, high: _Float32
) -> tuple[_Float32, _Float32]:
    """Box of the faces of every label, two (L, 3) float32; ``size`` are faces per label, >= 1."""
    order = np.argsort(labels, kind="stable")
    starts = np.cumsum(size) - size
    return np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts)


def first_faces(labels: _Int32, count: int) -> _Int64:
    """Lowest face of every label 0..count-1, (count,) int64; 0 for labels that do not occur."""
    first = np.zeros(count, np.int64)
    first[labels[::-1]] = np.arange(len(labels) - 1, -1, -1)
    return first


def dense_labels(labels: npt.NDArray[np.integer]) -> _Int32:
    """Labels as 0.. without gaps, in their own order."""
    numbered: _Int32 = np.unique(labels, return_inverse=True)[1].astype(np.int32)
    return numbered


def edge_steps(vertices: npt.NDArray[np.floating], edges: _Int32) -> _Int64:
    """Edge lengths as whole steps, at least 1, (P,) int64; see ``unit_graph.py``."""
    if len(edges) == 0:
        return np.zeros(0, np.int64)
    along = vertices[edges[:, 0]].astype(np.float64)
    along -= vertices[edges[:, 1]]
    length = np.sqrt((along * along).sum(axis=1))
    longest = float(length.max())
    if longest > 0.0:
        length *= _LENGTH_STEPS / longest
    steps: _Int64 = np.maximum(np.rint(length), 1.0).astype(np.int64)
    return steps


def automatic_extent(
    vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer], max_faces: int
) -> float:
    """Twice the side of the square that ``max_faces`` faces of mean area fill."""
    corner = vertices[faces[:, 0]].astype(np.float64)
    normal = np.cross(vertices[faces[:, 1]] - corner, vertices[faces[:, 2]] - corner)
    area = 0.5 * float(np.sqrt((normal * normal).sum(axis=1)).sum())
    side = _AUTO_EXTENT * float(np.sqrt(area * max_faces / len(faces)))
    if side > 0.0:
        return side
    # every face has zero area: do not cut by width
    return max(float(np.ptp(vertices, axis=0).max()), 1.0)
