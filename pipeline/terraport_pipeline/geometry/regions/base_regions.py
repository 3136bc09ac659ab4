"""Regions of the base mesh, read off the detail that lies over it. PURE.

The base is seen before any detail is there: with its regions it can be coloured by them too.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float32, Int32, UInt16

__all__ = ["base_regions"]

_PAD_SHARE: Final = 0.25
"""A piece of detail is asked by base vertices so far around its box, of the box's longest side:
the base leaves the detail by far less, and two pieces must not both miss a vertex between them."""


def base_regions(
    vertices: Float32, pieces: Iterable[tuple[Float32, Int32, Int32]]
) -> UInt16 | None:
    """Give every vertex of the base the region of the face of the detail that is nearest to it.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3)
        The base's, metres.
    pieces : iterable of (vertices, faces of shape (F, 3), regions of shape (F,))
        The detail; read once, one piece in memory at a time. Vertices may be those of more than
        the piece.

    Returns
    -------
    ndarray of shape (V,), uint16, or None
        By the middles of the faces; of two equally near faces that of the earlier piece. A vertex
        that no piece is near to gets the region of the nearest one that has one. None without any
        face.
    """
    nearest_m = np.full(len(vertices), np.inf)
    found = np.zeros(len(vertices), np.uint16)
    # Along the longest axis, so that a piece looks at a strip of the base and not at all of it.
    axis = int(np.ptp(vertices, axis=0).argmax()) if len(vertices) else 0
    order = np.argsort(vertices[:, axis])
    along = vertices[order, axis]
    for corners, faces, regions in pieces:
        if len(faces) == 0:
            continue
        a, b, c = (corners[faces[:, k]] for k in range(3))
        middles = (a + b + c) / np.float32(3)
        low, high = middles.min(axis=0), middles.max(axis=0)
        pad = _PAD_SHARE * float((high - low).max())
        low, high = low - pad, high + pad
        first = np.searchsorted(along, low[axis], side="left")
        strip = order[first : np.searchsorted(along, high[axis], side="right")]
        near = strip[((vertices[strip] >= low) & (vertices[strip] <= high)).all(axis=1)]
        if len(near) == 0:
            continue
        distance_m, face = cKDTree(middles).query(vertices[near])
        closer = distance_m < nearest_m[near]
        nearest_m[near[closer]] = distance_m[closer]
        found[near[closer]] = regions[face[closer]]
    reached = np.isfinite(nearest_m)
    if not reached.any():
        return None
    if not reached.all():
        _, at = cKDTree(vertices[reached]).query(vertices[~reached])
        found[~reached] = found[reached][at]
    return found
