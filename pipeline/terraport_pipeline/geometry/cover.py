"""Which segments lie over each face of the base mesh, so that the base can be hidden under loaded
detail.

At run time a base face is hidden **iff all segments of its list are loaded**; a face with an empty
list is never hidden. The lists must leave no hole for *any* subset of loaded segments. A list that
is too long only shows a piece of base a little longer than needed; one that is too short is a hole.
So every rule here errs towards longer lists.

Frame: metres, Y up; "column" means all points above and below one square cell of the horizontal
plane.

Rules
-----
1. *Columns.* A base face lists every segment with a face in a column that the base face, grown by
   ``reach_m``, touches, at whatever height.

   Why no hole on any vertical line: let the line meet full detail, and a base face b. Each detail
   face on the line is in the line's column, and b touches that column, so b lists its segment. If
   no detail face on the line is loaded, then b's list holds a segment that is not loaded, so b is
   shown. Nothing was said of heights: the argument holds for a rock that the base smoothed away,
   for thin vegetation metres above it, for overhangs and bridges. With ``max_gap_m`` set, segments
   farther above or below b than that are dropped where the column holds a nearer one. The line's
   argument then holds only where the nearer surface spans the whole cell. It is for surveys with
   storeys (mine tunnels under a surface), where the ground would otherwise wait for the tunnel's
   segments.

   Why grow by ``reach_m``: where a loaded segment ends and base begins, the two surfaces are up to
   the deviation t apart. A ray at elevation angle e passes through such a slit unless they overlap
   by t / tan(e). The default of ``2 t`` and at least one cell, on top of the base face's own width,
   closes it for all but grazing rays.

2. *Nearest base.* A detail face farther than ``2 t`` from every base face near its columns (a
   recess in a highwall that the base bridges over) is listed by all base faces around the four base
   vertices nearest to it. A horizontal ray into the recess passes exactly there, while the columns
   of the bridging face may hold only the ground below it.

3. *Partly covered faces are never hidden.* A base face under whose inside there is a cell with no
   detail in it or in the eight cells around it reaches beyond the detail (outer rim, hole over
   water). Hiding it would tear a slit between the detail's rim and the next base face. Its list is
   emptied.

Rays that are not vertical have no proof, only the margins of rules 1 and 2; `terraport validate`
measures them.

Algorithm: both meshes are rasterised conservatively (exact triangle-square overlap) into one grid
of columns with cells of ``max(t, median detail edge)``; the detail's cells are reduced to runs of
(segment, lowest, highest); each base face unites the runs of its cells. Linear in cells touched:
about 4 per detail face.

Rejected: a voxel join of dilated cells (the same near field, but it says nothing of smoothed-away
rocks and needs a second, vertical pass for them); rays along base normals from samples (misses what
lies between samples).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

__all__ = ["BaseCover", "build_cover"]

_Float64 = npt.NDArray[np.float64]
_Float32 = npt.NDArray[np.float32]
_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]
_UInt32 = npt.NDArray[np.uint32]

_MAX_CELLS: Final = 2**24
"""Cells of the grid at most (64 MiB of offsets); beyond it cells grow, which lengthens lists and
breaks nothing."""
_NEAREST_VERTICES: Final = 4
_FAR: Final = 32.0
"""Rule 2 looks this many tolerances (or four base edges) far; detail beyond it has no base to speak
of."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseCover:
    """Segments over every base face as CSR, and what was met on the way."""

    offsets: _UInt32
    """(B+1,) row starts."""
    segments: _UInt32
    """(N,) segment numbers, ascending within a row."""
    cell_m: float
    """Cell side used, metres."""
    reach_m: float
    """How far base faces were grown, metres."""
    uncovered_faces: int
    """Base faces with no detail in any of their columns: never hidden."""
    partly_covered_faces: int
    """Base faces that reach beyond the detail: never hidden (rule 3)."""
    far_detail_faces: int
    """Detail faces farther than twice the tolerance from the base near them (rule 2)."""
    baseless_detail_faces: int
    """Detail faces with no base face in their centre's column: nothing stands in for them while not
    loaded."""


def build_cover(
    base_vertices: npt.NDArray[np.floating],
    base_faces: npt.NDArray[np.integer],
    detail_vertices: npt.NDArray[np.floating],
    detail_faces: npt.NDArray[np.integer],
    segment_of_face: npt.NDArray[np.integer],
    *,
    tolerance_m: float,
    reach_m: float | None = None,
    max_gap_m: float | None = None,
    hide_partly_covered: bool = False,
) -> BaseCover:
    """Find the segments that must all be loaded before a base face may be hidden.

    Parameters
    ----------
    base_vertices : ndarray of shape (V, 3), float
        Metres, Y up; finite.
    base_faces : ndarray of shape (B, 3), integer
        Vertex indices.
    detail_vertices : ndarray of shape (W, 3), float
        Metres, the same frame.
    detail_faces : ndarray of shape (F, 3), integer
        Vertex indices.
    segment_of_face : ndarray of shape (F,), integer
        Segment of every detail face, >= 0.
    tolerance_m : float
        [t] usual deviation of base from detail (say its 99th percentile), metres, > 0.
    reach_m : float, optional
        How far base faces are grown; None for the larger of twice the tolerance and one cell.
    max_gap_m : float, optional
        See rule 1; None keeps everything in a column, which is what the proof needs.
    hide_partly_covered : bool
        True leaves rule 3 out.

    Returns
    -------
    BaseCover
        Depends on positions and segment numbers only, not on the order of vertices. The same input
        gives the same bytes.

    Raises
    ------
    ValueError
        Wrong shapes, indices out of range, a tolerance that is not a length above 0.

    Notes
    -----
    Time and memory are linear in the cells touched; about 60 bytes per detail face at the peak.
    """
    _validate_inputs(
        base_vertices, base_faces, detail_vertices, detail_faces, segment_of_face, tolerance_m
    )
    n_base, n_detail = len(base_faces), len(detail_faces)
    if n_base == 0 or n_detail == 0:
        return BaseCover(
            np.zeros(n_base + 1, np.uint32), np.zeros(0, np.uint32), tolerance_m,
            reach_m or 2.0 * tolerance_m, n_base, 0, 0, n_detail,
        )  # fmt: skip
    base_v, base_f = _contiguous(base_vertices, base_faces)
    detail_v, detail_f = _contiguous(detail_vertices, detail_faces)
    cell_m = max(tolerance_m, _median_edge(detail_v, detail_f))
    reach = max(2.0 * tolerance_m, cell_m) if reach_m is None else reach_m
    grid = _grid(base_v, base_f, detail_v, detail_f, cell_m, reach)
    cell_m = grid.cell_m
    reach = max(reach, cell_m) if reach_m is None else reach
    # (1) detail columns as runs of (segment, lowest, highest)
    starts, entries = _rasterise(detail_v, detail_f, grid.x, grid.z, cell_m, grid.nx, grid.nz, 0.0)
    offsets, segment, low, high = _runs(
        starts, entries, detail_v, detail_f, np.ascontiguousarray(segment_of_face, np.int32)
    )
    del starts, entries
    # (2) detail faces that no base face is close to
    extra_base, extra_segment, far, baseless = _far_detail(
        base_v, base_f, detail_v, detail_f, segment_of_face, grid, reach, tolerance_m
    )
    # (3) union per base face
    rows, members, status = _unite(
        base_v, base_f, grid.x, grid.z, cell_m, grid.nx, grid.nz, reach,
        offsets, segment, low, high, np.inf if max_gap_m is None else max_gap_m,
        extra_base, extra_segment, int(segment_of_face.max()) + 1, hide_partly_covered,
    )  # fmt: skip
    return BaseCover(
        rows.astype(np.uint32), members.astype(np.uint32), cell_m, reach,
        int(np.count_nonzero(status == 1)), int(np.count_nonzero(status == 2)), far, baseless,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Grid:
    x: float
    z: float
    cell_m: float
    nx: int
    nz: int


def _validate_inputs(
    base_vertices: npt.NDArray[np.floating],
    base_faces: npt.NDArray[np.integer],
    detail_vertices: npt.NDArray[np.floating],
    detail_faces: npt.NDArray[np.integer],
    segment_of_face: npt.NDArray[np.integer],
    tolerance_m: float,
) -> None:
    for name, vertices, faces in (
        ("base", base_vertices, base_faces),
        ("detail", detail_vertices, detail_faces),
    ):
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            msg = f"{name}: {vertices.shape} and {faces.shape}, expected (V, 3) and (F, 3)"
            raise ValueError(msg)
        if len(faces) and (int(faces.min()) < 0 or int(faces.max()) >= len(vertices)):
            msg = (
                f"{name}: face indices {faces.min()}..{faces.max()}, "
                f"expected 0..{len(vertices) - 1}"
            )
            raise ValueError(msg)
        if not np.isfinite(vertices).all():
            msg = f"{name}: some vertices are not finite, expected finite coordinates"
            raise ValueError(msg)
    if segment_of_face.shape != (len(detail_faces),):
        msg = f"segment_of_face has shape {segment_of_face.shape}, expected ({len(detail_faces)},)"
        raise ValueError(msg)
    if len(segment_of_face) and int(segment_of_face.min()) < 0:
        msg = f"least segment number is {segment_of_face.min()}, expected 0 or more"
        raise ValueError(msg)
    if not 0.0 < tolerance_m < np.inf:
        msg = f"tolerance_m is {tolerance_m}, expected a finite length above 0"
        raise ValueError(msg)


def _contiguous(
    vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer]
) -> tuple[_Float64, _Int32]:
    return np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32)


def _median_edge(vertices: _Float64, faces: _Int32) -> float:
    edges = vertices[faces[:, 0]] - vertices[faces[:, 1]]
    return float(np.sqrt(np.median((edges * edges).sum(axis=1))))


def _grid(
    base_v: _Float64,
    base_f: _Int32,
    detail_v: _Float64,
    detail_f: _Int32,
    cell_m: float,
    reach: float,
) -> _Grid:
    """Grid over both meshes with a margin; cells grow until there are at most ``_MAX_CELLS``."""
    used = (base_v[:, ::2], detail_v[:, ::2])
    low = np.minimum(used[0].min(axis=0), used[1].min(axis=0))
    side = np.maximum(used[0].max(axis=0), used[1].max(axis=0)) - low
    while True:
        margin = max(reach, cell_m) + 2.0 * cell_m
        n = np.floor((side + 2.0 * margin) / cell_m) + 1
        if n[0] * n[1] <= _MAX_CELLS:
            return _Grid(
                float(low[0] - margin), float(low[1] - margin), cell_m, int(n[0]), int(n[1])
            )
        cell_m *= 1.25


def _far_detail(
    base_v: _Float64,
    base_f: _Int32,
    detail_v: _Float64,
    detail_f: _Int32,
    segment_of_face: npt.NDArray[np.integer],
    grid: _Grid,
    reach: float,
    tolerance_m: float,
) -> tuple[_Int64, _Int32, int, int]:
    """Rule 2: extra (base face, segment) pairs as CSR over base faces, and the two counts."""
    starts, entries = _rasterise(
        base_v, base_f, grid.x, grid.z, grid.cell_m, grid.nx, grid.nz, reach
    )
    state = _match(
        detail_v, detail_f, base_v, base_f, starts, entries, grid.x, grid.z, grid.cell_m, grid.nz,
        2.0 * tolerance_m,
    )  # fmt: skip
    far = np.flatnonzero(state > 0)
    baseless = int(np.count_nonzero(state == 2))
    none = np.zeros(len(base_f) + 1, np.int64), np.zeros(0, np.int32)
    if len(far) == 0:
        return *none, 0, baseless
    vertex_ids = np.unique(base_f)
    limit = max(_FAR * tolerance_m, 4.0 * _median_edge(base_v, base_f))
    k = min(_NEAREST_VERTICES, len(vertex_ids))
    centres = detail_v[detail_f[far]].mean(axis=1)
    distance, nearest = cKDTree(base_v[vertex_ids]).query(
        centres, k=k, distance_upper_bound=limit, workers=-1
    )
    found = np.isfinite(distance).reshape(len(far), k)
    vertex = vertex_ids[nearest.reshape(len(far), k)[found]]
    segment = np.repeat(segment_of_face[far], k).reshape(len(far), k)[found]
    wanted = np.unique(np.stack([vertex, segment], axis=1).astype(np.int64), axis=0)
    corner = base_f.ravel()
    by_vertex = np.argsort(corner, kind="stable")
    row = np.searchsorted(corner[by_vertex], wanted[:, 0])
    length = np.searchsorted(corner[by_vertex], wanted[:, 0], side="right") - row
    within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
    base = by_vertex[np.repeat(row, length) + within] // 3
    pairs = np.unique(np.stack([base, np.repeat(wanted[:, 1], length)], axis=1), axis=0)
    offsets = np.searchsorted(pairs[:, 0], np.arange(len(base_f) + 1)).astype(np.int64)
    return offsets, pairs[:, 1].astype(np.int32), len(far), baseless


@numba.njit(cache=True)
def _touches(
    ax: float,
    az: float,
    bx: float,
    bz: float,
    cx: float,
    cz: float,
    x: float,
    z: float,
    half: float,
) -> bool:
    """Whether a triangle's projection meets the square of centre (x, z); its boxes are known to."""
    for _ in range(3):
        nx, nz = az - bz, bx - ax
        radius = half * (abs(nx) + abs(nz))
        centre = nx * (x - ax) + nz * (z - az)
        apex = nx * (cx - ax) + nz * (cz - az)
        if centre - radius > max(apex, 0.0) or centre + radius < min(apex, 0.0):
            return False
        ax, az, bx, bz, cx, cz = bx, bz, cx, cz, ax, az
    return True


@numba.njit(cache=True)
def _rasterise(
    vertices: _Float64,
    faces: _Int32,
    x0: float,
    z0: float,
    cell: float,
    nx: int,
    nz: int,
    grow: float,
) -> tuple[_Int64, _Int32]:
    """Faces in every column as CSR over cells; faces ascend within a cell."""
    starts = np.zeros(nx * nz + 1, np.int64)
    entries = np.empty(0, np.int32)
    half = (0.5 * cell + grow) * (1.0 + 1e-6)
    edge = grow + 1e-6 * cell  # rounding must never lose a cell
    for fill in range(2):
        for f in range(len(faces)):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            ax, az = vertices[a, 0], vertices[a, 2]
            bx, bz = vertices[b, 0], vertices[b, 2]
            cx, cz = vertices[c, 0], vertices[c, 2]
            i0 = int((min(ax, bx, cx) - edge - x0) / cell)
            i1 = int((max(ax, bx, cx) + edge - x0) / cell)
            j0 = int((min(az, bz, cz) - edge - z0) / cell)
            j1 = int((max(az, bz, cz) + edge - z0) / cell)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    x, z = x0 + (i + 0.5) * cell, z0 + (j + 0.5) * cell
                    if not _touches(ax, az, bx, bz, cx, cz, x, z, half):
                        continue
                    cell_id = i * nz + j
                    if fill == 0:
                        starts[cell_id] += 1
                    else:
                        starts[cell_id] -= 1
                        entries[starts[cell_id]] = f
        if fill == 0:
            total = 0
            for cell_id in range(nx * nz + 1):
                total += starts[cell_id]
                starts[cell_id] = total
            entries = np.empty(total, np.int32)
    return starts, entries


@numba.njit(cache=True)
def _runs(
    starts: _Int64, entries: _Int32, vertices: _Float64, faces: _Int32, segment_of_face: _Int32
) -> tuple[_Int64, _Int32, _Float32, _Float32]:
    """Per column one run (segment, lowest, highest) for each segment in it."""
    n_cells = len(starts) - 1
    offsets = np.zeros(n_cells + 1, np.int64)
    last = np.full(segment_of_face.max() + 1, -1, np.int64)  # run of the segment in this column
    total = 0
    for q in range(n_cells):
        begin = total
        for e in range(starts[q], starts[q + 1]):
            s = segment_of_face[entries[e]]
            if last[s] < begin:
                last[s] = total
                total += 1
    segment = np.empty(total, np.int32)
    low = np.full(total, np.inf, np.float32)
    high = np.full(total, -np.inf, np.float32)
    last[:] = -1
    total = 0
    for q in range(n_cells):
        begin = total
        for e in range(starts[q], starts[q + 1]):
            f = entries[e]
            s = segment_of_face[f]
            if last[s] < begin:
                last[s] = total
                segment[total] = s
                total += 1
            a, b, c = (
                vertices[faces[f, 0], 1], vertices[faces[f, 1], 1], vertices[faces[f, 2], 1],
            )  # fmt: skip
            low[last[s]] = min(low[last[s]], min(a, b, c))
            high[last[s]] = max(high[last[s]], max(a, b, c))
        offsets[q + 1] = total
    return offsets, segment, low, high


@numba.njit(cache=True)
def _distance_squared(p: _Float64, a: _Float64, b: _Float64, c: _Float64) -> float:
    """Squared distance of point p to triangle abc (Ericson, Real-Time Collision Detection, 5.1)."""
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = np.dot(ab, ap), np.dot(ac, ap)
    bp = p - b
    d3, d4 = np.dot(ab, bp), np.dot(ac, bp)
    cp = p - c
    d5, d6 = np.dot(ab, cp), np.dot(ac, cp)
    if d1 <= 0.0 and d2 <= 0.0:
        gap = ap
    elif d3 >= 0.0 and d4 <= d3:
        gap = bp
    elif d6 >= 0.0 and d5 <= d6:
        gap = cp
    else:
        va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
        if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            gap = ap - ab * (d1 / (d1 - d3))
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            gap = ap - ac * (d2 / (d2 - d6))
        elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
            gap = bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))
        else:
            total = va + vb + vc
            gap = ap - ab * (vb / total) - ac * (vc / total) if total > 0.0 else ap
    return np.dot(gap, gap)  # type: ignore[no-any-return]


@numba.njit(cache=True)
def _match(
    vertices: _Float64,
    faces: _Int32,
    base_v: _Float64,
    base_f: _Int32,
    starts: _Int64,
    entries: _Int32,
    x0: float,
    z0: float,
    cell: float,
    nz: int,
    limit: float,
) -> npt.NDArray[np.uint8]:
    """State of each face: 0 a base face of its centre's column is within the limit, 1 none, 2
    bare."""
    state = np.empty(len(faces), np.uint8)
    for f in range(len(faces)):
        p = (vertices[faces[f, 0]] + vertices[faces[f, 1]] + vertices[faces[f, 2]]) / 3.0
        q = int((p[0] - x0) / cell) * nz + int((p[2] - z0) / cell)
        state[f] = 2
        for e in range(starts[q], starts[q + 1]):
            b = entries[e]
            gap = _distance_squared(
                p, base_v[base_f[b, 0]], base_v[base_f[b, 1]], base_v[base_f[b, 2]]
            )
            state[f] = 1
            if gap <= limit * limit:
                state[f] = 0
                break
    return state


@numba.njit(cache=True)
def _is_bare(offsets: _Int64, i: int, j: int, nx: int, nz: int) -> bool:
    """Whether neither this cell nor any around it holds detail."""
    for u in range(max(i - 1, 0), min(i + 2, nx)):
        for v in range(max(j - 1, 0), min(j + 2, nz)):
            if offsets[u * nz + v] < offsets[u * nz + v + 1]:
                return False
    return True


@numba.njit(cache=True)
def _unite(
    vertices: _Float64,
    faces: _Int32,
    x0: float,
    z0: float,
    cell: float,
    nx: int,
    nz: int,
    grow: float,
    offsets: _Int64,
    segment: _Int32,
    low: _Float32,
    high: _Float32,
    max_gap: float,
    extra_offsets: _Int64,
    extra_segment: _Int32,
    n_segments: int,
    hide_partly_covered: bool,
) -> tuple[_Int64, _Int32, npt.NDArray[np.uint8]]:
    """Lists of all base faces; status 1 = no detail near, 2 = reaches beyond the detail."""
    rows = np.zeros(len(faces) + 1, np.int64)
    members = np.empty(4 * len(faces) + 16, np.int32)
    status = np.zeros(len(faces), np.uint8)
    seen = np.full(n_segments, -1, np.int64)
    found = np.empty(n_segments, np.int32)
    half = (0.5 * cell + grow) * (1.0 + 1e-6)
    edge = grow + 1e-6 * cell
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, az = vertices[a, 0], vertices[a, 2]
        bx, bz = vertices[b, 0], vertices[b, 2]
        cx, cz = vertices[c, 0], vertices[c, 2]
        least = min(vertices[a, 1], vertices[b, 1], vertices[c, 1])
        most = max(vertices[a, 1], vertices[b, 1], vertices[c, 1])
        count = 0
        partly = _is_bare(
            offsets, int(((ax + bx + cx) / 3.0 - x0) / cell), int(((az + bz + cz) / 3.0 - z0) /
            cell), nx, nz,
        )  # fmt: skip
        for i in range(
            int((min(ax, bx, cx) - edge - x0) / cell), int((max(ax, bx, cx) + edge - x0) / cell) + 1
        ):
            for j in range(
                int((min(az, bz, cz) - edge - z0) / cell),
                int((max(az, bz, cz) + edge - z0) / cell) + 1,
            ):
                x, z = x0 + (i + 0.5) * cell, z0 + (j + 0.5) * cell
                if not _touches(ax, az, bx, bz, cx, cz, x, z, half):
                    continue
                q = i * nz + j
                if offsets[q] == offsets[q + 1]:
                    # The cell's centre inside the face (a square of no size) and bare: beyond the
                    # detail.
                    if (
                        not partly
                        and _touches(ax, az, bx, bz, cx, cz, x, z, 0.0)
                        and min(ax, bx, cx) <= x <= max(ax, bx, cx)
                        and min(az, bz, cz) <= z <= max(az, bz, cz)
                    ):
                        partly = _is_bare(offsets, i, j, nx, nz)
                    continue
                nearest = np.inf
                for e in range(offsets[q], offsets[q + 1]):
                    nearest = min(nearest, max(low[e] - most, least - high[e], 0.0))
                for e in range(offsets[q], offsets[q + 1]):
                    s = segment[e]
                    gap = max(low[e] - most, least - high[e], 0.0)
                    if seen[s] != f and (gap <= max_gap or gap <= nearest):
                        seen[s] = f
                        found[count] = s
                        count += 1
        for e in range(extra_offsets[f], extra_offsets[f + 1]):
            s = extra_segment[e]
            if seen[s] != f:
                seen[s] = f
                found[count] = s
                count += 1
        if count == 0:
            status[f] = 1
        elif partly and not hide_partly_covered:
            status[f] = 2
            count = 0
        begin = rows[f]
        if begin + count > len(members):
            larger = np.empty(2 * len(members) + count, np.int32)
            larger[:begin] = members[:begin]
            members = larger
        members[begin : begin + count] = np.sort(found[:count])
        rows[f + 1] = begin + count
    return rows, members[: rows[len(faces)]].copy(), status
