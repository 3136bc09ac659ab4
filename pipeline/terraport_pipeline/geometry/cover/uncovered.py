"""Faces of one surface that another does not cover, seen from above.

A base that is thinned from the detail draws other borders than the detail has: by less than its hem
as a rule, by more in slivers and thin tongues. Where a vertical line meets detail and no base there
is a hole until the detail is loaded (docs/topics/hand-off.md), so what is not covered has to be
known, not estimated.

The test is exact but for rounding: what is left of a face's projection after every face of the
cover is subtracted from it. Most faces need no subtraction. A square of the plane that some face of
the cover meets, and no outline of it, is covered; outlines are the edges where faces that look up,
or faces that look down, end.

Frame: metres, Y up.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.cover.columns import Grid, cell_span, fit_grid, rasterise
from terraport_pipeline.geometry.cover.far_detail import median_edge
from terraport_pipeline.geometry.mesh.border_edges import border_edges
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["uncovered_faces"]


_REST: Final = 1e-6
"""Share of a face's projected area that may be left: rounding leaves less than a millionth of it
along the edges that were cut."""

_CORNERS: Final = 24
"""Corners of a piece at most: each cut adds one."""

_PIECES: Final = 128
"""Pieces of one face at most. A face that falls into more counts as not covered."""


def uncovered_faces(
    vertices: Float32,
    faces: Int32,
    cover_vertices: Float32,
    cover_faces: Int32,
    *,
    threads: int = 1,
) -> Bool:
    """Find the faces above or below which the cover is missing somewhere.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres, scene frame; finite.
    faces : ndarray of shape (F, 3), int32
    cover_vertices : ndarray of shape (W, 3), float
        The same frame; finite.
    cover_faces : ndarray of shape (B, 3), int32
        Wound consistently.
    threads : int
        They change nothing but the time.

    Returns
    -------
    ndarray of shape (F,), bool
        True where a vertical line through the face meets no face of the cover. False for a face
        without area seen from above: what stands beside it decides.

    Notes
    -----
    Linear in the cells touched; 8 bytes per cell, a cell being half an edge of the cover wide.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2]], np.float32)
    >>> two = np.array([[0, 2, 1], [0, 3, 2]], np.int32)
    >>> uncovered_faces(square, two, square + np.float32([0, 5, 0]), two).tolist()
    [False, False]
    >>> uncovered_faces(square, two, square, two[:1]).tolist()
    [False, True]
    """
    if len(cover_faces) == 0 or len(faces) == 0:
        return np.full(len(faces), len(faces) > 0, dtype=np.bool_)
    cover = (
        as_kernel_input(cover_vertices, np.float64),
        as_kernel_input(cover_faces, np.int32),
    )
    surface = (as_kernel_input(vertices, np.float64), as_kernel_input(faces, np.int32))
    grid = fit_grid([cover, surface], 0.5 * median_edge(*cover), 0.0)
    starts, entries = rasterise(*cover, grid, 0.0)
    covered = np.diff(starts) > 0
    outlines = as_kernel_input(_outlines(*cover), np.int32)
    outline_starts, _ = rasterise(cover[0], outlines, grid, 0.0)
    covered &= np.diff(outline_starts) == 0
    plan = _plan_of(*cover)
    uncovered = np.zeros(len(faces), dtype=np.bool_)
    in_chunks(
        lambda begin, end: _find(
            *surface, plan, grid, starts, entries, covered, uncovered, begin, end
        ),
        len(faces),
        threads=threads,
    )
    return uncovered


def _plan_of(vertices: Float64, faces: Int32) -> Float64:
    """Corners of every face seen from above, turning one way: (F, 6) x, z, x, z, x, z."""
    plan = vertices[faces][:, :, ::2].reshape(-1, 6)
    turn = (plan[:, 2] - plan[:, 0]) * (plan[:, 5] - plan[:, 1]) - (plan[:, 3] - plan[:, 1]) * (
        plan[:, 4] - plan[:, 0]
    )
    plan[turn < 0] = plan[turn < 0][:, [0, 1, 4, 5, 2, 3]]
    return plan


def _outlines(vertices: Float64, faces: Int32) -> Int32:
    """Edges where the faces that look up end, or those that look down, as faces (a, b, b)."""
    a, b, c = (vertices[faces[:, corner]][:, ::2] for corner in range(3))
    along, across = b - a, c - a
    turn = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    edges = np.concatenate(
        [border_edges(faces[side], len(vertices)) for side in (turn > 0, turn < 0)]
    )
    return edges[:, [0, 1, 1]]


@numba.njit(cache=True, nogil=True)
def _find(
    vertices: Float64,
    faces: Int32,
    plan: Float64,
    grid: Grid,
    starts: Int64,
    entries: Int32,
    covered: Bool,
    uncovered: Bool,
    begin: int,
    end: int,
) -> None:
    """Judge some faces.

    (1) All cells that the face's box meets are covered, or one face of the cover holds all of it:
    it is covered. (2) Else every face of the cover in these cells is subtracted from it, from one
    list of pieces into the other. Invariant: the pieces are convex, do not overlap, and together
    are the face without what was subtracted.

    Parameters
    ----------
    vertices, faces : ndarray
        The surface to judge, metres.
    plan : ndarray of shape (G, 6), float64
        Corners x, z of every face of the cover.
    grid, starts, entries
        Faces of the cover in every cell, as CSR.
    covered : ndarray of shape (cells,), bool
        Cells that the cover holds whole.
    uncovered : ndarray of shape (F,), bool
        Written in begin..end.
    begin, end : int
        Faces.
    """
    pieces = np.empty((2, _PIECES, _CORNERS, 2))
    sizes = np.zeros((2, _PIECES), np.int64)
    scratch = np.empty((2, _CORNERS, 2))
    for f in range(begin, end):
        # (1) Cells under the face's box: all covered, or one face of the cover around all of it.
        u, v, w = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, bx, cx = vertices[u, 0], vertices[v, 0], vertices[w, 0]
        az, bz, cz = vertices[u, 2], vertices[v, 2], vertices[w, 2]
        i0, i1 = cell_span(ax, bx, cx, grid.x, grid.cell_m, 0.0)
        j0, j1 = cell_span(az, bz, cz, grid.z, grid.cell_m, 0.0)
        safe = True
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                safe = safe and covered[i * grid.nz + j]
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                cell = i * grid.nz + j
                for e in range(starts[cell], starts[cell + 1]):
                    if safe:
                        break
                    g = entries[e]
                    safe = (
                        _is_within(plan, g, ax, az)
                        and _is_within(plan, g, bx, bz)
                        and _is_within(plan, g, cx, cz)
                    )
        if safe:
            continue
        # (2) Subtract the cover, face by face. `now` is the list that holds what is left.
        pieces[0, 0, 0, 0], pieces[0, 0, 0, 1] = ax, az
        pieces[0, 0, 1, 0], pieces[0, 0, 1, 1] = bx, bz
        pieces[0, 0, 2, 0], pieces[0, 0, 2, 1] = cx, cz
        sizes[0, 0] = 3
        least = _REST * _area(pieces[0, 0], sizes[0, 0])
        count, now = int(least > 0.0), 0
        low_x, low_z = min(ax, bx, cx), min(az, bz, cz)
        high_x, high_z = max(ax, bx, cx), max(az, bz, cz)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                cell = i * grid.nz + j
                for e in range(starts[cell], starts[cell + 1]):
                    if count == 0 or count > _PIECES:
                        break
                    g = entries[e]
                    if (
                        max(plan[g, 0], plan[g, 2], plan[g, 4]) <= low_x
                        or min(plan[g, 0], plan[g, 2], plan[g, 4]) >= high_x
                        or max(plan[g, 1], plan[g, 3], plan[g, 5]) <= low_z
                        or min(plan[g, 1], plan[g, 3], plan[g, 5]) >= high_z
                    ):
                        continue
                    count = _subtract(
                        pieces[now], sizes[now], count, pieces[1 - now], sizes[1 - now], scratch,
                        plan, g, least,
                    )  # fmt: skip
                    now = 1 - now
        uncovered[f] = count > 0


@numba.njit(cache=True, nogil=True)
def _subtract(
    pieces: Float64,
    sizes: Int64,
    count: int,
    left: Float64,
    left_sizes: Int64,
    scratch: Float64,
    plan: Float64,
    g: int,
    least: float,
) -> int:
    """Take face g of the cover out of every piece; returns how many are left, or _PIECES + 1.

    A piece is cut along the line of each edge in turn: what lies outside is left as a piece of its
    own, what lies inside all three goes. Pieces of at most `least` square metres go too.

    Parameters
    ----------
    pieces, sizes : ndarray of shape (_PIECES, _CORNERS, 2), (_PIECES,)
        Convex polygons seen from above, and their corners; the first `count` are there.
    count : int
    left, left_sizes : ndarray
        Written: what is left, likewise.
    scratch : ndarray of shape (2, _CORNERS, 2), float64
        Overwritten.
    plan : ndarray of shape (G, 6), float64
        Corners x, z of every face of the cover.
    g : int
        The face to subtract.
    least : float
        Area below which a piece counts as covered.
    """
    result = 0
    for piece in range(count):
        # (1) A piece that does not meet g stays as it is.
        size = sizes[piece]
        # Corner by corner: assigning slices takes numba two seconds to compile.
        for k in range(size):
            scratch[0, k, 0], scratch[0, k, 1] = pieces[piece, k, 0], pieces[piece, k, 1]
        source = 0
        apart = _is_apart(pieces[piece], size, plan, g)
        # (2) Cut along g's edges. Invariant: `scratch[source]` is what of the piece lies inside
        # the edges done so far; what lay outside is in left[:result], and both together are the
        # piece.
        for corner in range(3):
            if apart or size < 3:
                break
            if result == _PIECES or size + 1 >= _CORNERS:
                return _PIECES + 1
            outside = _clip(scratch[source], size, plan, g, corner, -1.0, left[result])
            if outside >= 3 and _area(left[result], outside) > least:
                left_sizes[result] = outside
                result += 1
            size = _clip(scratch[source], size, plan, g, corner, 1.0, scratch[1 - source])
            source = 1 - source
        if apart:
            if result == _PIECES:
                return _PIECES + 1
            for k in range(size):
                left[result, k, 0], left[result, k, 1] = pieces[piece, k, 0], pieces[piece, k, 1]
            left_sizes[result] = size
            result += 1
    return result


@numba.njit(cache=True, nogil=True)
def _is_within(plan: Float64, g: int, x: float, z: float) -> bool:
    """Whether face g holds a point in its inside."""
    within = True
    for corner in range(3):
        within = within and _side(plan, g, corner, x, z) > 0.0
    return within


@numba.njit(cache=True, nogil=True)
def _is_apart(corners: Float64, size: int, plan: Float64, g: int) -> bool:
    """Whether one edge of face g has the whole polygon on its outer side: nothing to cut.

    So has an edge of a face without area: every polygon is apart from that, or falls in two.
    """
    for corner in range(3):
        beyond = True
        for k in range(size):
            beyond = beyond and _side(plan, g, corner, corners[k, 0], corners[k, 1]) <= 0.0
        if beyond:
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _clip(
    corners: Float64, size: int, plan: Float64, g: int, corner: int, sign: float, out: Float64
) -> int:
    """Part of a convex polygon on one side of an edge's line (Sutherland and Hodgman 1974)."""
    count = 0
    for k in range(size):
        after = k + 1 if k + 1 < size else 0
        here = sign * _side(plan, g, corner, corners[k, 0], corners[k, 1])
        there = sign * _side(plan, g, corner, corners[after, 0], corners[after, 1])
        if here >= 0.0:
            out[count, 0], out[count, 1] = corners[k, 0], corners[k, 1]
            count += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            for axis in range(2):
                out[count, axis] = corners[k, axis] + share * (
                    corners[after, axis] - corners[k, axis]
                )
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _side(plan: Float64, g: int, corner: int, x: float, z: float) -> float:
    """Twice the area of an edge of face g and a point; above 0 on the face's side."""
    start, stop = 2 * corner, 2 * corner + 2 if corner < 2 else 0
    along_x, along_z = plan[g, stop] - plan[g, start], plan[g, stop + 1] - plan[g, start + 1]
    side: float = along_x * (z - plan[g, start + 1]) - along_z * (x - plan[g, start])
    return side


@numba.njit(cache=True, nogil=True)
def _area(corners: Float64, size: int) -> float:
    """Area of a convex polygon of so many corners, whichever way it turns."""
    twice = 0.0
    for k in range(1, size - 1):
        twice += (corners[k, 0] - corners[0, 0]) * (corners[k + 1, 1] - corners[0, 1]) - (
            corners[k, 1] - corners[0, 1]
        ) * (corners[k + 1, 0] - corners[0, 0])
    return abs(0.5 * twice)
