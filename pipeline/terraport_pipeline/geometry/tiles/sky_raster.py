"""How high the survey reaches over every place: what a tile is told of what lies above its box.

Whether a sample faces the sky is seen from above (:mod:`terraport_pipeline.geometry.clouds.signs`),
and a brow may hang over it from the tile above. Without it a tile in the middle of a highwall takes
its own highest samples for the ones under the sky.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import Float32, Float64, Int64
from terraport_pipeline.geometry.tiles.tile_plan import TilePlan

__all__ = ["SkyRaster"]

_COLUMN_CELLS = 2
"""Width of a column: more than a cell, so that few in covered ground are empty."""

_MAX_COLUMNS = 2**26
"""Wider columns where there would be more: 256 MB."""


class SkyRaster:
    """Highest sample of every column over a plan's tiles; see the module's text.

    Parameters
    ----------
    plan : TilePlan
    """

    def __init__(self, plan: TilePlan) -> None:
        self._plan = plan
        cores = np.array(plan.offset) + plan.indices * plan.shape.core
        low = np.floor(cores.min(axis=0) - plan.shape.margin).astype(np.int64)[[0, 2]]
        high = np.ceil(cores.max(axis=0) + plan.shape.core + plan.shape.margin)[[0, 2]]
        size = high.astype(np.int64) - low
        width = _COLUMN_CELLS
        while np.prod(-(-size // width)) > _MAX_COLUMNS:
            width *= 2
        self._low: Int64 = low
        self._width = width
        self._height_cells: Float32 = np.full(-(-size // width), -np.inf, dtype=np.float32)

    def add(self, cells: Float64) -> None:
        """Raise the columns of samples (N, 3), in cells of the lattice."""
        column = np.floor((cells[:, [0, 2]] - self._low) / self._width).astype(np.int64)
        inside = ((column >= 0) & (column < self._height_cells.shape)).all(axis=1)
        i, j = column[inside].T
        np.maximum.at(self._height_cells, (i, j), cells[inside, 1].astype(np.float32))

    def above(self, tile: int) -> Float32:
        """Return what hides the sky of a tile's data box: (R, 3) places in cells, a cell apart.

        Relative to the low corner of the tile's core.
        """
        low, high = self._plan.data(tile)
        first = np.floor((low[[0, 2]] - self._low) / self._width).astype(np.int64)
        last = np.ceil((high[[0, 2]] - self._low) / self._width).astype(np.int64)
        window = self._height_cells[first[0] : last[0], first[1] : last[1]]
        i, j = np.nonzero(window > high[1])
        corner = (np.stack([i, j], axis=1) + first) * self._width + self._low
        steps = np.arange(self._width) + 0.5
        offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        places = (corner[:, None] + offsets[None]).reshape(-1, 2)
        heights = np.repeat(window[i, j].astype(np.float64), len(offsets))
        above = np.stack([places[:, 0], heights, places[:, 1]], axis=1)
        return (above - self._plan.core(tile)[0]).astype(np.float32)
