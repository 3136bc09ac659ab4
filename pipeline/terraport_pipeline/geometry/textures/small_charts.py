"""Small charts join their neighbours: what a noisy surface would otherwise fall into.

Every chart takes gutters of its own, 256 texels however little it shows, and has a seam all around.
A noisy surface hides half of itself from every photo, and falls into charts of one face or two,
whatever seams cost (Caliterra's base: 43,000 of 200,000 faces; with seams at sixty times the price
42,900). On any surface segments cut charts into slivers, and photos that were dropped for a cell
leave crumbs of another photo. So:

1. Charts of fewer than 128 faces take the photo of a neighbour that shows them nearly as well.
1. Charts of up to 32 faces take that of the neighbour with the longest common border, if they look
   at it; charts of up to 16 also if it shows them from behind, or something hides them, but has
   them in its picture. So small a piece is a step in the noise, or the rim of something; what the
   photo shows there is the surface beside it, a few texels away. Larger pieces stay.

Both go in rounds of twice as many faces each.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int16, Int32, Int64, UInt16
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH, project_packed

__all__ = ["LEAST_FACES", "join_seen_charts", "join_small_charts"]

LEAST_FACES: Final = 128
"""Charts of fewer faces join a neighbour whose photo sees them: gutters of a chart of 128 faces
take about as many texels as its faces."""

_SEEN_SHARE: Final = 0.75
"""Part of a chart's faces that such a photo sees at least; the rest lies in its picture."""

_MOST_COST: Final = 0.6
"""Mean cost of such a photo at most: two fifths of the best quality."""

_ROUNDS: Final = (1, 2, 4, 8, 16, 32)
"""Most faces of the charts that join, round by round."""

_MOST_UNSEEN: Final = 16
"""Faces of the largest chart that joins a photo which does not see it."""


def join_small_charts(
    view: Int32,
    vertices: Float32,
    faces: Int32,
    pairs: Int32,
    packed: Float64,
) -> Int32:
    """Give charts of a few faces the photos of their neighbours.

    Parameters
    ----------
    view : ndarray of shape (F,), int32
        Photo of every face, -1 for none.
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    pairs : ndarray of shape (P, 2), int32
        Neighbouring faces.
    packed : ndarray of shape (views, PACKED), float64
        From ``View.packed``.

    Returns
    -------
    ndarray of shape (F,), int32
        Photo of every face. What no photo has in its picture, and larger pieces, are as they were.

    Examples
    --------
    >>> none = np.zeros((0, 2), np.int32)
    >>> row = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    >>> face = np.array([[0, 2, 1]], np.int32)
    >>> join_small_charts(np.array([-1], np.int32), row, face, none, np.zeros((0, 30))).tolist()
    [-1]
    """
    now = view.astype(np.int32, copy=True)
    chart, count = components(len(now), pairs, labels=now + 1)
    for most in _ROUNDS:
        for unseen_too in (False, True):
            if most > _MOST_UNSEEN and unseen_too:
                continue
            rows, wanted = _wishes(now, chart, count, pairs, most)
            shown = _in_picture(packed, vertices, faces, rows, wanted, unseen_too)
            refused = np.zeros(count, np.bool_)
            refused[chart[rows[~shown]]] = True
            taken = ~refused[chart[rows]]
            now[rows[taken]] = wanted[taken]
            chart, count = components(len(now), pairs, labels=now + 1)
    return now


def join_seen_charts(
    view: Int32,
    candidate_view: Int16,
    costs: UInt16,
    vertices: Float32,
    faces: Int32,
    pairs: Int32,
    packed: Float64,
    *,
    least_faces: int = LEAST_FACES,
) -> Int32:
    """Give small charts the photo of a neighbour that shows them nearly as well.

    Parameters
    ----------
    view, vertices, faces, pairs, packed
        As for :func:`join_small_charts`.
    candidate_view, costs : ndarray of shape (F, SLOTS)
        Photos that see each face, and what each costs: from
        :func:`terraport_pipeline.geometry.photos.view_labels.view_costs`.
    least_faces : int
        Charts of fewer faces join.

    Returns
    -------
    ndarray of shape (F,), int32
        Photo of every face.
    """
    now = view.astype(np.int32, copy=True)
    most = 1
    while most < least_faces:
        # (1) Small charts with a photo, and the photos of their neighbours.
        chart, count = components(len(now), pairs, labels=now + 1)
        with_photo = np.zeros(count, np.bool_)
        with_photo[chart[now >= 0]] = True
        charts, views, edges = _borders(now, chart, count, pairs, most)
        kept = with_photo[charts]
        charts, views, edges = charts[kept], views[kept], edges[kept]
        # (2) Faces of those charts, sorted by chart.
        small = np.zeros(count, np.bool_)
        small[charts] = True
        rows = np.flatnonzero(small[chart]).astype(np.int32)
        rows = rows[np.argsort(chart[rows], kind="stable")]
        starts = np.searchsorted(chart[rows], charts)
        ends = np.searchsorted(chart[rows], charts, side="right")
        # (3) Of the photos that show a chart well, that of the longest border.
        shown = _shown_well(
            packed, vertices, faces, candidate_view, costs, rows, starts, ends, views
        )
        wanted = _best_borders(charts[shown], views[shown], edges[shown], count)
        taken = wanted[chart] >= 0
        now[taken] = wanted[chart[taken]]
        most = least_faces if most == least_faces - 1 else min(2 * most, least_faces - 1)
    return now


def _wishes(view: Int32, chart: Int32, count: int, pairs: Int32, most: int) -> tuple[Int32, Int32]:
    """Faces of small charts, and the photo that each chart would take."""
    wanted = _best_borders(*_borders(view, chart, count, pairs, most), count)
    rows = np.flatnonzero(wanted[chart] >= 0).astype(np.int32)
    return rows, wanted[chart[rows]]


def _borders(
    view: Int32, chart: Int32, count: int, pairs: Int32, most: int
) -> tuple[Int64, Int64, Int64]:
    """Small charts, the photos of their neighbours, and how many edges they share with those.

    A chart with a photo looks at larger neighbours alone (of equal ones the lower), so no two
    charts change places. Sorted by chart, then by photo.
    """
    size = np.bincount(chart, minlength=count)
    of_chart = np.empty(count, np.int32)
    of_chart[chart] = view
    sides = chart[pairs]
    sides = sides[sides[:, 0] != sides[:, 1]]
    sides = np.concatenate([sides, sides[:, ::-1]])
    own, other = sides[:, 0], sides[:, 1]
    larger = (size[other] > size[own]) | ((size[other] == size[own]) & (other < own))
    joins = (size[own] <= most) & (of_chart[other] >= 0) & (larger | (of_chart[own] < 0))
    n_views = int(of_chart.max(initial=0)) + 1
    keys = own[joins].astype(np.int64) * n_views + of_chart[other[joins]]
    unique, edges = np.unique(keys, return_counts=True)
    charts, views = np.divmod(unique, n_views)
    return charts, views, edges.astype(np.int64)


def _best_borders(charts: Int64, views: Int64, edges: Int64, count: int) -> Int32:
    """Photo of the longest border of each chart, the lower of equal ones; -1 without any."""
    order = np.lexsort((views, -edges, charts))
    first = order[np.flatnonzero(np.diff(charts[order], prepend=-1))]
    wanted = np.full(count, -1, np.int32)
    wanted[charts[first]] = views[first]
    return wanted


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _shown_well(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    candidate_view: Int16,
    costs: UInt16,
    rows: Int32,
    starts: Int64,
    ends: Int64,
    views: Int64,
) -> Bool:
    """Whether photos show whole charts: nearly all faces seen, at little loss, none cut off.

    Parameters
    ----------
    packed, vertices, faces, candidate_view, costs
        As for :func:`join_seen_charts`.
    rows : ndarray of shape (R,), int32
        Faces, sorted by chart.
    starts, ends : ndarray of shape (N,), int64
        Where the faces of each chart asked for begin and end in `rows`.
    views : ndarray of shape (N,), int64
        Photo asked for.
    """
    shown = np.zeros(len(views), np.bool_)
    for n in range(len(views)):
        seen, cost, inside = 0, 0.0, True
        for i in range(starts[n], ends[n]):
            f = rows[i]
            at = -1
            for s in range(candidate_view.shape[1]):
                if candidate_view[f, s] == views[n]:
                    at = s
            if at >= 0:
                seen += 1
                cost += costs[f, at] / 65535.0
                continue
            for c in range(3):
                p = faces[f, c]
                x, y, _ = project_packed(
                    packed[views[n]],
                    np.float64(vertices[p, 0]), np.float64(vertices[p, 1]),
                    np.float64(vertices[p, 2]),
                )  # fmt: skip
                # Written so that NaN is outside.
                if not (
                    0.0 <= x <= packed[views[n], WIDTH] and 0.0 <= y <= packed[views[n], HEIGHT]
                ):
                    inside = False
        size = ends[n] - starts[n]
        shown[n] = inside and seen >= _SEEN_SHARE * size and cost <= _MOST_COST * seen
    return shown


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _in_picture(
    packed: Float64,
    vertices: Float32,
    faces: Int32,
    rows: Int32,
    view: Int32,
    unseen_too: bool,
) -> Bool:
    """Whether faces lie whole in pictures, and unless `unseen_too` look at the camera."""
    inside = np.zeros(len(rows), np.bool_)
    pixel = np.zeros((3, 2))
    for n in range(len(rows)):
        row = packed[view[n]]
        good = True
        for c in range(3):
            p = faces[rows[n], c]
            x, y, _ = project_packed(
                row,
                np.float64(vertices[p, 0]), np.float64(vertices[p, 1]), np.float64(vertices[p, 2]),
            )  # fmt: skip
            # Written so that NaN is outside.
            if not (0.0 <= x <= row[WIDTH] and 0.0 <= y <= row[HEIGHT]):
                good = False
                break
            pixel[c, 0], pixel[c, 1] = x, y
        if good and not unseen_too:
            ax, ay = pixel[1, 0] - pixel[0, 0], pixel[1, 1] - pixel[0, 1]
            bx, by = pixel[2, 0] - pixel[0, 0], pixel[2, 1] - pixel[0, 1]
            good = ax * by - ay * bx < 0.0  # v points down
        inside[n] = good
    return inside
