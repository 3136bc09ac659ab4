"""R-tree over segment bounds: a few flat arrays, packed once and searched with NumPy.

A scene's segments never change while it is open, so the tree needs no inserts: every 64 neighbours
are a node, every 64 nodes a node of the level above. A query tests one level after the other as
arrays. Why not the package ``rtree``: ``docs/decisions/spatial-index.md``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import Float32, Float64, Int64, UInt32

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
        Maximum number of boxes that are tested without a level above them.

    References
    ----------
    A. Guttman, "R-trees: a dynamic index structure for spatial searching", SIGMOD 1984; S. T.
    Leutenegger, M. A. Lopez, J. Edgington, "STR: a simple and efficient algorithm for R-tree
    packing", ICDE 1997. Tiles are cut over x and z only: ground is wide and shallow.

    Examples
    --------
    >>> bounds = np.array([[0, 0, 0, 1, 1, 1], [5, 0, 0, 6, 1, 1]], dtype=np.float32)
    >>> PackedRTree(bounds).within((0.0, 0.0, 0.0), 5.0).tolist()
    [0, 1]
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

        Notes
        -----
        A node's distance is never above that of a box in it, rounding included: each step of
        ``box_distances_m`` is monotonic.
        """
        point = _checked_point(centre, radius_m)
        nodes = np.arange(len(self._levels[-1]))
        for depth in range(len(self._levels) - 1, -1, -1):
            boxes = self._levels[depth]
            nodes = nodes[box_distances_m(boxes[nodes], point) <= radius_m]
            if depth:
                children = (nodes[:, np.newaxis] * len(self._children) + self._children).ravel()
                nodes = children[: np.searchsorted(children, len(self._levels[depth - 1]))]
        return np.sort(self._ids[nodes]).astype(np.int64)


def _checked_point(centre: Sequence[float], radius_m: float) -> Float64:
    """Return the centre as an array; ValueError where it or the radius is not usable."""
    point = np.asarray(centre, dtype=np.float64)
    if point.shape != (3,) or not bool(np.isfinite(point).all()):
        raise ValueError(f"centre is {centre!r}, expected three finite numbers")
    if not (math.isfinite(radius_m) and radius_m >= 0):
        raise ValueError(f"radius_m is {radius_m!r}, expected a finite number >= 0")
    return point


def _str_order(bounds: Float32, fanout: int) -> UInt32:
    """Return the ids in sort-tile-recursive order of the boxes' centres over x and z."""
    count = len(bounds)
    x, z = bounds[:, 0] + bounds[:, 3], bounds[:, 2] + bounds[:, 5]
    order = np.argsort(x, kind="stable")
    slices = max(1, math.ceil(math.sqrt(count / fanout)))
    size = fanout * max(1, math.ceil(count / slices / fanout))
    number = np.empty(count, dtype=np.uint32)
    number[order] = np.arange(count, dtype=np.uint32) // size
    return np.lexsort((z, number)).astype(np.uint32)
