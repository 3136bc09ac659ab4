"""Which segments lie within a radius: one small interface, and the plain model of it.

Scenes are searched by :class:`~terraport_store.rtree_index.RTreeIndex` or
:class:`~terraport_store.packed_rtree.PackedRTree`. The one here is what they are tested and
measured against. All answer exactly, by the same float64 arithmetic
(:func:`~terraport_payload.boxes.box_distances_m`), so they agree to the last segment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import Float32, Float64, Int64

__all__ = ["BruteForceIndex", "SpatialIndex", "validate_query"]


class SpatialIndex(Protocol):
    """Finds segments by distance."""

    def within(self, centre: Sequence[float], radius_m: float) -> Int64:
        """Find every segment whose box comes within a radius.

        Parameters
        ----------
        centre : sequence of 3 floats
            Metres, scene frame.
        radius_m : float
            Metres, >= 0.

        Returns
        -------
        ndarray of int64
            Ascending ids of the boxes whose distance to the centre (float64, 0 inside) is <=
            radius_m.

        Raises
        ------
        ValueError
            When the centre or the radius is not finite, or the radius is negative.
        """
        ...


class BruteForceIndex:
    """Every box, every time: the model that others are tested against.

    Fine for a few thousand segments; thread-safe.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6), float32
        As in :class:`~terraport_store.index.SegmentIndex`.
    """

    def __init__(self, bounds: Float32) -> None:
        self._bounds = bounds

    def within(self, centre: Sequence[float], radius_m: float) -> Int64:
        """Find every segment whose box comes within a radius; see :class:`SpatialIndex`."""
        point = validate_query(centre, radius_m)
        return np.flatnonzero(box_distances_m(self._bounds, point) <= radius_m).astype(np.int64)


def validate_query(centre: Sequence[float], radius_m: float) -> Float64:
    """Return the centre as an array; ValueError as :meth:`SpatialIndex.within` has it."""
    point = np.asarray(centre, dtype=np.float64)
    if point.shape != (3,) or not bool(np.isfinite(point).all()):
        raise ValueError(f"centre is {centre!r}, expected three finite numbers")
    if not (math.isfinite(radius_m) and radius_m >= 0):
        raise ValueError(f"radius_m is {radius_m!r}, expected a finite number >= 0")
    return point
