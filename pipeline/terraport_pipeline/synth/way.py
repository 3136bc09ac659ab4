"""The way that people walk and drive: from the site's edge along the haul road to the pit's floor.

Its middle line, as :mod:`.terrain` builds the road around it. Frame: design metres. PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64
from terraport_pipeline.synth.options import HALF_X, HALF_Y
from terraport_pipeline.synth.terrain import Terrain

__all__ = ["way_places"]

_FINE: Final = 2_000
"""Places of the line that lengths are summed over: less than half a metre apart."""


def way_places(terrain: Terrain, count: int) -> tuple[Float64, Float64, float]:
    """Choose places in the middle of equal pieces of the way.

    Parameters
    ----------
    terrain : Terrain
        Of the quarry.
    count : int
        Pieces, one or more.

    Returns
    -------
    places : ndarray of shape (count, 3), float64
        On the ground, from the site's edge downwards, design metres.
    headings : ndarray of shape (count, 2), float64
        Unit direction in plan, downwards.
    length : float
        Of a piece, design metres.
    """
    x, y = terrain.road_line(np.linspace(0.0, 1.0, _FINE))
    on_site = (np.abs(x) <= HALF_X) & (np.abs(y) <= HALF_Y)
    line = terrain.positions(x[on_site], y[on_site])
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    length = float(walked[-1]) / count

    def at(metres: AnyFloat) -> Float64:
        return np.stack([np.interp(metres, walked, axis) for axis in line.T], axis=1)

    middles = (np.arange(count, dtype=np.float64) + 0.5) * length
    along = at(middles + 1.0)[:, :2] - at(middles - 1.0)[:, :2]
    headings: Float64 = along / np.linalg.norm(along, axis=1, keepdims=True)
    return at(middles), headings, length
