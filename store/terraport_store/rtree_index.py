"""Segments found by the package ``rtree`` (libspatialindex), and which tree a scene is searched by.

A scene of up to :data:`MOST_RTREE_SEGMENTS` is searched by :class:`RTreeIndex`, a larger one by
:class:`~terraport_store.packed_rtree.PackedRTree`. Both answer the same to the last segment. Time,
memory and build of both: ``docs/decisions/0046-plans-in-turns.md``.

References
----------
A. Guttman, "R-trees: a dynamic index structure for spatial searching", SIGMOD 1984; S. T.
Leutenegger, M. A. Lopez, J. Edgington, "STR: a simple and efficient algorithm for R-tree packing",
ICDE 1997 (libspatialindex's bulk loader).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from threading import Lock
from typing import Final

import numpy as np
from rtree import core
from rtree import index as rtree_index

from terraport_payload import box_distances_m
from terraport_payload.types import Float32, Float64, Int64
from terraport_store.packed_rtree import PackedRTree
from terraport_store.spatial import SpatialIndex, validate_query

__all__ = ["MOST_RTREE_SEGMENTS", "RTreeIndex", "spatial_index_of"]

MOST_RTREE_SEGMENTS: Final = 100_000
"""Up to so many segments a scene is searched by ``rtree``; beyond, its 320 bytes a segment and its
build are felt."""

_CAPACITY: Final = 100
"""Boxes per node; 20 and 50 were no faster."""

_FEW: Final = 512
"""Up to so many ids are sorted; more are marked in an array over the whole scene."""

_SHARE_OF_ALL: Final = 0.2
"""Of the scene's extent in a query from which on every box is measured and the tree is not asked:
it takes 0.1 us for each that it finds, and measuring takes 0.04."""

_QUERY_SLACK: Final = 2.0**-50
"""By what share of its own size a query cube is widened. A box may lie beyond ``point + radius`` by
the rounding of the subtraction in :func:`box_distances_m`, half a step of the *distance*: where
point and radius cancel that is more than any step of their sum."""

_LEAST_SLACK_M: Final = 1e-150
"""By how much at least: a gap whose square underflows to 0 (below 2e-162 m) is no distance."""


def spatial_index_of(bounds: Float32) -> SpatialIndex:
    """Return the tree by which segments with these bounds are searched; thread-safe.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6), float32
        As in :class:`~terraport_store.index.SegmentIndex`; finite.

    Examples
    --------
    >>> bounds = np.array([[0, 0, 0, 1, 1, 1], [5, 0, 0, 6, 1, 1]], dtype=np.float32)
    >>> spatial_index_of(bounds).within((0.0, 0.0, 0.0), 5.0).tolist()
    [0, 1]
    """
    return RTreeIndex(bounds) if len(bounds) <= MOST_RTREE_SEGMENTS else PackedRTree(bounds)


class RTreeIndex:
    """An R-tree of libspatialindex, bulk-loaded once; thread-safe.

    libspatialindex is not, not even for reads (wrong answers and crashes were seen with two
    threads): one query at a time is in it, and the interpreter is free meanwhile.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6), float32
        As in :class:`~terraport_store.index.SegmentIndex`; finite.
    """

    def __init__(self, bounds: Float32) -> None:
        self._bounds = bounds
        self._extent: tuple[Float32, Float32] | None = None
        """Lower and upper corner of all boxes together."""
        if len(bounds):
            self._extent = (bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0))
        self._lock = Lock()
        self._tree: rtree_index.Index | None = None
        self._hits = np.empty(len(bounds), dtype=np.int64)
        """Room for every id, written by the query that has the lock."""
        self._count = np.zeros(1, dtype=np.uint64)
        self._count_at = self._count.ctypes.data
        self._cube = np.empty(6)
        """Lower and upper corner of the query that has the lock."""
        self._room = (self._cube.ctypes.data, self._cube[3:].ctypes.data, self._hits.ctypes.data)
        """Addresses: to ask for one takes as long as a small query's own arithmetic."""
        if len(bounds):  # libspatialindex refuses an empty bulk load
            wide = bounds.astype(np.float64)
            properties = rtree_index.Property(
                dimension=3, leaf_capacity=_CAPACITY, index_capacity=_CAPACITY
            )
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
        if self._share(low, high) > _SHARE_OF_ALL:
            return np.flatnonzero(box_distances_m(self._bounds, point) <= radius_m)
        ids = self._in_cube(low, high)
        return ids[box_distances_m(self._bounds[ids], point) <= radius_m]

    def _share(self, low: Float64, high: Float64) -> float:
        """Return how much of the scene's extent a cube has, edge by edge."""
        assert self._extent is not None
        least, most = (corner.astype(np.float64) for corner in self._extent)
        shared_m = np.minimum(high, most) - np.maximum(low, least)
        is_flat = most <= least
        edges_m = np.where(is_flat, 1.0, most - least)
        return float(np.prod(np.where(is_flat, 1.0, np.clip(shared_m / edges_m, 0.0, 1.0))))

    def _in_cube(self, low: np.ndarray, high: np.ndarray) -> Int64:
        """Return the ids, ascending, of the boxes that meet a cube.

        By the library's call for arrays, which rtree's ``intersection_v`` repeats with twice the
        room until all ids have some, and ``intersection`` makes an object of each id.
        """
        assert self._tree is not None
        hits, done = self._hits, ctypes.c_int64(0)
        low_at, high_at, hits_at = self._room
        with self._lock:
            self._cube[:3], self._cube[3:] = low, high
            core.rt.Index_Intersects_id_v(
                self._tree.handle,
                1,
                3,
                len(hits),
                3,
                1,
                low_at,
                high_at,
                hits_at,
                self._count_at,
                ctypes.byref(done),
            )
            ids = hits[: int(self._count[0])]
            if len(ids) <= _FEW:
                return np.sort(ids)
            is_hit = np.zeros(len(hits), dtype=np.bool_)
            is_hit[ids] = True
        return np.flatnonzero(is_hit).astype(np.int64, copy=False)
