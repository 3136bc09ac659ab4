"""How far a point is from boxes: what "within the radius" means, to the last bit.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from terraport_payload.types import Float32, Float64

__all__ = ["box_distances_m"]


def box_distances_m(bounds: Float32, centre: Sequence[float] | Float64) -> Float64:
    """Distance from a point to axis-aligned boxes, rounded as the specification has it.

    Parameters
    ----------
    bounds : ndarray of shape (N, 6), float32
        x, y, z minimum, x, y, z maximum, metres.
    centre : sequence of 3 floats
        Metres, the same frame.

    Returns
    -------
    ndarray of shape (N,), float64
        Metres; 0 inside a box or on its surface.

    Notes
    -----
    Order of the sum, float64 throughout and no fused multiply-add: ``spec/protocol.md``,
    section 4, rule 1. A client that computes a plan by itself gets the same ids in the same order.

    Examples
    --------
    >>> boxes = np.array([[0, 0, 0, 1, 1, 1], [4, 5, 0, 9, 9, 1]], dtype=np.float32)
    >>> box_distances_m(boxes, (1.0, 1.0, 1.0)).tolist()
    [0.0, 5.0]
    """
    point = np.asarray(centre, dtype=np.float64)
    wide = bounds.astype(np.float64)
    gap = wide[:, :3] - point
    np.maximum(gap, point - wide[:, 3:], out=gap)
    np.maximum(gap, 0.0, out=gap)
    gap *= gap
    distances: Float64 = gap[:, 0] + gap[:, 1]
    distances += gap[:, 2]
    return np.sqrt(distances, out=distances)
