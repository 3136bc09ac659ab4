"""How far the base stands over the detail at the rim of what is loaded.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int64

__all__ = ["rim_heights"]


_MAX_PAIRS: Final = 2_000_000
"""Pairs of a face and a vertex looked at together: about 400 MB of scratch."""
_MARGIN: Final = 0.05
"""Share of a face's size by which a vertex may lie beside it and still count."""
_MAX_CELLS: Final = 64
"""Columns that one face may take along each axis; larger faces make the columns wider."""


def rim_heights(
    vertices: AnyFloat,
    faces: AnyInt,
    points: AnyFloat,
    *,
    most_m: float,
) -> Float32:
    """Measure how far to lower the vertices of rim faces, so that none stands over the detail.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Of the base, metres, Y up.
    faces : ndarray of shape (K, 3), integer
        The rim's faces, counter-clockwise seen from above the ground.
    points : ndarray of shape (P, 3), float
        Vertices of the loaded detail, metres, the same frame.
    most_m : float
        Detail further below or above a face than this belongs to something else (another storey),
        and nothing is lowered further.

    Returns
    -------
    ndarray of shape (V,), float32
        Metres, 0 to `most_m`: for each vertex the largest height of any face around it over a point
        that lies straight (along the face's normal) below that face. 0 away from the rim.

    Notes
    -----
    Faces and points meet in square columns as wide as the median face; linear in what meets.
    """
    out = np.zeros(len(vertices), dtype=np.float32)
    if len(faces) == 0 or len(points) == 0 or not most_m > 0:
        return out
    corner = np.asarray(vertices, dtype=np.float64)[faces]
    place = np.asarray(points, dtype=np.float64)
    height = np.zeros(len(faces))
    for face, point in _meetings(corner, place, most_m):
        above = _heights(corner[face], place[point])
        within = (above > 0) & (above <= most_m)
        np.maximum.at(height, face[within], above[within])
    np.maximum.at(out, faces.ravel(), np.repeat(height, 3).astype(np.float32))
    return out


def _meetings(corner: Float64, place: Float64, most_m: float) -> Iterator[tuple[Int64, Int64]]:
    """Pair each face with the points in the columns that it touches, in bounded portions."""
    flat = corner[:, :, [0, 2]]
    low, high = flat.min(axis=1) - most_m, flat.max(axis=1) + most_m
    width = max(float(np.median(high - low)), float((high - low).max()) / _MAX_CELLS, 1e-6)
    origin = low.min(axis=0)
    reach = (high.max(axis=0) - origin) / width
    columns = reach.astype(np.int64) + 1
    # points by column
    cell = np.floor((place[:, [0, 2]] - origin) / width).astype(np.int64)
    inside = np.flatnonzero(((cell >= 0) & (cell < columns)).all(axis=1))
    key = cell[inside, 0] * columns[1] + cell[inside, 1]
    order = np.argsort(key, kind="stable")
    inside, key = inside[order], key[order]
    # columns of every face
    first = np.floor((low - origin) / width).astype(np.int64)
    count = np.floor((high - origin) / width).astype(np.int64) - first + 1
    total = count[:, 0] * count[:, 1]
    face = np.repeat(np.arange(len(corner)), total)
    step = np.arange(len(face)) - np.repeat(np.cumsum(total) - total, total)
    wanted = (first[face, 0] + step // count[face, 1]) * columns[1]
    wanted += first[face, 1] + step % count[face, 1]
    start = np.searchsorted(key, wanted, side="left")
    length = np.searchsorted(key, wanted, side="right") - start
    ends = np.cumsum(length)
    cuts = np.searchsorted(ends, np.arange(_MAX_PAIRS, int(ends[-1]), _MAX_PAIRS))
    for begin, end in itertools.pairwise(np.unique([0, *cuts, len(face)])):
        each = length[begin:end]
        within = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
        point = inside[np.repeat(start[begin:end], each) + within]
        yield np.repeat(face[begin:end], each), point


def _heights(corner: Float64, place: Float64) -> Float64:
    """Height of each face over its point along the face's normal; -inf where it lies beside it."""
    edge, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(edge, other)
    area = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(area > 0, area, 1.0)
    away = place - corner[:, 0]
    # Barycentric weights of the foot of the perpendicular (Ericson, Real-Time Collision, 3.4).
    v = np.einsum("ij,ij->i", np.cross(away, other), normal) / safe
    w = np.einsum("ij,ij->i", np.cross(edge, away), normal) / safe
    beside = (v < -_MARGIN) | (w < -_MARGIN) | (v + w > 1 + _MARGIN) | (area <= 0)
    above: Float64 = -np.einsum("ij,ij->i", away, normal) / np.sqrt(safe)
    above[beside] = -np.inf
    return above
