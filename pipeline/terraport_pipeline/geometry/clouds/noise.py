"""How far samples scatter about their surface: noise, told apart from what the surface does.

The thickness of a neighbourhood mixes noise, curvature and roughness (rubble, grass, edges). Only
noise is there at *every* distance: two samples that lie almost at one place of a rough surface have
almost one height, two noisy ones have not. So a quadric is fitted to each neighbourhood, which
takes the curvature; of the heights that it leaves, half the mean square difference is taken between
near samples and between farther ones; continued to distance 0 it is the *nugget* of a variogram,
the variance of the noise.

References
----------
G. Matheron, "Principles of geostatistics", Economic Geology 58, 1963: the nugget.
N. Cressie and D. M. Hawkins, "Robust estimation of the variogram: I", Mathematical Geology 12,
1980: the fourth power of the mean root of the differences, which few pairs across an edge sway.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, Float64, Int64

__all__ = ["window_noise"]

_NEIGHBOURS: Final = (48, 128, 320)
"""Samples of a fit: the first of these whose ball is wide enough for the noise found in it."""

_WIDE_DEVIATIONS: Final = 3.0
"""Least radius of that ball, in deviations of the noise: a smaller one lies within the noise and
shows no surface (noise of 2 spacings: 1.7 by 48 neighbours, 2.0 by 128)."""

_TERMS: Final = 6
_LEAST: Final = 24
"""Neighbours below which six terms leave too little to measure."""

_NEAR: Final = slice(0, 4)
_FAR: Final = slice(8, 16)
"""Neighbours by distance along the surface: pairs of the two lags."""


def window_noise(points: AnyFloat, rows: Int64, *, workers: int = 1) -> tuple[float, Float64]:
    """Measure the noise of a window of a cloud, and the area that each sample stands for.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        Metres about the window's middle, no copies.
    rows : ndarray of shape (M,), int64
        Samples to measure, some spacings inside of the window's rim.
    workers : int
        Threads; the answer does not depend on it.

    Returns
    -------
    noise_m : float
        Standard deviation of the samples across their surface; 0 where there are too few to tell.
        Within a tenth for isotropic noise of 0.3 to 3 spacings.
    area_m2 : ndarray of shape (M,), float64
        Along the surface. The ball that holds the k nearest samples cuts the surface in a smaller
        disk where noise lifts samples off it: ``pi (r_k^2 - 2 noise^2) / k``.
    """
    if len(points) <= _LEAST or not len(rows):
        return 0.0, np.zeros(0)
    centred = np.asarray(points, dtype=np.float64)
    tree = cKDTree(centred, balanced_tree=False)
    for count in _NEIGHBOURS:
        k = min(count, len(centred))
        distances_m, near = tree.query(centred[rows], k=k, workers=workers)
        noise_m = float(np.sqrt(_nugget(centred, rows, near)))
        if float(np.median(distances_m[:, -1])) >= _WIDE_DEVIATIONS * noise_m or k < count:
            break
    disk_m2 = np.maximum(distances_m[:, -1] ** 2 - 2 * noise_m**2, 0.0)
    area_m2: Float64 = np.pi * disk_m2 / (k - 1)
    return noise_m, area_m2


def _nugget(points: Float64, rows: Int64, near: Int64) -> float:
    """Variogram of the heights over fitted quadrics, continued to distance 0; m2."""
    # (1) Heights and places along the surface: principal axes of each neighbourhood.
    offsets = points[near] - points[rows][:, None]
    offsets -= offsets.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    local = np.einsum("nki,nij->nkj", offsets, axes)
    height, along = local[:, :, 0], local[:, :, 1:]
    # (2) What a quadric leaves of the heights. Places in units of the neighbourhood's width, so
    # that all six terms are about 1.
    width = np.sqrt((along**2).sum(axis=2)).max(axis=1)[:, None] + 1e-30
    a, b = along[:, :, 0] / width, along[:, :, 1] / width
    terms = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=2)
    normal = np.einsum("nki,nkj->nij", terms, terms) + 1e-9 * np.eye(_TERMS)
    right = np.einsum("nki,nk->ni", terms, height)
    fitted = np.linalg.solve(normal, right[:, :, None])
    left = height - (terms @ fitted)[:, :, 0]
    # (3) Differences to the sample itself (column 0) at two distances along the surface.
    away = np.sqrt(((along[:, 1:] - along[:, :1]) ** 2).sum(axis=2))
    order = np.argsort(away, axis=1, kind="stable")
    away = np.take_along_axis(away, order, axis=1)
    steps = np.take_along_axis(left[:, 1:] - left[:, :1], order, axis=1)
    near_m2, far_m2 = _half_square(steps[:, _NEAR]), _half_square(steps[:, _FAR])
    near_m, far_m = float(away[:, _NEAR].mean()), float(away[:, _FAR].mean())
    # (4) The line through both, at 0. Noise lies level; a rough surface rises.
    rise = max(far_m2 - near_m2, 0.0) / max(far_m - near_m, 1e-30)
    return max(near_m2 - rise * near_m, 0.0)


def _half_square(differences: Float64) -> float:
    """Half the mean square difference, by the robust estimator of Cressie and Hawkins."""
    mean_root = float(np.sqrt(np.abs(differences)).mean())
    return 0.5 * mean_root**4 / (0.457 + 0.494 / differences.size)
