"""Segments over each face of the base mesh, so that detail can replace it.

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
   no detail face on the line is loaded, then b's list has a segment that is not loaded, so b is
   shown. The argument does not use heights: it holds for a rock that the base smoothed away, for
   thin vegetation metres above it, for overhangs and bridges. With ``max_gap_m``, segments farther
   above or below b than that are dropped if the column has a nearer one. The argument then holds
   only where the nearer surface spans the whole cell. The option is for surveys with several levels
   (mine tunnels under a surface), where the ground would otherwise wait for the tunnel's segments.

   Why grow by ``reach_m``: on a steep face the base is next to the detail, not over or under it. It
   replaces a point of the detail if it crosses the vertical through the point, or the normal there
   within 4 tolerances (:data:`STAND_IN_TOLERANCES`, which the proof of the hand-off also uses). So
   a base face has to list every segment within 4 tolerances of it in any direction. The default is
   the larger of that length and one cell, plus a twentieth, as positions are later rounded to the
   payloads' grid.

2. *Nearest base.* A detail face farther than ``2 t`` from every base face near its columns (a
   recess in a highwall that the base bridges over) is listed by all base faces around the four base
   vertices nearest to it. A horizontal ray into the recess passes exactly there, while the columns
   of the bridging face may hold only the ground below it.

3. *Partly covered faces are never hidden.* A base face reaches beyond the detail (outer rim, hole
   over water) if it contains a cell without detail in it and in the eight cells around it. Hiding
   it would open a gap between the detail's rim and the next base face. Its list is emptied.

Why no hole on any other ray, by the definition in ``docs/topics/hand-off.md``: let a ray meet
detail at a point p of a segment that is not loaded. If a base face replaces p, rule 1 keeps it
shown. If none does, let q be the next point of the base on the ray. If q is hidden, all detail
within 4 tolerances of q is loaded. If there is no such detail and q is in the air, the detail shows
nothing at q either, and the rest of the ray behind q is judged in the same way. One case remains:
no base face replaces p, the ray enters the ground at p and meets q, which is hidden, still under
the ground and more than 4 tolerances from all detail. No list of bounded length excludes it;
``terraport validate`` searches for it.

Algorithm: both meshes are rasterised conservatively (exact triangle-square overlap) into one grid
of columns with cells of ``max(t, median detail edge)``; the detail's cells are reduced to runs of
(segment, lowest, highest); each base face unites the runs of its cells. Linear in cells touched:
about 4 per detail face.

Rejected: a voxel join of dilated cells (the same near the base, but it misses smoothed-away rocks
and needs a second, vertical pass for them); rays along base normals from samples (they miss detail
between samples).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, Int64, UInt8, UInt32
from terraport_pipeline.geometry.cover.columns import (
    Grid,
    Runs,
    cell_span,
    fit_grid,
    meets_square,
    rasterise,
    segment_runs,
)
from terraport_pipeline.geometry.cover.far_detail import far_detail, median_edge
from terraport_pipeline.geometry.mesh.chunks import in_chunks, side_by_side
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["STAND_IN_TOLERANCES", "BaseCover", "build_cover"]

STAND_IN_TOLERANCES: Final = 4.0
"""Maximum distance, in tolerances, at which base replaces detail, along the vertical or a
normal."""

_ROUNDING_SHARE: Final = 0.05
"""Share added to the reach: published positions are rounded to a grid whose step is a fiftieth of
the points' spacing."""

_COVERED, _BARE, _PARTLY = 0, 1, 2
_BASE_CHUNK: Final = 2**16
"""Base faces in a piece of work."""
_INSERTION: Final = 64
"""Longest list that insertion sorts; longer ones are read off all segments in order."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseCover:
    """Segments over every base face as CSR, and what was met on the way."""

    offsets: UInt32
    """(B+1,) row starts."""
    segments: UInt32
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
    base_vertices: AnyFloat,
    base_faces: AnyInt,
    detail_vertices: AnyFloat,
    detail_faces: AnyInt,
    segment_of_face: AnyInt,
    *,
    tolerance_m: float,
    reach_m: float | None = None,
    max_gap_m: float | None = None,
    hide_partly_covered: bool = False,
    threads: int = 1,
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
        [t] usual deviation of base from detail (for example the 99th percentile), metres, > 0.
    reach_m : float, optional
        Distance by which base faces are grown; None for the larger of four tolerances and one cell,
        plus a twentieth.
    max_gap_m : float, optional
        See rule 1; None keeps everything in a column, as the proof requires.
    hide_partly_covered : bool
        True disables rule 3.
    threads : int
        Maximum number of threads; it does not change the result.

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
    # (0) Nothing to cover or to cover with: every list is empty, nothing is ever hidden.
    n_base, n_detail = len(base_faces), len(detail_faces)
    if n_base == 0 or n_detail == 0:
        return BaseCover(
            np.zeros(n_base + 1, np.uint32), np.zeros(0, np.uint32), tolerance_m,
            reach_m or STAND_IN_TOLERANCES * tolerance_m, n_base, 0, 0, n_detail,
        )  # fmt: skip
    base = _contiguous(base_vertices, base_faces)
    detail = _contiguous(detail_vertices, detail_faces)
    segment = as_kernel_input(segment_of_face, np.int32)
    cell_m = max(tolerance_m, median_edge(*detail))
    wanted_m = STAND_IN_TOLERANCES * tolerance_m if reach_m is None else reach_m
    grid = fit_grid([base, detail], cell_m, wanted_m)
    reach = (1.0 + _ROUNDING_SHARE) * max(wanted_m, grid.cell_m) if reach_m is None else reach_m
    # (1) detail columns as runs of (segment, lowest, highest)
    # (2) detail faces that no base face is close to
    runs, far = side_by_side(
        [
            lambda: segment_runs(*rasterise(*detail, grid, 0.0), *detail, segment),
            lambda: far_detail(
                base, detail, segment, grid, reach_m=reach, tolerance_m=tolerance_m, threads=threads
            ),
        ],
        threads=threads,
    )
    # (3) union per base face
    largest_gap_m = np.inf if max_gap_m is None else max_gap_m
    n_segments = int(segment.max()) + 1
    chunks = in_chunks(
        lambda begin, end: _unite(
            *base, grid, reach, runs, largest_gap_m, far.offsets, far.segment, n_segments,
            hide_partly_covered, begin, end,
        ),
        n_base, threads=threads, chunk=_BASE_CHUNK,
    )  # fmt: skip
    rows = np.concatenate([[0], np.cumsum(np.concatenate([chunk[0] for chunk in chunks]))])
    members = np.concatenate([chunk[1] for chunk in chunks])
    status = np.concatenate([chunk[2] for chunk in chunks])
    return BaseCover(
        rows.astype(np.uint32), members.astype(np.uint32), grid.cell_m, reach,
        int(np.count_nonzero(status == _BARE)), int(np.count_nonzero(status == _PARTLY)),
        far.far_faces, far.baseless_faces,
    )  # fmt: skip


def _validate_inputs(
    base_vertices: AnyFloat,
    base_faces: AnyInt,
    detail_vertices: AnyFloat,
    detail_faces: AnyInt,
    segment_of_face: AnyInt,
    tolerance_m: float,
) -> None:
    # (1) Both meshes: shapes, indices, finite coordinates.
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
    # (2) Segments and tolerance.
    if segment_of_face.shape != (len(detail_faces),):
        msg = f"segment_of_face has shape {segment_of_face.shape}, expected ({len(detail_faces)},)"
        raise ValueError(msg)
    if len(segment_of_face) and int(segment_of_face.min()) < 0:
        msg = f"least segment number is {segment_of_face.min()}, expected 0 or more"
        raise ValueError(msg)
    if not 0.0 < tolerance_m < np.inf:
        msg = f"tolerance_m is {tolerance_m}, expected a finite length above 0"
        raise ValueError(msg)


def _contiguous(vertices: AnyFloat, faces: AnyInt) -> tuple[Float64, Int32]:
    return as_kernel_input(vertices, np.float64), as_kernel_input(faces, np.int32)


@numba.njit(cache=True, nogil=True)
def _is_bare(runs: Runs, i: int, j: int, grid: Grid) -> bool:
    """Whether neither this cell nor any around it holds detail."""
    for u in range(max(i - 1, 0), min(i + 2, grid.nx)):
        for v in range(max(j - 1, 0), min(j + 2, grid.nz)):
            if runs.offsets[u * grid.nz + v] < runs.offsets[u * grid.nz + v + 1]:
                return False
    return True


@numba.njit(cache=True, nogil=True)
def _unite(
    vertices: Float64,
    faces: Int32,
    grid: Grid,
    grow: float,
    runs: Runs,
    max_gap: float,
    extra_offsets: Int64,
    extra_segment: Int32,
    n_segments: int,
    hide_partly_covered: bool,
    first: int,
    last: int,
) -> tuple[Int64, Int32, UInt8]:
    """Unite the runs of some base faces' columns; returns their lists and each face's status.

    Lists come one after the other, ascending, with their lengths.

    Parameters
    ----------
    vertices, faces : ndarray
        The base, metres.
    grid : Grid
    grow : float
        How far a base face is grown, metres.
    runs : Runs
        Detail segments in every column.
    max_gap : float
        Rule 1; infinite without one.
    extra_offsets, extra_segment : ndarray
        Rule 2: further segments of every base face, as CSR.
    n_segments : int
    hide_partly_covered : bool
        True leaves rule 3 out.
    first, last : int
        Base faces.
    """
    # Invariant: `members[:begin]` are the lists of faces first..f-1; `seen[s] == f` exactly where
    # segment s stands in the list of face f, which spares clearing it for every face.
    lengths = np.zeros(last - first, np.int64)
    members = np.empty(4 * (last - first) + 16, np.int32)
    status = np.full(last - first, _COVERED, np.uint8)
    seen = np.full(n_segments, -1, np.int64)
    listed = np.empty(n_segments, np.int32)
    cell = grid.cell_m
    half = (0.5 * cell + grow) * (1.0 + 1e-6)
    begin = 0
    for f in range(first, last):
        # (1) Rule 3 at the face's middle: narrow faces may hold no cell's centre.
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        least, most = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        middle_x, middle_z = (a[0] + b[0] + c[0]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
        partly = _is_bare(
            runs, int((middle_x - grid.x) / cell), int((middle_z - grid.z) / cell), grid
        )
        # (2) Rule 1: segments of every column that the grown face touches.
        i0, i1 = cell_span(a[0], b[0], c[0], grid.x, cell, grow)
        j0, j1 = cell_span(a[2], b[2], c[2], grid.z, cell, grow)
        count = 0
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                x, z = grid.x + (i + 0.5) * cell, grid.z + (j + 0.5) * cell
                if not meets_square(a, b, c, x, z, half):
                    continue
                start, end = runs.offsets[i * grid.nz + j], runs.offsets[i * grid.nz + j + 1]
                if start == end:  # rule 3 asks for the cell's centre inside the face itself
                    if not partly and _holds(a, b, c, x, z):
                        partly = _is_bare(runs, i, j, grid)
                    continue
                # With a largest gap, the nearest surface of the column still counts, however far
                # it is: a column with detail never goes unlisted.
                nearest = np.inf
                for e in range(start, end):
                    nearest = min(nearest, max(runs.low[e] - most, least - runs.high[e], 0.0))
                for e in range(start, end):
                    s = runs.segment[e]
                    gap = max(runs.low[e] - most, least - runs.high[e], 0.0)
                    if seen[s] != f and (gap <= max_gap or gap <= nearest):
                        seen[s] = f
                        listed[count] = s
                        count += 1
        # (3) Rule 2: segments of far detail that this face stands in for.
        for e in range(extra_offsets[f], extra_offsets[f + 1]):
            s = extra_segment[e]
            if seen[s] != f:
                seen[s] = f
                listed[count] = s
                count += 1
        # (4) An empty list means "never hidden": for faces without detail and, by rule 3, at
        # rims.
        if count == 0:
            status[f - first] = _BARE
        elif partly and not hide_partly_covered:
            status[f - first] = _PARTLY
            count = 0
        # (5) Append the list in ascending order; the array doubles, so all appends cost linear
        # time.
        if begin + count > len(members):
            larger = np.empty(2 * len(members) + count, np.int32)
            larger[:begin] = members[:begin]
            members = larger
        if count > _INSERTION:
            at = begin
            for s in range(n_segments):
                if seen[s] == f:
                    members[at] = s
                    at += 1
        else:
            for i in range(count):
                j = begin + i
                while j > begin and members[j - 1] > listed[i]:
                    members[j] = members[j - 1]
                    j -= 1
                members[j] = listed[i]
        begin += count
        lengths[f - first] = count
    return lengths, members[:begin].copy(), status


@numba.njit(cache=True, nogil=True)
def _holds(a: Float64, b: Float64, c: Float64, x: float, z: float) -> bool:
    """Whether (x, z) lies in the projection of triangle abc: a square of no size meets it."""
    return (
        min(a[0], b[0], c[0]) <= x <= max(a[0], b[0], c[0])
        and min(a[2], b[2], c[2]) <= z <= max(a[2], b[2], c[2])
        and meets_square(a, b, c, x, z, 0.0)
    )
