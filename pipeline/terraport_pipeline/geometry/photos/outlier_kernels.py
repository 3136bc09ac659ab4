"""Kernels of :mod:`terraport_pipeline.geometry.photos.view_outliers`, which states the model.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int16, Int32, Int64, UInt8, UInt16
from terraport_pipeline.geometry.photos.view_kernels import QUALITY_STEPS, SLOTS, index_of_view

__all__ = ["MAX_VIEWS", "drop", "rate"]

MAX_VIEWS: Final = 16
"""Views looked at per cell; further ones stay."""

_SIGMA: Final = 10.0
"""Spread of views that agree, levels (root mean square over the channels): noise, angles, what the
gains leave."""

_FAR: Final = 30.0
"""Views farther from the mode than this are dropped, levels: a car or a shadow differs by 40 to
100."""

_FAR_ALONE: Final = 60.0
"""The same where a single view stands against the cloud."""

_NEIGHBOUR: Final = 0.4
"""Part of that limit which counts where the view is dropped in a neighbouring cell."""

_HALVED: Final = 0.5
"""Part of that limit at which a view that stays counts half its quality."""

_CLOUD_VOTE: Final = 1.5
"""Votes of the cloud's colour: more than one view, less than two that agree."""

_SHIFTS: Final = 4
"""Steps of mean shift; it converges to a tenth of a level."""

_USUAL_GRAIN: Final = 6.0
"""Grain that is held against no view, levels: the photos' noise, and what a cloud averages away."""

_GRAIN_WEIGHT: Final = 2.0
"""Square levels of distance for a square level of grain."""

_GRAIN_FACES: Final = 8
"""Faces from which a view's grain is judged."""


@numba.njit(cache=True, nogil=True)
def rate(
    views: Int16,
    colours: UInt8,
    own: UInt8,
    order: Int32,
    starts: Int64,
    cell_views: Int16,
    far: Float32,
    begin: int,
    end: int,
) -> None:
    """Find how far each view of the cells begin..end is from the rest, over the limit.

    Parameters
    ----------
    views, colours : ndarray of shape (F, SLOTS), (F, SLOTS, 3)
        Candidates of every face, and its colour in each.
    own : ndarray of shape (F, 3), uint8
        Colours of the cloud; (0, 3) where it has none.
    order, starts : ndarray
        Faces sorted by cell, and where each cell's begin.
    cell_views : ndarray of shape (C, MAX_VIEWS), int16
        Written: the views of every cell, -1 after the last.
    far : ndarray of shape (C, MAX_VIEWS), float32
        Written: distance of each over the limit; above 1 it is out.
    begin, end : int
        Cells.
    """
    seen = np.empty(MAX_VIEWS, np.int64)
    faces = np.empty(MAX_VIEWS)
    mean = np.empty((MAX_VIEWS + 1, 3))
    grain = np.empty(MAX_VIEWS)
    vote = np.empty(MAX_VIEWS + 1)
    for cell in range(begin, end):
        # (1) Mean colours of the cell by view, and a vote for each by the faces that it sees.
        first, last = starts[cell], starts[cell + 1]
        n = _means(views, colours, own, order, first, last, seen, faces, mean, grain)
        for row in range(n):
            cell_views[cell, row] = seen[row]
            vote[row] = faces[row] / (last - first)  # a view of half the cell: half a vote
        # (2) The cloud's own colour is one more voter, once each view's means are brought to its
        # light.
        count = n
        usual = 0.0
        if len(own):
            usual = _take_off_means(mean, grain, faces, n)
            vote[n] = _CLOUD_VOTE
            count += 1
        if n == 0 or count < 2 or (count == 2 and not len(own)):  # two views: nobody decides
            continue
        # (3) Distance of every view from where most votes are, over the limit; above 1 it is out.
        mode = _mode(mean, vote, count)
        limit = _FAR_ALONE if n == 1 else _FAR
        for row in range(n):
            square = _square_distance(mode, mean[row])
            if len(own) and faces[row] >= _GRAIN_FACES:
                square += _GRAIN_WEIGHT * max(grain[row] - usual, 0.0) ** 2
            far[cell, row] = np.sqrt(square) / limit


@numba.njit(cache=True, nogil=True)
def drop(
    views: Int16,
    qualities: UInt16,
    colours: UInt8,
    order: Int32,
    starts: Int64,
    around: Int32,
    cell_views: Int16,
    far: Float32,
    begin: int,
    end: int,
) -> int:
    """Drop views of the cells begin..end; returns the pairs of face and view dropped.

    Parameters
    ----------
    views, qualities, colours : ndarray of shape (F, SLOTS), (F, SLOTS), (F, SLOTS, 3)
        Candidates; written, in the cells' own faces only.
    order, starts, cell_views, far
        As :func:`rate` left them.
    around : ndarray of shape (C, 27), int32
        Neighbouring cells of every cell, -1 none.
    begin, end : int
        Cells.
    """
    dropped = 0
    out = np.empty(MAX_VIEWS, np.bool_)
    less = np.empty(MAX_VIEWS, np.int64)
    for cell in range(begin, end):
        # (1) The verdict on every view of the cell: out where it is far itself, or fairly far and
        # out next door; what stays loses quality by how far it is.
        n = 0
        while n < MAX_VIEWS and cell_views[cell, n] >= 0:
            share = far[cell, n]
            out[n] = share > 1.0 or (
                share > _NEIGHBOUR
                and _far_around(cell_views, far, around[cell], cell_views[cell, n])
            )
            less[n] = int(QUALITY_STEPS * (share / _HALVED) ** 2)
            n += 1
        # (2) Take those views out of the cell's faces. Invariant: slots 0..kept-1 hold the views
        # that stay, in their order, so views stay sorted.
        for i in range(starts[cell], starts[cell + 1]):
            f = order[i]
            kept = 0
            for s in range(SLOTS):
                if views[f, s] < 0:
                    break
                row = 0
                while row < n and cell_views[cell, row] != views[f, s]:
                    row += 1
                if row < n and out[row]:
                    dropped += 1
                    continue
                minus = less[row] if row < n else 0
                qualities[f, kept] = max(int(qualities[f, s]) - minus, 1)
                if kept != s:
                    views[f, kept] = views[f, s]
                    for k in range(3):
                        colours[f, kept, k] = colours[f, s, k]
                kept += 1
            for s in range(kept, SLOTS):
                views[f, s] = -1
                qualities[f, s] = 0
    return dropped


@numba.njit(cache=True, nogil=True)
def _far_around(cell_views: Int16, far: Float32, around: Int32, view: int) -> bool:
    """Whether a view is dropped in one of the cells around."""
    for other in around:
        if other < 0:
            continue
        for row in range(MAX_VIEWS):
            if cell_views[other, row] < 0:
                break
            if cell_views[other, row] == view:
                if far[other, row] > 1.0:
                    return True
                break
    return False


@numba.njit(cache=True, nogil=True)
def _square_distance(a: Float64, b: Float64) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    square: float = (x * x + y * y + z * z) / 3.0
    return square


@numba.njit(cache=True, nogil=True)
def _means(
    views: Int16,
    colours: UInt8,
    own: UInt8,
    order: Int32,
    first: int,
    last: int,
    seen: Int64,
    faces: Float64,
    mean: Float64,
    grain: Float64,
) -> int:
    """Mean colour of a cell in each of its n views, and of the cloud in row n; returns n.

    Parameters
    ----------
    views, colours, own, order
        As for :func:`rate`.
    first, last : int
        The cell's faces in `order`.
    seen, faces, mean, grain : ndarray
        Written, a row a view: its number, its faces, their mean colour, and the mean square of what
        they differ from the cloud's.
    """
    # (1) Sums over the cell's faces. Invariant: seen[:n] are the views met so far, each once;
    # faces, mean and grain have one row for each. Views beyond MAX_VIEWS are left out.
    n = 0
    mean[:] = 0.0
    grain[:] = 0.0
    faces[:] = 0.0
    for i in range(first, last):
        f = order[i]
        for s in range(SLOTS):
            if views[f, s] < 0:
                break
            row = index_of_view(seen, n, views[f, s])
            if row == n:
                if n == MAX_VIEWS:
                    continue
                seen[n] = views[f, s]
                n += 1
            faces[row] += 1.0
            for k in range(3):
                mean[row, k] += colours[f, s, k]
                if len(own):
                    grain[row] += (np.float64(colours[f, s, k]) - own[f, k]) ** 2 / 3.0
    # (2) Sums to means.
    for row in range(n):
        grain[row] /= faces[row]
        for k in range(3):
            mean[row, k] /= faces[row]
    # (3) The cloud, in the row after the views.
    if len(own):
        for i in range(first, last):
            for k in range(3):
                mean[n, k] += own[order[i], k] / (last - first)
    return n


@numba.njit(cache=True, nogil=True)
def _take_off_means(mean: Float64, grain: Float64, faces: Float64, n: int) -> float:
    """Turn mean squares into grain, levels; returns the least that any view has, or the usual."""
    least = np.inf
    for row in range(n):
        square = grain[row] - _square_distance(mean[row], mean[n])
        grain[row] = np.sqrt(max(square, 0.0))
        if faces[row] >= _GRAIN_FACES:
            least = min(least, grain[row])
    return max(least, _USUAL_GRAIN) if least < np.inf else _USUAL_GRAIN


@numba.njit(cache=True, nogil=True)
def _mode(mean: Float64, vote: Float64, count: int) -> Float64:
    """Mode of the density of so many colours: from the densest of them uphill."""
    # (1) Start at the colour of most density, by a Gaussian kernel.
    best, most = 0, -1.0
    for a in range(count):
        density = 0.0
        for b in range(count):
            square = _square_distance(mean[a], mean[b])
            density += vote[b] * np.exp(-0.5 * square / (_SIGMA * _SIGMA))
        if density > most:
            best, most = a, density
    # (2) Mean shift: uphill to the weighted mean of what is around.
    mode: Float64 = mean[best].copy()
    total = np.empty(3)
    for _ in range(_SHIFTS):
        total[:] = 0.0
        mass = 0.0
        for b in range(count):
            square = _square_distance(mode, mean[b])
            weight = vote[b] * np.exp(-0.5 * square / (_SIGMA * _SIGMA))
            mass += weight
            for k in range(3):
                total[k] += weight * mean[b, k]
        for k in range(3):
            mode[k] = total[k] / mass
    return mode
