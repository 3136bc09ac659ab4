"""An R-tree in a few flat arrays, packed once and asked with NumPy.

The scene's segments never change while it is open, so the tree needs no inserts: sorted once, every
64 neighbours are a node, every 64 nodes a node above. A query tests one level after the other as
arrays. Measured against libspatialindex in the same run (``benchmarks/landing.py --only plan``): a
landing on 1,000 of a million segments is found in a third of the time, in 28 bytes per segment
instead of some 150, and from any thread.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import Float32, Int64, UInt32
from terraport_store.spatial import validate_query

__all__ = ["PackedRTree"]


class PackedRTree:
    """A static R-tree over segment bounds; thread-safe.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6), float32
        As in :class:`~terraport_store.index.SegmentIndex`; finite.
    fanout : int, optional
        Boxes per node, >= 2.
    most_roots : int, optional
        So many boxes are tested one and all: cheaper than another level.

    References
    ----------
    S. T. Leutenegger, M. A. Lopez, J. Edgington, "STR: a simple and efficient algorithm for R-tree
    packing", ICDE 1997. Tiles are cut over x and z only: ground is wide and shallow.
    """

    def __init__(self, bounds: Float32, fanout: int = 64, most_roots: int = 1024) -> None:
        self._ids = _str_order(bounds, fanout)
        self._children = np.arange(fanout)
        self._levels = [np.ascontiguousarray(bounds[self._ids])]
        """Boxes of the segments in tree order, then of the nodes over each level."""
        while len(self._levels[-1]) > most_roots:
            below = self._levels[-1]
            starts = np.arange(0, len(below), fanout)
            low = np.minimum.reduceat(below[:, :3], starts)
            high = np.maximum.reduceat(below[:, 3:], starts)
            self._levels.append(np.hstack([low, high]))

    def within(self, centre: Sequence[float], radius_m: float) -> Int64:
        """Find every segment whose box comes within a radius; see ``SpatialIndex``.

        A node's distance is never above that of a box in it, rounding included: each step of
        ``box_distances_m`` is monotonic.
        """
        point = validate_query(centre, radius_m)
        found = np.arange(len(self._levels[-1]))
        for depth in range(len(self._levels) - 1, -1, -1):
            boxes = self._levels[depth]
            found = found[box_distances_m(boxes[found], point) <= radius_m]
            if depth:
                children = (found[:, np.newaxis] * len(self._children) + self._children).ravel()
                found = children[: np.searchsorted(children, len(self._levels[depth - 1]))]
        ids = self._ids[found].astype(np.int64)
        ids.sort()
        return ids


def _str_order(bounds: Float32, fanout: int) -> UInt32:
    """Ids in sort-tile-recursive order of the boxes' centres over x and z."""
    count = len(bounds)
    x, z = bounds[:, 0] + bounds[:, 3], bounds[:, 2] + bounds[:, 5]
    order = np.argsort(x, kind="stable")
    slices = max(1, math.ceil(math.sqrt(count / fanout)))
    size = fanout * max(1, math.ceil(count / slices / fanout))
    number = np.empty(count, dtype=np.uint32)
    number[order] = np.arange(count, dtype=np.uint32) // size
    return np.lexsort((z, number)).astype(np.uint32)
