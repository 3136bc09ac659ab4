"""From raw shape diameters to an index that compares faces: filled, smoothed, on a log scale.

PURE: no I/O, no clock.

References
----------
L. Shapira, A. Shamir, D. Cohen-Or, "Consistent mesh partitioning and skeletonisation using the
shape diameter function", The Visual Computer 24(4), 2008, sections 3.1 and 4 (alpha = 4).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int32

__all__ = ["cone_directions", "shape_index"]


_ALPHA: Final = 4.0
"""Of the paper: how strongly thin parts are told apart against thick ones."""
_SMOOTH_ROUNDS: Final = 3
"""Passes of smoothing over neighbouring faces."""
_SMOOTH_WIDTH: Final = 0.1
"""Neighbours whose index differs by this share of the whole range still weigh 1/e."""


def cone_directions(rays: int, opening_degrees: float) -> tuple[Float64, Float64]:
    """Spread directions evenly over a cone about +z.

    Parameters
    ----------
    rays : int
        At least 1.
    opening_degrees : float
        Full opening angle, above 0 and below 180.

    Returns
    -------
    directions : ndarray of shape (rays, 3), float64
        Unit vectors on a golden spiral: the same every time, and no two in one plane with the axis.
    weights : ndarray of shape (rays,), float64
        Inverse of the angle to the axis in radians, as in the paper.
    """
    if rays < 1 or not 0.0 < opening_degrees < 180.0:
        msg = f"{rays} rays in a cone of {opening_degrees:g} degrees, expected 1 or more, 0..180"
        raise ValueError(msg)
    height = 1.0 - (np.arange(rays) + 0.5) / rays * (1.0 - np.cos(np.radians(opening_degrees / 2)))
    around = np.arange(rays) * (np.pi * (3.0 - np.sqrt(5.0)))
    radius = np.sqrt(1.0 - height * height)
    directions = np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)
    return directions, 1.0 / np.arccos(height)


def shape_index(diameter: AnyFloat, pairs: Int32) -> Float64:
    """Turn shape diameters into an index from 0 (thinnest) to 1 (thickest).

    Parameters
    ----------
    diameter : ndarray of shape (F,), float
        Length per face; NaN where no ray met anything.
    pairs : ndarray of shape (P, 2), int32
        Faces that share an edge.

    Returns
    -------
    ndarray of shape (F,), float64
        Finite. Faces without a diameter count as the thickest (there is nothing opposite). All
        zero where no face has a diameter or all are alike.

    Notes
    -----
    ``log(1 + alpha (d - min) / (max - min)) / log(1 + alpha)``, then three bilateral passes:
    neighbours count less the more they differ, so the edges of parts stay.
    """
    measured = np.isfinite(diameter)
    if not measured.any():
        return np.zeros(len(diameter))
    values = diameter.astype(np.float64)
    low, high = float(values[measured].min()), float(values[measured].max())
    if high <= low:
        return np.zeros(len(diameter))
    values[~measured] = high
    index = np.log1p(_ALPHA * (values - low) / (high - low)) / np.log1p(_ALPHA)
    a, b = pairs[:, 0], pairs[:, 1]
    for _ in range(_SMOOTH_ROUNDS):
        likeness = np.exp(-(((index[a] - index[b]) / _SMOOTH_WIDTH) ** 2))
        weight = 1.0 + _sums(likeness, likeness, a, b, len(index))
        index = (index + _sums(likeness * index[b], likeness * index[a], a, b, len(index))) / weight
    clipped: Float64 = np.clip(index, 0.0, 1.0)
    return clipped


def _sums(at_a: Float64, at_b: Float64, a: Int32, b: Int32, count: int) -> Float64:
    total = np.bincount(a, weights=at_a, minlength=count).astype(np.float64)
    return total + np.bincount(b, weights=at_b, minlength=count)
