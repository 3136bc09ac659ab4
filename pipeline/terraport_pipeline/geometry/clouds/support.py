"""How well the samples support each place of a surface, and where support ends.

The *support ratio* of a place is its distance to the nearest sample over the cloud's spacing
there. On a sampled surface it has one mode near a half. A Poisson surface goes on beyond the
samples: there every further spacing adds the same strip along the border (length of the border
times one spacing), so the histogram of area over ratio ends in a plateau.
:func:`support_threshold` reads off where the mode's flank sinks into that plateau: what lies left
of it is mostly sampled surface, what lies right of it mostly border.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["BINS", "LARGEST_RATIO", "support_histogram", "support_ratio", "support_threshold"]

BINS: Final = 120
"""Bins of the histogram, equal from 0 to :data:`LARGEST_RATIO`."""

LARGEST_RATIO: Final = 12.0
"""Larger ratios count into the last bin; nothing that far out is ever wanted."""

LEAST_THRESHOLD: Final = 2.0
"""Random sampling leaves gaps of nearly two spacings everywhere: a lower bound would cut notches
into the border wherever such a gap lies at it."""

DENSITY_SPAN: Final = 3.0
"""Local spacings count up to this factor above the cloud's, so that a hole's rim cannot bridge the
hole."""

_PLATEAU: Final = (5.0, 10.0)
"""Ratios between which the plateau is read: beyond what sampling explains, before the surface bends
away."""

_ABOVE_PLATEAU: Final = 2.0
"""The flank ends where the histogram is this many times the plateau: half of the area there is
sampled, half is border."""

_TAIL_SHARE: Final = 0.002
"""Where there is no plateau (a closed body), the threshold leaves this share of the area beyond."""

_CHUNK: Final = 500_000
"""Vertices per nearest-neighbour query; bounds its scratch to 8 MB."""


def support_ratio(
    vertices: Float32,
    tree: cKDTree,
    local_spacing_m: Float32,
    spacing_m: float,
    *,
    workers: int = -1,
) -> Float32:
    """Measure every vertex's distance to the nearest sample in spacings.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    tree : cKDTree
        Over the N samples, metres, scene frame. At least one.
    local_spacing_m : ndarray of shape (N,), float32
        Areal spacing around each sample.
    spacing_m : float
        The whole cloud's (a tile passes the scene's, not its own): local spacings are held between
        this and :data:`DENSITY_SPAN` times this.
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    ndarray of shape (V,), float32
    """
    span_m = np.clip(local_spacing_m, spacing_m, DENSITY_SPAN * spacing_m)
    ratio = np.empty(len(vertices), dtype=np.float32)
    for begin in range(0, len(vertices), _CHUNK):
        here = slice(begin, begin + _CHUNK)
        distance_m, index = tree.query(vertices[here], workers=workers)
        ratio[here] = distance_m / span_m[index]
    return ratio


def support_histogram(vertices: Float32, faces: Int32, ratio: Float32) -> Float64:
    """Sum the surface's area by support ratio.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
    ratio : ndarray of shape (V,), float32
        :func:`support_ratio`.

    Returns
    -------
    ndarray of shape (BINS,), float64
        Square metres; a face counts at the mean ratio of its corners. Histograms of pieces of one
        surface add up.
    """
    return _sum_areas(
        as_kernel_input(vertices, np.float32),
        as_kernel_input(faces, np.int32),
        as_kernel_input(ratio, np.float32),
    )


def support_threshold(histogram: Float64, *, largest: float = 4.0) -> float:
    """Read where the sampled surface ends.

    Parameters
    ----------
    histogram : ndarray of shape (BINS,), float64
        :func:`support_histogram` of the whole surface, before anything was trimmed.
    largest : float
        Never more than this.

    Returns
    -------
    float
        Support ratio, between :data:`LEAST_THRESHOLD` and `largest`, at a bin's edge.

    Examples
    --------
    A flank that falls by half from bin to bin onto a plateau of 1:

    >>> histogram = np.full(BINS, 1.0) + 1e6 * 0.5 ** np.arange(BINS)
    >>> round(support_threshold(histogram), 3)
    2.1
    """
    width = LARGEST_RATIO / BINS
    total = float(histogram.sum())
    if not total > 0:
        return largest
    low, high = (round(edge / width) for edge in _PLATEAU)
    plateau = float(np.median(histogram[low:high]))
    # The last bin holds all that lies farther out: it is no part of the curve.
    smooth = np.convolve(histogram[:-1], np.full(3, 1.0 / 3.0), mode="same")
    beyond = total - np.cumsum(histogram)
    after = np.arange(BINS - 1) > int(smooth.argmax())
    if plateau > 0:
        ends = after & (smooth <= _ABOVE_PLATEAU * plateau)
    else:
        ends = after & (beyond[:-1] <= _TAIL_SHARE * total)
    edge = width * int(ends.argmax()) if ends.any() else largest
    return float(min(max(edge, LEAST_THRESHOLD), largest))


@numba.njit(cache=True, nogil=True)
def _sum_areas(vertices: Float32, faces: Int32, ratio: Float32) -> Float64:
    sums = np.zeros(BINS)
    edge_1, edge_2 = np.empty(3), np.empty(3)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for axis in range(3):
            edge_1[axis] = np.float64(vertices[b, axis]) - vertices[a, axis]
            edge_2[axis] = np.float64(vertices[c, axis]) - vertices[a, axis]
        x = edge_1[1] * edge_2[2] - edge_1[2] * edge_2[1]
        y = edge_1[2] * edge_2[0] - edge_1[0] * edge_2[2]
        z = edge_1[0] * edge_2[1] - edge_1[1] * edge_2[0]
        mean = (np.float64(ratio[a]) + ratio[b] + ratio[c]) / 3.0
        bin_number = min(int(mean * (BINS / LARGEST_RATIO)), BINS - 1)
        sums[bin_number] += 0.5 * np.sqrt(x * x + y * y + z * z)
    return sums
