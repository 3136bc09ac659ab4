"""Detail that lies far from the base, and the base faces that stand in for it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.cover.columns import Grid, rasterise
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.face_measures import face_centres

__all__ = ["FAR_BASE_EDGES", "FAR_TOLERANCES", "FarDetail", "far_detail", "median_edge"]


_NEAREST_VERTICES: Final = 4
"""Base vertices whose faces stand in for a far detail face; more would only hide the base later."""
FAR_TOLERANCES: Final = 32.0
"""Looks this many tolerances far, or so many base edges; detail beyond has no base to speak of."""
FAR_BASE_EDGES: Final = 4.0
_CLOSE, _ALONE, _BASELESS = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class FarDetail:
    """Pairs (base face, segment) as CSR over base faces, and the two counts."""

    offsets: Int64
    """(B+1,) row starts."""
    segment: Int32
    """(N,) segment numbers, each once per base face, ascending."""
    far_faces: int
    """Detail faces with no base face close by."""
    baseless_faces: int
    """Of these, faces with no base face in their column at all."""


def far_detail(
    base: tuple[Float64, Int32],
    detail: tuple[Float64, Int32],
    segment_of_face: Int32,
    grid: Grid,
    *,
    reach_m: float,
    tolerance_m: float,
    threads: int = 1,
) -> FarDetail:
    """Find detail faces far from the base, and the base faces nearest to them.

    Parameters
    ----------
    base, detail : (vertices, faces)
        Float64 (V, 3) in metres, Y up, and int32 (F, 3).
    segment_of_face : ndarray of shape (F,), int32
        Segment of every detail face.
    grid : Grid
        Columns over both meshes.
    reach_m : float
        How far beyond its column a base face is looked for, metres.
    tolerance_m : float
        A detail face is close when its centre is within twice this of such a base face.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    FarDetail
        For every far detail face its segment is entered at all base faces around the four nearest
        base vertices. Of base vertices equally near the tree's first ones are taken.
    """
    # (1) Which detail faces have no base face near them in their column.
    base_vertices, base_faces = base
    vertices, faces = detail
    starts, entries = rasterise(base_vertices, base_faces, grid, reach_m)
    state = np.empty(len(faces), np.uint8)
    limit_m = 2.0 * tolerance_m
    in_chunks(
        lambda begin, end: _match(
            vertices, faces, base_vertices, base_faces, starts, entries, grid, limit_m,
            limit_m <= reach_m, state, begin, end,
        ),
        len(faces), threads=threads,
    )  # fmt: skip
    baseless = int(np.count_nonzero(state == _BASELESS))
    far = np.flatnonzero(state != _CLOSE)
    if len(far) == 0:
        return FarDetail(np.zeros(len(base_faces) + 1, np.int64), np.zeros(0, np.int32), 0, 0)
    # (2) The base vertices nearest to those, within a limit: beyond it the detail floats free.
    vertex_ids = np.unique(base_faces)
    limit = max(
        FAR_TOLERANCES * tolerance_m, FAR_BASE_EDGES * median_edge(base_vertices, base_faces)
    )
    k = min(_NEAREST_VERTICES, len(vertex_ids))
    distance, nearest = cKDTree(base_vertices[vertex_ids]).query(
        face_centres(vertices, faces[far]), k=k, distance_upper_bound=limit, workers=threads
    )
    in_reach = np.isfinite(distance).reshape(len(far), k)
    vertex = vertex_ids[nearest.reshape(len(far), k)[in_reach]]
    segment = np.repeat(segment_of_face[far], k).reshape(len(far), k)[in_reach]
    wanted = np.unique(np.stack([vertex, segment], axis=1).astype(np.int64), axis=0)
    # (3) From vertices to the faces around them, each (face, segment) once and ascending.
    # every wanted (vertex, segment) becomes (face, segment) for all faces around the vertex
    corner = base_faces.ravel()
    by_vertex = np.argsort(corner, kind="stable")
    row = np.searchsorted(corner[by_vertex], wanted[:, 0])
    length = np.searchsorted(corner[by_vertex], wanted[:, 0], side="right") - row
    within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
    face = by_vertex[np.repeat(row, length) + within] // 3
    pairs = np.unique(np.stack([face, np.repeat(wanted[:, 1], length)], axis=1), axis=0)
    offsets = np.searchsorted(pairs[:, 0], np.arange(len(base_faces) + 1)).astype(np.int64)
    return FarDetail(offsets, pairs[:, 1].astype(np.int32), len(far), baseless)


def median_edge(vertices: Float64, faces: Int32) -> float:
    """Median length of the faces' first edges, metres."""
    squared = np.empty(len(faces))
    in_chunks(lambda begin, end: _first_edges(vertices, faces, squared, begin, end), len(faces))
    return float(np.sqrt(np.median(squared)))


@numba.njit(cache=True, nogil=True)
def _first_edges(vertices: Float64, faces: Int32, squared: Float64, begin: int, end: int) -> None:
    for f in range(begin, end):
        squared[f] = 0.0
        for axis in range(3):
            along = vertices[faces[f, 0], axis] - vertices[faces[f, 1], axis]
            squared[f] += along * along


@numba.njit(cache=True, nogil=True)
def _distance_squared(p: Float64, a: Float64, b: Float64, c: Float64) -> float:
    """Squared distance of point p to triangle abc (Ericson, Real-Time Collision Detection, 5.1).

    The nearest point is a + v (b - a) + w (c - a). Scalars only: arrays of three would be
    allocated.
    """
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for k in range(3):
        ab, ac = b[k] - a[k], c[k] - a[k]
        d1 += ab * (p[k] - a[k])
        d2 += ac * (p[k] - a[k])
        d3 += ab * (p[k] - b[k])
        d4 += ac * (p[k] - b[k])
        d5 += ab * (p[k] - c[k])
        d6 += ac * (p[k] - c[k])
    # Weights of corners b and c at the nearest point of the triangle: which of its seven regions
    # holds the projection.
    v = w = 0.0
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:  # corner a
        v = w = 0.0
    elif d3 >= 0.0 and d4 <= d3:  # corner b
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:  # corner c
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:  # edge ab, unless a = b
        v = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:  # edge ac, unless a = c
        w = d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:  # edge bc
        along = d4 - d3 + d5 - d6
        w = (d4 - d3) / along if along > 0.0 else 0.0
        v = 1.0 - w
    elif va + vb + vc > 0.0:  # inside
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    total = 0.0
    for k in range(3):
        gap = p[k] - a[k] - v * (b[k] - a[k]) - w * (c[k] - a[k])
        total += gap * gap
    return total


@numba.njit(cache=True, nogil=True)
def _match(
    vertices: Float64,
    faces: Int32,
    base_vertices: Float64,
    base_faces: Int32,
    starts: Int64,
    entries: Int32,
    grid: Grid,
    limit: float,
    hint_counts: bool,
    state: UInt8,
    begin: int,
    end: int,
) -> None:
    """Say of some detail faces whether a base face entered in the centre's column is close.

    Neighbours in the file mostly lie over one base face, so the one that was close last is tried
    first. That changes no answer: where the limit is within reach (``hint_counts``), a base face
    within the limit of a centre is entered in the centre's column.

    Parameters
    ----------
    vertices, faces : ndarray
        The detail, metres.
    base_vertices, base_faces : ndarray
        The base.
    starts, entries : ndarray
        Base faces in every column of `grid`, as CSR.
    grid : Grid
    limit : float
        Largest distance of a close face, metres.
    hint_counts : bool
        See above.
    state : ndarray of shape (F,), uint8
        Written: ``_CLOSE``, ``_ALONE`` or ``_BASELESS``.
    begin, end : int
        Detail faces.
    """
    p = np.empty(3)
    hint = -1
    for f in range(begin, end):
        # (1) The face's centre.
        for axis in range(3):
            total = vertices[faces[f, 0], axis] + vertices[faces[f, 1], axis]
            p[axis] = (total + vertices[faces[f, 2], axis]) / 3.0
        # (2) The base face that was close last.
        if hint >= 0 and hint_counts:
            a, b, c = (
                base_vertices[base_faces[hint, 0]],
                base_vertices[base_faces[hint, 1]],
                base_vertices[base_faces[hint, 2]],
            )
            if _distance_squared(p, a, b, c) <= limit * limit:
                state[f] = _CLOSE
                continue
        # (3) All base faces entered in the centre's column. Invariant: the state only rises from
        # baseless (column empty) over alone (something there, none close) to close.
        q = int((p[0] - grid.x) / grid.cell_m) * grid.nz + int((p[2] - grid.z) / grid.cell_m)
        state[f] = _BASELESS
        for e in range(starts[q], starts[q + 1]):
            a, b, c = (
                base_vertices[base_faces[entries[e], 0]],
                base_vertices[base_faces[entries[e], 1]],
                base_vertices[base_faces[entries[e], 2]],
            )
            state[f] = _ALONE
            if _distance_squared(p, a, b, c) <= limit * limit:
                state[f] = _CLOSE
                hint = entries[e]
                break
