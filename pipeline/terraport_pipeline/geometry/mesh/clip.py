"""Cut a surface along the zero line of a field given at its vertices.

Taking whole faces away leaves a border with teeth as long as a face. Here a face that the line
passes is cut where it passes: the border is as smooth as the field.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["Clip", "clip_with_sources"]


_NEAR: Final = 0.2
"""A cut this near to an end of an edge (share of its length) goes through the end instead: no
slivers. The border is off by at most this share of an edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A clipped surface, and where its vertices come from."""

    vertices: Float32
    """(V', 3) metres: those that stay in their old order, then the cut's, in the order of the faces
    that need them first."""
    faces: Int32
    """(F', 3) in their old order, wound as before; a face that was cut is followed by its second
    half."""
    ends: Int64
    """(V', 2) vertices before: twice the same for one that stayed, the ends of its edge for a cut,
    in the order of their coordinates."""
    share: Float64
    """(V',) how far from the first end to the second; 0 for one that stayed."""


def clip_with_sources(vertices: Float32, faces: Int32, field: Float32) -> Clip:
    """Keep the part of a surface on which the field is not negative.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
    field : ndarray of shape (V,), float32
        Linear within a face. NaN counts as negative.

    Returns
    -------
    Clip
        With the sources of every vertex, so that values at the vertices can follow.

    Notes
    -----
    A new vertex depends on its edge's end points alone, taken in the order of their coordinates:
    two meshes that share an edge bit for bit (neighbouring tiles) cut it bit for bit alike. Whether
    a cut goes through an end of the edge depends on that edge alone too, so such a vertex stays
    only as a corner of faces that keep area.
    Linear in the faces; about 40 bytes of scratch per face that is cut.
    """
    points = as_kernel_input(vertices, np.float32)
    triangles = as_kernel_input(faces, np.int32)
    values = np.where(np.isnan(field), -1.0, field).astype(np.float32)
    crossed = _crossed_edges(triangles, values)
    stayed = np.repeat(np.arange(len(points), dtype=np.int64)[:, None], 2, axis=1)
    if not len(crossed):
        inside = (values >= 0)[triangles].all(axis=1) if len(triangles) else np.zeros(0, bool)
        return _used(points, triangles[inside], stayed, np.zeros(len(points)))
    # One row per edge that is cut; numbered by first use, so that the result does not depend on
    # how edges sort.
    keys, first = np.unique(crossed, return_index=True)
    rank = np.empty(len(keys), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(keys))
    cuts, replaced, ends, share = _cut_points(points, values, keys, rank, len(points))
    pieces = _cut_faces(triangles, values, keys, replaced, len(crossed))
    return _used(
        np.concatenate([points, cuts]),
        pieces,
        np.concatenate([stayed, ends]),
        np.concatenate([np.zeros(len(points)), share]),
    )


def _used(vertices: Float32, faces: Int32, ends: Int64, share: Float64) -> Clip:
    """Drop vertices that no face uses, and renumber the others in their order."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    number = np.cumsum(used, dtype=np.int64) - 1
    return Clip(
        vertices[used], number[faces].astype(np.int32).reshape(-1, 3), ends[used], share[used]
    )


@numba.njit(cache=True, nogil=True)
def _crossed_edges(faces: Int32, field: Float32) -> Int64:
    """Keys (lower vertex * 2^32 + higher) of edges with ends on both sides, once per face."""
    count = 0
    for f in range(len(faces)):
        for corner in range(3):
            a, b = faces[f, corner], faces[f, (corner + 1) % 3]
            count += (field[a] < 0.0) != (field[b] < 0.0)
    keys = np.empty(count, np.int64)
    at = 0
    for f in range(len(faces)):
        for corner in range(3):
            a, b = np.int64(faces[f, corner]), np.int64(faces[f, (corner + 1) % 3])
            if (field[a] < 0.0) != (field[b] < 0.0):
                keys[at] = (min(a, b) << 32) | max(a, b)
                at += 1
    return keys


@numba.njit(cache=True, nogil=True)
def _cut_points(
    vertices: Float32, field: Float32, keys: Int64, rank: Int64, first_number: int
) -> tuple[Float32, Int64, Int64, Float64]:
    """Place the cut of every edge.

    Returns new vertices by rank, each key's vertex number, and by rank the ends and the share.
    """
    cuts = np.zeros((len(keys), 3), np.float32)
    ends = np.empty((len(keys), 2), np.int64)
    shares = np.empty(len(keys))
    number = np.empty(len(keys), np.int64)
    for k in range(len(keys)):
        a, b = keys[k] >> 32, keys[k] & 0xFFFFFFFF
        # The cut depends on the ends' positions alone: two tiles that share the edge compute the
        # same.
        if _comes_after(vertices, a, b):
            a, b = b, a
        share = np.float64(field[a]) / (np.float64(field[a]) - np.float64(field[b]))
        ends[rank[k], 0], ends[rank[k], 1], shares[rank[k]] = a, b, share
        for axis in range(3):
            start, end = np.float64(vertices[a, axis]), np.float64(vertices[b, axis])
            cuts[rank[k], axis] = start + share * (end - start)
        # Close to a kept end that end is taken instead, lest slivers arise.
        number[k] = first_number + rank[k]
        if field[a] >= 0.0 and share < _NEAR:
            number[k] = a
        elif field[b] >= 0.0 and 1.0 - share < _NEAR:
            number[k] = b
    return cuts, number, ends, shares


@numba.njit(cache=True, nogil=True)
def _comes_after(vertices: Float32, a: int, b: int) -> bool:
    for axis in range(3):
        if vertices[a, axis] != vertices[b, axis]:
            return bool(vertices[a, axis] > vertices[b, axis])
    return False


@numba.njit(cache=True, nogil=True)
def _cut_faces(faces: Int32, field: Float32, keys: Int64, number: Int64, crossings: int) -> Int32:
    """Keep, drop or cut each face; corners that met at one vertex make no face."""
    out = np.empty((len(faces) + crossings, 3), np.int32)
    corners = np.empty(4, np.int64)
    count = 0
    # Walk around the face: corners on the kept side, and the cut of every edge that changes
    # sides. Invariant: corners[:n] is the kept polygon so far, without repeats; it has four at
    # most.
    for f in range(len(faces)):
        n = 0
        for corner in range(3):
            a, b = np.int64(faces[f, corner]), np.int64(faces[f, (corner + 1) % 3])
            if field[a] >= 0.0 and (n == 0 or corners[n - 1] != a):
                corners[n] = a
                n += 1
            if (field[a] < 0.0) != (field[b] < 0.0):
                key = (min(a, b) << 32) | max(a, b)
                cut = number[np.searchsorted(keys, key)]
                if n == 0 or corners[n - 1] != cut:
                    corners[n] = cut
                    n += 1
        # Two triangles at most; a sliver whose corners met is no face.
        if n > 1 and corners[n - 1] == corners[0]:
            n -= 1
        if n >= 3:
            out[count, 0], out[count, 1], out[count, 2] = corners[0], corners[1], corners[2]
            count += 1
        if n == 4:
            out[count, 0], out[count, 1], out[count, 2] = corners[0], corners[2], corners[3]
            count += 1
    return out[:count].copy()
