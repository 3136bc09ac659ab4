"""Kernels of :mod:`terraport_pipeline.geometry.view_outliers`, which states the model.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int16, Int32, Int64, UInt8, UInt16
from terraport_pipeline.geometry.view_kernels import QUALITY_STEPS, SLOTS, place_of_view

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
    """Find how far each view of the cells begin..end is from the rest, over the limit."""
    seen = np.empty(MAX_VIEWS, np.int64)
    faces = np.empty(MAX_VIEWS)
    mean = np.empty((MAX_VIEWS + 1, 3))
    grain = np.empty(MAX_VIEWS)
    vote = np.empty(MAX_VIEWS + 1)
    for cell in range(begin, end):
        first, last = starts[cell], starts[cell + 1]
        n = _means(views, colours, own, order, first, last, seen, faces, mean, grain)
        for place in range(n):
            cell_views[cell, place] = seen[place]
            vote[place] = faces[place] / (last - first)  # a view of half the cell: half a vote
        count = n
        usual = 0.0
        if len(own):
            usual = _take_off_means(mean, grain, faces, n)
            vote[n] = _CLOUD_VOTE
            count += 1
        if n == 0 or count < 2 or (count == 2 and not len(own)):  # two views: nobody decides
            continue
        mode = _mode(mean, vote, count)
        limit = _FAR_ALONE if n == 1 else _FAR
        for place in range(n):
            square = _square_distance(mode, mean[place])
            if len(own) and faces[place] >= _GRAIN_FACES:
                square += _GRAIN_WEIGHT * max(grain[place] - usual, 0.0) ** 2
            far[cell, place] = np.sqrt(square) / limit


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
    """Drop views of the cells begin..end; returns the pairs of face and view dropped."""
    dropped = 0
    out = np.empty(MAX_VIEWS, np.bool_)
    less = np.empty(MAX_VIEWS, np.int64)
    for cell in range(begin, end):
        n = 0
        while n < MAX_VIEWS and cell_views[cell, n] >= 0:
            share = far[cell, n]
            out[n] = share > 1.0 or (
                share > _NEIGHBOUR
                and _far_around(cell_views, far, around[cell], cell_views[cell, n])
            )
            less[n] = int(QUALITY_STEPS * (share / _HALVED) ** 2)
            n += 1
        for i in range(starts[cell], starts[cell + 1]):
            f = order[i]
            kept = 0
            for s in range(SLOTS):
                if views[f, s] < 0:
                    break
                place = 0
                while place < n and cell_views[cell, place] != views[f, s]:
                    place += 1
                if place < n and out[place]:
                    dropped += 1
                    continue
                minus = less[place] if place < n else 0
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
        for place in range(MAX_VIEWS):
            if cell_views[other, place] < 0:
                break
            if cell_views[other, place] == view:
                if far[other, place] > 1.0:
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
    """Mean colour of a cell in each of its n views, and in the cloud at place n.

    Also the faces of each view, and the mean square of what the faces differ from the cloud's.
    """
    n = 0
    mean[:] = 0.0
    grain[:] = 0.0
    faces[:] = 0.0
    for i in range(first, last):
        f = order[i]
        for s in range(SLOTS):
            if views[f, s] < 0:
                break
            place = place_of_view(seen, n, views[f, s])
            if place == n:
                if n == MAX_VIEWS:
                    continue
                seen[n] = views[f, s]
                n += 1
            faces[place] += 1.0
            for k in range(3):
                mean[place, k] += colours[f, s, k]
                if len(own):
                    grain[place] += (np.float64(colours[f, s, k]) - own[f, k]) ** 2 / 3.0
    for place in range(n):
        grain[place] /= faces[place]
        for k in range(3):
            mean[place, k] /= faces[place]
    if len(own):
        for i in range(first, last):
            for k in range(3):
                mean[n, k] += own[order[i], k] / (last - first)
    return n


@numba.njit(cache=True, nogil=True)
def _take_off_means(mean: Float64, grain: Float64, faces: Float64, n: int) -> float:
    """Turn mean squares into grain, levels; returns the least that any view has, or the usual."""
    least = np.inf
    for place in range(n):
        square = grain[place] - _square_distance(mean[place], mean[n])
        grain[place] = np.sqrt(max(square, 0.0))
        if faces[place] >= _GRAIN_FACES:
            least = min(least, grain[place])
    return max(least, _USUAL_GRAIN) if least < np.inf else _USUAL_GRAIN


@numba.njit(cache=True, nogil=True)
def _mode(mean: Float64, vote: Float64, count: int) -> Float64:
    """Mode of the density of so many colours: from the densest of them uphill."""
    best, most = 0, -1.0
    for a in range(count):
        density = 0.0
        for b in range(count):
            square = _square_distance(mean[a], mean[b])
            density += vote[b] * np.exp(-0.5 * square / (_SIGMA * _SIGMA))
        if density > most:
            best, most = a, density
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
