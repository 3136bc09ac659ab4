"""A grid of vertical columns, and which faces stand in each.

Frame: metres, Y up. A column is a square cell of the horizontal plane with all points above and
below it. Rasterising is conservative: a face is entered in every column that it meets, by an exact
test of triangle against square (separating axes), with the square grown by a millionth so that
rounding loses none.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["Grid", "Runs", "cell_span", "fit_grid", "meets_square", "rasterise", "segment_runs"]


_MAX_CELLS: Final = 2**24
"""Cells of a grid at most (128 MiB of offsets); beyond it cells grow."""
_SLACK: Final = 1e-6
"""Share of a cell by which squares are enlarged against rounding."""


class Grid(NamedTuple):
    """Square cells over the horizontal plane; cell (i, j) has the number ``i * nz + j``."""

    x: float
    """Least x, metres."""
    z: float
    """Least z, metres."""
    cell_m: float
    """Side of a cell, metres."""
    nx: int
    """Cells along x."""
    nz: int
    """Cells along z."""


class Runs(NamedTuple):
    """Per column one run for each segment in it, as CSR over cells."""

    offsets: Int64
    """(cells + 1,) row starts."""
    segment: Int32
    """(R,) segment numbers, each once per column."""
    low: Float32
    """(R,) least height of the segment's faces that meet the column (of the whole faces),
    metres."""
    high: Float32
    """(R,) greatest height likewise."""


def fit_grid(meshes: list[tuple[Float64, Int32]], cell_m: float, margin_m: float) -> Grid:
    """Lay a grid over the faces of all meshes.

    Parameters
    ----------
    meshes : list of (vertices, faces)
        Float64 (V, 3) in metres and int32 (F, 3); at least one face in all.
    cell_m : float
        Wanted side of a cell; it grows by quarters until the grid has at most 2^24 cells.
    margin_m : float
        Room left around the faces, on top of two cells.

    Returns
    -------
    Grid
    """
    # of the faces' corners only: a stray vertex of no face must not widen the grid
    boxes = np.stack([_plan_box(vertices, faces) for vertices, faces in meshes])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    while True:
        margin = max(margin_m, cell_m) + 2.0 * cell_m
        n = np.floor((high - low + 2.0 * margin) / cell_m) + 1
        if n[0] * n[1] <= _MAX_CELLS:
            x, z = float(low[0] - margin), float(low[1] - margin)
            return Grid(x, z, cell_m, int(n[0]), int(n[1]))
        cell_m *= 1.25


@numba.njit(cache=True, nogil=True)
def _plan_box(vertices: Float64, faces: Int32) -> Float64:
    """Least x and z and greatest x and z of all corners."""
    box = np.array([np.inf, np.inf, -np.inf, -np.inf])
    for f in range(len(faces)):
        for corner in range(3):
            v = faces[f, corner]
            x, z = vertices[v, 0], vertices[v, 2]
            box[0], box[1] = min(box[0], x), min(box[1], z)
            box[2], box[3] = max(box[2], x), max(box[3], z)
    return box


@numba.njit(cache=True, nogil=True)
def cell_span(
    a: float, b: float, c: float, start: float, cell: float, grow: float
) -> tuple[int, int]:
    """First and last cell along one axis that three coordinates, grown, can meet."""
    edge = grow + _SLACK * cell
    return int((min(a, b, c) - edge - start) / cell), int((max(a, b, c) + edge - start) / cell)


@numba.njit(cache=True, nogil=True)
def meets_square(a: Float64, b: Float64, c: Float64, x: float, z: float, half: float) -> bool:
    """Whether the projection of triangle abc meets the square about (x, z) with this half side.

    The caller has found already that their boxes meet; this tests the triangle's three edges.
    """
    for _ in range(3):
        nx, nz = a[2] - b[2], b[0] - a[0]
        radius = half * (abs(nx) + abs(nz))
        centre = nx * (x - a[0]) + nz * (z - a[2])
        apex = nx * (c[0] - a[0]) + nz * (c[2] - a[2])
        if centre - radius > max(apex, 0.0) or centre + radius < min(apex, 0.0):
            return False
        a, b, c = b, c, a
    return True


@numba.njit(cache=True, nogil=True)
def rasterise(vertices: Float64, faces: Int32, grid: Grid, grow: float) -> tuple[Int64, Int32]:
    """Faces in every column.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float64
        Metres, inside the grid by at least ``grow``.
    faces : ndarray of shape (F, 3), int32
        Vertex indices.
    grid : Grid
        The columns.
    grow : float
        Metres by which a column's square is grown on each side: neighbours within it count.

    Returns
    -------
    starts : ndarray of shape (cells + 1,), int64
        CSR row starts.
    entries : ndarray of shape (N,), int32
        Face numbers, descending within a column.
    """
    # Invariant of the second pass: entries from starts[cell] to the row's end are written; at
    # last `starts` has moved down to where each row begins, and rows run from high to low faces.
    starts = np.zeros(grid.nx * grid.nz + 1, np.int64)
    entries = np.empty(0, np.int32)
    half = (0.5 * grid.cell_m + grow) * (1.0 + _SLACK)
    for fill in range(2):  # count, then write backwards from each row's end
        for f in range(len(faces)):
            a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
            i0, i1 = cell_span(a[0], b[0], c[0], grid.x, grid.cell_m, grow)
            j0, j1 = cell_span(a[2], b[2], c[2], grid.z, grid.cell_m, grow)
            in_line = i0 == i1 or j0 == j1  # then it meets every cell that its box meets
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    x, z = grid.x + (i + 0.5) * grid.cell_m, grid.z + (j + 0.5) * grid.cell_m
                    if in_line or meets_square(a, b, c, x, z, half):
                        cell = i * grid.nz + j
                        if fill == 0:
                            starts[cell] += 1
                        else:
                            starts[cell] -= 1
                            entries[starts[cell]] = f
        if fill == 0:
            total = 0
            for cell in range(len(starts)):
                total += starts[cell]
                starts[cell] = total
            entries = np.empty(total, np.int32)
    return starts, entries


def segment_runs(
    starts: Int64, entries: Int32, vertices: Float64, faces: Int32, segment_of_face: Int32
) -> Runs:
    """Reduce the faces of every column to one run per segment.

    Parameters
    ----------
    starts, entries
        Result of :func:`rasterise`.
    vertices, faces
        The mesh that was rasterised.
    segment_of_face : ndarray of shape (F,), int32
        Segment of every face, >= 0.

    Returns
    -------
    Runs
    """
    segments = int(segment_of_face.max()) + 1
    return Runs(*_runs(starts, entries, vertices, faces, segment_of_face, segments))


@numba.njit(cache=True, nogil=True)
def _runs(
    starts: Int64,
    entries: Int32,
    vertices: Float64,
    faces: Int32,
    segment_of_face: Int32,
    segments: int,
) -> tuple[Int64, Int32, Float32, Float32]:
    # Invariant: `last[s] >= begin` exactly if segment s has a run in the column at hand, so
    # nothing is cleared between columns.
    offsets = np.zeros(len(starts), np.int64)
    last = np.empty(segments, np.int64)  # the segment's latest run
    segment = np.empty(0, np.int32)
    low = np.empty(0, np.float32)
    high = np.empty(0, np.float32)
    for fill in range(2):
        last[:] = -1
        total = 0
        for q in range(len(starts) - 1):
            begin = total
            for e in range(starts[q], starts[q + 1]):
                f = entries[e]
                s = segment_of_face[f]
                if last[s] < begin:
                    last[s] = total
                    total += 1
                    if fill == 1:
                        segment[last[s]] = s
                if fill == 1:
                    for corner in range(3):
                        height = np.float32(vertices[faces[f, corner], 1])
                        low[last[s]] = min(low[last[s]], height)
                        high[last[s]] = max(high[last[s]], height)
            offsets[q + 1] = total
        if fill == 0:
            segment = np.empty(total, np.int32)
            low, high = np.empty(total, np.float32), np.empty(total, np.float32)
            low[:], high[:] = np.inf, -np.inf
    return offsets, segment, low, high
