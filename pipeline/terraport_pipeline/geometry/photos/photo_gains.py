"""Exposure of photos from what they show of one surface.

Places i of the surface are seen in photos v with levels L, whose logarithm ``y = log(L + 14.025)``
moves by a constant when the exposure changes (see
:mod:`terraport_pipeline.geometry.photos.photo_samples`). Wanted are gains g and the vignetting of
each lens so that all photos say the same of a place::

    minimise  sum over i, v: w_iv (y_iv + g_v + a rho_iv^2 + b rho_iv^4 - s_i)^2  +  ridge sum of
    g_v^2

where s_i, the place's own value, is eliminated (it is the weighted mean of its row), and the
weights are found again in every round from the residuals (Tukey's biweight, narrowing), so that
trucks, glints and wrong geometry do not count. This is gain compensation as in Brown & Lowe,
"Automatic panoramic image stitching using invariant features" (IJCV 2007), section 6, with their
error taken on logarithms, per place instead of per pair of photos, and made robust.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int16, Int32, UInt8
from terraport_pipeline.geometry.photos.photo_samples import GAIN_COLUMNS, SRGB_OFFSET

__all__ = ["MAX_VIEWS", "Exposures", "Sightings", "solve_gains"]

MAX_VIEWS: Final = 4096
"""The normal equations are a full matrix, 134 MB at this many photos and 6 s to solve."""

_ROUNDS: Final = 6
"""Rounds of weights; the gains move by less than 1 % after the fourth."""

_FIRST_WIDTH: Final = 0.25
_LAST_WIDTH: Final = 0.1
_NARROWING: Final = 0.8
"""Sightings farther than the width (a logarithm) from their place's mean do not count. From a start
at the most frequent ratio to the cloud this stays on what is common to all; from zero, or with
weights that never reach 0, the crowns of trees that the cloud does not have pulled photos by 10
%."""

_CLOUD_WEIGHT: Final = 4.0
"""The cloud's colours are the mean of many photos, and they hold chains of photos straight."""

_MODE_BINS: Final = 400
_MODE_WIDTH: Final = 0.07
"""The most frequent logarithm of a ratio is found in a histogram from -2 to 2, smoothed so wide."""

_RIDGE: Final = 1e-3
"""Pull of each gain to 1, in observations' weight per mean photo: holds photos that overlap
nothing, and what the photos leave open."""

_LOW: Final = 6
_HIGH: Final = 249
"""Levels below or above are clipped, or nearly, and say nothing about exposure."""

_MAX_STEP: Final = 0.35
"""Largest logarithm of the common factor between photos and cloud that the photos are given: a
factor of 2.3 in light. A cloud farther from its photos is a cloud with colours of its own; then it
follows them."""

_MAX_VIGNETTING: Final = 0.5
"""Largest vignetting believed, as a logarithm in the corners."""


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Colours of I places in up to O photos each."""

    view: Int16
    """(I, O) photo; -1: none; ``n_views`` stands for the cloud's own colours."""
    level: UInt8
    """(I, O, 3) sRGB."""
    radius: Float32
    """(I, O) distance from the photo's middle, 1 in the corners."""


@dataclass(frozen=True, slots=True, eq=False)
class Exposures:
    """Gains of every view and the cloud, and the spread of what they leave."""

    gains: Float32
    """(n_views + 1, GAIN_COLUMNS); the last row is the cloud's."""
    sightings: int
    """Sightings that counted."""
    spread_before: float
    spread_after: float
    """Median over the sightings of |log difference| to their place's mean, before and after, as a
    part of the level."""


def solve_gains(
    sightings: Sightings, n_views: int, lens_of_view: Int32, *, vignetting: bool = True
) -> Exposures:
    """Find gains.

    Parameters
    ----------
    sightings : Sightings
    n_views : int
        At most :data:`MAX_VIEWS`; may be 0.
    lens_of_view : ndarray of shape (n_views,), int32
        Number of each view's lens, 0..; views of one lens share their vignetting.
    vignetting : bool
        Whether to find it.

    Returns
    -------
    Exposures
        The cloud, where it was seen, keeps its colours and the photos follow, up to a factor of 2.3
        in light; without it, or beyond, the photos keep their mean.

    Raises
    ------
    ValueError
        Too many views.
    """
    if n_views > MAX_VIEWS:
        raise ValueError(f"{n_views} views, expected at most {MAX_VIEWS}")
    gains = np.zeros((n_views + 1, GAIN_COLUMNS), np.float32)
    gains[:, :3] = 1.0
    # (1) Sightings that compare something: neither black nor burnt, and two at least of one
    # place.
    valid = (sightings.view >= 0) & (
        (sightings.level >= _LOW) & (sightings.level <= _HIGH)
    ).all(axis=2)  # fmt: skip
    valid &= (valid.sum(axis=1) >= 2)[:, None]  # one sighting alone compares nothing
    view = np.where(valid, sightings.view, -1).astype(np.int32)
    if not valid.any():
        return Exposures(gains, 0, 0.0, 0.0)
    # (2) Unknowns: the logarithm of each view's gain, the cloud's, two vignetting terms a lens.
    value = np.log(sightings.level.astype(np.float32) + np.float32(SRGB_OFFSET))
    n_lenses = int(lens_of_view.max()) + 1 if n_views else 0
    lens = np.append(lens_of_view, -1).astype(np.int32)  # the cloud has none
    n_unknowns = n_views + 1 + (2 * n_lenses if vignetting else 0)
    x: Float64 = np.zeros((n_unknowns, 3))
    x[:n_views] = _start(view, value, n_views)
    weight = valid.astype(np.float32)
    start = _residuals(view, value, sightings.radius, weight, lens, n_views, np.zeros_like(x))
    spread_before = float(np.median(start[valid]))
    # (3) Reweighted least squares: what does not fit counts less, by a limit that narrows.
    width = _FIRST_WIDTH
    for _ in range(_ROUNDS):
        residual = _residuals(view, value, sightings.radius, weight, lens, n_views, x)
        near = np.maximum(1.0 - (residual / width) ** 2, 0.0)  # Tukey's biweight
        weight = np.where(valid, near * near, 0.0).astype(np.float32)
        weight[view == n_views] *= _CLOUD_WEIGHT
        matrix, right = _normal_equations(
            view, value, sightings.radius, weight, lens, n_views, n_unknowns
        )
        ridge = np.full(n_unknowns, _RIDGE * max(float(weight.sum()) / (n_views + 1), 1.0))
        ridge[n_views] *= 1e-6  # the cloud's gain is free
        matrix[np.diag_indices(n_unknowns)] += ridge
        x = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        # one vignetting for all channels: a lens darkens them alike
        x[n_views + 1 :] = x[n_views + 1 :].mean(axis=1)[:, None]
        width = max(width * _NARROWING, _LAST_WIDTH)
    # (4) Gains relative to the reference; views without a sighting keep 1.
    residual = _residuals(view, value, sightings.radius, weight, lens, n_views, x)
    shift = _reference(x[: n_views + 1], view, n_views)
    gains[:, :3] = np.exp(x[: n_views + 1] - shift)
    unseen = np.bincount(view[valid], minlength=n_views + 1) == 0
    gains[unseen, :3] = 1.0
    if vignetting and n_lenses:
        a = x[n_views + 1 :: 2, 0][lens_of_view]
        b = x[n_views + 2 :: 2, 0][lens_of_view]
        size = np.maximum(1.0, np.abs(a + b) / _MAX_VIGNETTING)
        a, b = a / size, b / size
        # exp(a r^2 + b r^4) to fourth order
        gains[:-1, 3], gains[:-1, 4] = a, b + 0.5 * a * a
    return Exposures(gains, int(valid.sum()), spread_before, float(np.median(residual[valid])))


def _start(view: Int32, value: Float32, n_views: int) -> Float64:
    """Most frequent log ratio of the cloud to each photo, (n_views, 3); 0 without a cloud."""
    start = np.zeros((n_views, 3))
    cloud = (view == n_views).argmax(axis=1)
    rows = np.arange(len(view))
    has_cloud = view[rows, cloud] == n_views
    kernel = np.exp(-((np.arange(-30, 31) * 4.0 / _MODE_BINS / _MODE_WIDTH) ** 2))
    order = np.argsort(view, axis=None, kind="stable")
    first = np.searchsorted(view.ravel()[order], np.arange(n_views + 1))
    for number in range(n_views):
        row, column = np.divmod(order[first[number] : first[number + 1]], view.shape[1])
        row, column = row[has_cloud[row]], column[has_cloud[row]]
        if not len(row):
            continue
        ratio = value[row, cloud[row]] - value[row, column]
        mean = ratio.mean(axis=1)
        counts, edges = np.histogram(mean, bins=_MODE_BINS, range=(-2.0, 2.0))
        mode = edges[np.convolve(counts, kernel, "same").argmax()] + 2.0 / _MODE_BINS
        near = np.abs(mean - mode) < 2.0 * _MODE_WIDTH
        start[number] = np.median(ratio[near], axis=0) if near.any() else mode
    return start


def _reference(logarithms: Float64, view: Int32, n_views: int) -> Float64:
    """Find what to subtract from the gains' logarithms, (3,); see :func:`solve_gains`."""
    count = np.bincount(view[view >= 0], minlength=n_views + 1)
    photos = count[:-1]
    mean = (
        (photos[:, None] * logarithms[:-1]).sum(axis=0) / photos.sum()
        if photos.sum()
        else np.zeros(3)
    )
    if count[-1] == 0:
        return np.asarray(mean)
    cloud = logarithms[-1]
    if np.abs(mean - cloud).max() <= _MAX_STEP:
        return np.asarray(cloud)
    return np.asarray(mean)


@numba.njit(cache=True, nogil=True)
def _offset(x: Float64, k: int, v: int, radius: float, lens: Int32, n_views: int) -> float:
    """Add up what the unknowns change of a sighting's logarithm."""
    total: float = x[v, k]
    if lens[v] >= 0 and len(x) > n_views + 1:
        square = radius * radius
        at = n_views + 1 + 2 * lens[v]
        total += square * (x[at, k] + square * x[at + 1, k])
    return total


@numba.njit(cache=True, nogil=True)
def _residuals(
    view: Int32,
    value: Float32,
    radius: Float32,
    weight: Float32,
    lens: Int32,
    n_views: int,
    x: Float64,
) -> Float32:
    """Mean over the channels of |difference to the place's mean|; 0 where there is no sighting."""
    residual = np.zeros(view.shape, np.float32)
    # The place's own level is the weighted mean of its sightings, each with its view's offset
    # taken in.
    for i in range(view.shape[0]):
        for k in range(3):
            total, mass = 0.0, 0.0
            for o in range(view.shape[1]):
                if view[i, o] >= 0:
                    w = np.float64(weight[i, o])
                    total += w * (
                        value[i, o, k] + _offset(x, k, view[i, o], radius[i, o], lens, n_views)
                    )
                    mass += w
            if mass <= 0.0:
                continue
            for o in range(view.shape[1]):
                if view[i, o] >= 0:
                    here = value[i, o, k] + _offset(x, k, view[i, o], radius[i, o], lens, n_views)
                    residual[i, o] += abs(here - total / mass) / 3.0
    return residual


@numba.njit(cache=True, nogil=True)
def _normal_equations(
    view: Int32,
    value: Float32,
    radius: Float32,
    weight: Float32,
    lens: Int32,
    n_views: int,
    n_unknowns: int,
) -> tuple[Float64, Float64]:
    """Matrix and right sides with the places' own values eliminated."""
    # Per place the unknown is also its own value; as the weighted mean of its sightings it is
    # eliminated at once (Schur complement), so the system has only the gains.
    matrix = np.zeros((n_unknowns, n_unknowns))
    right = np.zeros((n_unknowns, 3))
    most = 3 * view.shape[1]
    column = np.empty(most, np.int64)
    factor = np.empty(most)
    owner = np.empty(most, np.int64)
    vignetting = n_unknowns > n_views + 1
    for i in range(view.shape[0]):
        # (1) The place's entries: column, factor and sighting of every unknown that it depends
        # on.
        n, mass = 0, 0.0
        mean = np.zeros(3)
        for o in range(view.shape[1]):
            v = view[i, o]
            if v < 0:
                continue
            w = np.float64(weight[i, o])
            mass += w
            for k in range(3):
                mean[k] += w * value[i, o, k]
            column[n], factor[n], owner[n] = v, 1.0, o
            n += 1
            if vignetting and lens[v] >= 0:
                square = np.float64(radius[i, o]) ** 2
                at = n_views + 1 + 2 * lens[v]
                column[n], factor[n], owner[n] = at, square, o
                column[n + 1], factor[n + 1], owner[n + 1] = at + 1, square * square, o
                n += 2
        # (2) Their products, less those of the mean. Invariant: the matrix stays symmetric, and a
        # factor that all sightings of a place have in common stays free (the ridge settles it).
        if mass <= 0.0:
            continue
        for p in range(n):
            wp = weight[i, owner[p]] * factor[p]
            for q in range(n):
                entry = -wp * weight[i, owner[q]] * factor[q] / mass
                if owner[p] == owner[q]:
                    entry += wp * factor[q]
                matrix[column[p], column[q]] += entry
            for k in range(3):
                right[column[p], k] -= wp * (value[i, owner[p], k] - mean[k] / mass)
    return matrix, right
