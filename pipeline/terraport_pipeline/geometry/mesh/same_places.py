"""Vertices at one place, found: files repeat a vertex at every seam, STL at every face.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Float64, Int64

__all__ = ["same_places"]


def same_places(positions: Float64) -> tuple[Int64, Int64]:
    """Find vertices at the same place.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float64

    Returns
    -------
    first : ndarray of shape (W,), int64
        A vertex of every place, in the order in which places come first.
    number : ndarray of shape (V,), int64
        The place of every vertex.

    Examples
    --------
    >>> first, number = same_places(np.array([[5.0, 0, 0], [1, 0, 0], [5, 0, 0]]))
    >>> first.tolist(), number.tolist()
    ([0, 1], [0, 1, 0])
    """
    # + 0.0 makes -0.0 the same bytes as 0.0.
    rows = np.ascontiguousarray(positions + 0.0).view("V24").reshape(-1)
    _, first, number = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return first[order].astype(np.int64), rank[number.reshape(-1)]
