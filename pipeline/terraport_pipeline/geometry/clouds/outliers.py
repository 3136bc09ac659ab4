"""Points that do not belong to any surface: exact copies and statistical outliers.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Bool, Float32, Float64
from terraport_pipeline.geometry.clouds.spacing import Neighbours

__all__ = ["duplicate_mask", "mean_distances", "outlier_mask", "usual_distance"]


_MIXERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
"""Odd 64-bit multipliers, one per axis (the primes of xxHash): they spread equal low bits."""

HOPELESS_RATIO = 10.0
"""A point this many times farther from its neighbours than usual supports no surface: trimming
reaches four spacings, and counts local spacings up to three times the cloud's."""

_MAD_TO_SIGMA = 1.4826
"""Median absolute deviation of a normal distribution, as its standard deviation."""


def duplicate_mask(points: Float64) -> Bool:
    """Mark every point that repeats an earlier one exactly.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Any frame.

    Returns
    -------
    ndarray of shape (N,), bool
        True for copies. The first in file order stays.

    Notes
    -----
    Rows are compared by a 64-bit hash and then by value, so two different points are never merged;
    the sort of one key is five times faster than `np.unique` over rows.

    Examples
    --------
    >>> duplicate_mask(np.array([[1.0, 2, 3], [1, 2, 4], [1, 2, 3]])).tolist()
    [False, False, True]
    """
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)  # + 0.0 turns -0.0 into 0.0
    key = np.zeros(len(points), dtype=np.uint64)
    for axis, mixer in enumerate(_MIXERS):
        key ^= bits[:, axis] * np.uint64(mixer)
        key ^= key >> np.uint64(29)
        key *= np.uint64(_MIXERS[0])
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    same &= (points[order[1:]] == points[order[:-1]]).all(axis=1)
    mask = np.zeros(len(points), dtype=bool)
    mask[order[1:][same]] = True
    return mask


def mean_distances(neighbours: Neighbours, *, k: int = 8) -> Float32:
    """Mean distance of every point to its k nearest neighbours, metres, (N,) float32, above 0."""
    k = min(k, neighbours.indices.shape[1])
    means_m: Float32 = np.maximum(neighbours.distances[:, :k].mean(axis=1), np.float32(1e-12))
    return means_m


def usual_distance(mean_m: Float32) -> tuple[float, float]:
    """Median of the logarithms of mean distances, and their robust standard deviation."""
    logs = np.log(mean_m)
    middle = float(np.median(logs))
    return middle, _MAD_TO_SIGMA * float(np.median(np.abs(logs - middle)))


def outlier_mask(
    neighbours: Neighbours,
    *,
    ratio: float = 3.0,
    deviations: float = 3.0,
    k: int = 8,
    usual: tuple[float, float] | None = None,
) -> Bool:
    """Mark points that stand alone beside a denser surface.

    A point is an outlier when the mean distance to its k neighbours is

    - more than `ratio` times the median of its neighbours' own mean distances, *and*
    - more than `deviations` robust standard deviations above the cloud's median, on a log scale.

    The first test spares thinly sampled ground (its neighbours are as thin), the second spares the
    denser parts' rims. Lone points whose neighbours are other lone points pass the first; they go
    when their distance is more than :data:`HOPELESS_RATIO` times the cloud's median, where no
    surface would be kept through them anyway.

    Parameters
    ----------
    neighbours : Neighbours
        Of all points.
    ratio : float
        See above; larger keeps more.
    deviations : float
        See above; larger keeps more.
    k : int
        Neighbours that count; all are used where there are fewer.
    usual : (float, float), optional
        :func:`usual_distance` of the whole cloud that these points are a part of; of the points
        themselves by default.

    Returns
    -------
    ndarray of shape (N,), bool
        True for outliers.
    """
    k = min(k, neighbours.indices.shape[1])
    mean_m = mean_distances(neighbours, k=k)
    around_m = np.median(mean_m[neighbours.indices[:, :k]], axis=1)
    logs = np.log(mean_m)
    middle, sigma = usual or usual_distance(mean_m)
    alone: Bool = mean_m > ratio * around_m
    alone &= logs > middle + deviations * sigma
    alone |= logs > middle + np.log(HOPELESS_RATIO)
    return alone
