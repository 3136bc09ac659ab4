"""Small charts join their neighbours: what a noisy surface would otherwise fall into.

Every chart takes gutters of its own, 256 texels however little it shows. A noisy surface hides half
of itself from every photo, and falls into charts of one face or two: more than an image has room
for, whatever seams cost (Caliterra's base: 43,000 of 200,000 faces; with seams at sixty times the
price 42,900).

Where a mesh has too many charts, those of the fewest faces take the photo of the neighbour with the
longest common border, in rounds of twice as many faces each, until there are few enough. Joined is
what the photo has in its picture: first faces that look at it, then also those that it shows from
behind or that something hides. So small a piece is a step in the noise; what the photo shows there
is the surface beside it, a few texels away. Larger pieces stay.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.photos.lens_kernels import HEIGHT, WIDTH, project_packed

__all__ = ["FACES_PER_CHART", "Joined", "join_small_charts"]

FACES_PER_CHART: Final = 48
"""Faces that a mean chart has at least, or small ones join: as many as let the gutters of a base of
200,000 faces take a quarter of its image. Clean surveys have 200 to 400."""

_ROUNDS: Final = (1, 2, 4, 8, 16, 32)
"""Most faces of the charts that join, round by round."""

_MOST_UNSEEN: Final = 16
"""Faces of the largest chart that joins a photo which does not see it."""


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """The photo of every face, with small charts joined."""

    view: Int32
    """(F,) -1 where there is none."""
    borrowed: Bool
    """(F,) faces that have a neighbour's photo now."""
    charts: int
    """Charts that are left, before those without a photo are cut by their axes."""


def join_small_charts(
    view: Int32,
    vertices: Float32,
    faces: Int32,
    pairs: Int32,
    packed: Float64,
    *,
    max_charts: int,
) -> Joined:
    """Give small charts the photos of their neighbours until there are few enough.

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
    max_charts : int
        Nothing is done up to so many. May not be reached: what no photo has in its picture, and
        pieces of more than 32 faces, stay.

    Returns
    -------
    Joined

    Examples
    --------
    >>> none = np.zeros((0, 2), np.int32)
    >>> row = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    >>> face = np.array([[0, 2, 1]], np.int32)
    >>> join_small_charts(
    ...     np.array([-1], np.int32), row, face, none, np.zeros((0, 30)), max_charts=1
    ... ).charts
    1
    """
    now = view.astype(np.int32, copy=True)
    chart, count = components(len(now), pairs, labels=now + 1)
    for most in _ROUNDS:
        for unseen_too in (False, True):
            if count <= max_charts or (unseen_too and most > _MOST_UNSEEN):
                continue
            rows, wanted = _wishes(now, chart, count, pairs, most)
            shown = _in_picture(packed, vertices, faces, rows, wanted, unseen_too)
            refused = np.zeros(count, np.bool_)
            refused[chart[rows[~shown]]] = True
            taken = ~refused[chart[rows]]
            now[rows[taken]] = wanted[taken]
            chart, count = components(len(now), pairs, labels=now + 1)
    return Joined(now, now != view, count)


def _wishes(view: Int32, chart: Int32, count: int, pairs: Int32, most: int) -> tuple[Int32, Int32]:
    """Faces of small charts, and the photo that each chart would take.

    That of the neighbouring charts with which it has most edges in common, the lower of equal ones.
    A chart with a photo looks at larger neighbours alone (of equal ones the lower), so no two
    charts change places.
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
    order = np.lexsort((views, -edges, charts))
    first = order[np.flatnonzero(np.diff(charts[order], prepend=-1))]
    wanted = np.full(count, -1, np.int32)
    wanted[charts[first]] = views[first]
    rows = np.flatnonzero(wanted[chart] >= 0).astype(np.int32)
    return rows, wanted[chart[rows]]


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
