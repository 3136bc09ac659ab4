"""Which segments lie within a radius: one small interface, and two models of it.

Scenes are searched by :class:`~terraport_store.packed_rtree.PackedRTree`. The two here are what it
is tested and measured against. All answer exactly, by the same float64 arithmetic
(:func:`~terraport_payload.boxes.box_distances_m`), so they agree to the last segment.

References
----------
A. Guttman, "R-trees: a dynamic index structure for spatial searching", SIGMOD 1984; S. T.
Leutenegger, M. A. Lopez, J. Edgington, "STR: a simple and efficient algorithm for R-tree packing",
ICDE 1997 (libspatialindex's bulk loader).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np
from rtree import index as rtree_index

from terraport_payload import box_distances_m
from terraport_payload.types import Float32, Float64, Int64

__all__ = ["BruteForceIndex", "RTreeIndex", "SpatialIndex", "validate_query"]


_QUERY_SLACK: Final = 2.0**-50
"""By what share of its own size a query cube is widened. A box may lie beyond ``point + radius`` by
the rounding of the subtraction in :func:`box_distances_m`, half a step of the *distance*: where
point and radius cancel that is more than any step of their sum."""

_LEAST_SLACK_M: Final = 1e-150
"""By how much at least: a gap whose square underflows to 0 (below 2e-162 m) is no distance."""


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


class RTreeIndex:
    """An R-tree, bulk-loaded once.

    **Not thread-safe, not even for reads** (libspatialindex; wrong answers and crashes were seen
    with two threads): use it from one thread, or under one lock.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6), float32
        As in :class:`~terraport_store.index.SegmentIndex`.
    """

    def __init__(self, bounds: Float32) -> None:
        self._bounds = bounds
        self._tree: rtree_index.Index | None = None
        if len(bounds):  # libspatialindex refuses an empty bulk load
            wide = bounds.astype(np.float64)
            properties = rtree_index.Property(dimension=3, leaf_capacity=100, index_capacity=100)
            self._tree = rtree_index.Index(
                (
                    np.arange(len(bounds), dtype=np.int64),
                    np.ascontiguousarray(wide[:, :3]),
                    np.ascontiguousarray(wide[:, 3:]),
                ),
                properties=properties,
            )

    def within(self, centre: Sequence[float], radius_m: float) -> Int64:
        """Find every segment whose box comes within a radius; see :class:`SpatialIndex`."""
        point = validate_query(centre, radius_m)
        if self._tree is None:
            return np.zeros(0, dtype=np.int64)
        # The tree finds the boxes that meet the cube about the sphere; the exact test then decides.
        slack_m = (np.abs(point) + radius_m) * _QUERY_SLACK + _LEAST_SLACK_M
        low, high = point - radius_m - slack_m, point + radius_m + slack_m
        ids = np.fromiter(self._tree.intersection((*low, *high)), dtype=np.int64)
        ids = ids[box_distances_m(self._bounds[ids], point) <= radius_m]
        ids.sort()
        return ids


def validate_query(centre: Sequence[float], radius_m: float) -> Float64:
    """Return the centre as an array; ValueError as :meth:`SpatialIndex.within` has it."""
    point = np.asarray(centre, dtype=np.float64)
    if point.shape != (3,) or not bool(np.isfinite(point).all()):
        raise ValueError(f"centre is {centre!r}, expected three finite numbers")
    if not (math.isfinite(radius_m) and radius_m >= 0):
        raise ValueError(f"radius_m is {radius_m!r}, expected a finite number >= 0")
    return point
