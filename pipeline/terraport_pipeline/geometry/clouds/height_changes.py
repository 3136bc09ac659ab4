"""How far the ground's height changed where it last did: what the detail's vertices say of it.

Space is cut into columns as high as a block of the lattice and a fraction of one wide; a table has
the height difference of every column in which a survey found ground that moved beyond doubt. A
later survey adds its columns and replaces those that it finds moved again; all others stay, so what
a tile's vertices get changes only where the tile's ground did.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import xxhash

from terraport_payload import AttributeScale
from terraport_payload.types import Bool, Float32, Float64, Int64
from terraport_pipeline.geometry.clouds.change_raster import ChangeRaster
from terraport_pipeline.geometry.clouds.ground_cells import cell_keys, key_indices

__all__ = ["HEIGHT_CHANGE", "HEIGHT_CHANGE_SCALE", "HeightChanges"]

HEIGHT_CHANGE: Final = "height_change_m"
"""Name of the attribute."""

HEIGHT_CHANGE_SCALE: Final = AttributeScale(-256.0, 2.0**-7)
"""In steps of 8 mm, a third of what two good surveys tell apart; up to 256 m, more than any bench.
Fixed: a scale by the range would give every payload other bytes with the next pit."""

_GREATEST_M: Final = 255.98
"""Farther differences have no code and are left without a value: no ground moves so far."""

_COLUMNS_AT_ONCE: Final = 1 << 21
"""Looked up in the raster at once: some 100 bytes each."""


@dataclass(frozen=True, slots=True, eq=False)
class HeightChanges:
    """Height differences by column; 12 bytes each."""

    per_block: int
    """Columns along a block."""
    keys: Int64
    """(N,) of the columns, sorted: :func:`.cell_keys` of x and z in widths of a column, y in
    blocks."""
    dz_m: Float32
    """(N,) new height less old; NaN where one of the surveys had no ground to compare."""

    @classmethod
    def none(cls, per_block: int) -> HeightChanges:
        """Make the table of ground that never changed."""
        return cls(per_block, np.zeros(0, np.int64), np.zeros(0, np.float32))

    def renewed(self, raster: ChangeRaster, cube_columns: int, blocks: Int64) -> HeightChanges:
        """Take in what a survey found.

        Parameters
        ----------
        raster : ChangeRaster
        cube_columns : int
            Columns along a cube, in widths of which the raster's corner is given.
        blocks : ndarray of shape (C, 3), int64
            Indices of the blocks whose samples were renewed.

        Returns
        -------
        HeightChanges
            With a column in each of these blocks where the raster says that the ground moved.
        """
        keys, steps_m = [self.keys], [self.dz_m]
        for some, dz_m in self._moved_columns(raster, cube_columns, blocks):
            keys.append(some)
            steps_m.append(dz_m)
        # The last of equal keys stands: a survey's own columns are distinct, and follow the old.
        every, rows = np.unique(np.concatenate(keys)[::-1], return_index=True)
        return HeightChanges(self.per_block, every, np.concatenate(steps_m)[::-1][rows])

    def within(self, low: Float64, high: Float64) -> HeightChanges:
        """Take the columns that reach into a box, and none that only touch it.

        Parameters
        ----------
        low, high : ndarray of shape (3,), float64
            Corners, in widths of a block.
        """
        index = key_indices(self.keys)
        wide = np.array([self.per_block, 1, self.per_block])
        first, last = np.floor(np.asarray(low) * wide), np.ceil(np.asarray(high) * wide) - 1
        rows = ((index >= first) & (index <= np.maximum(first, last))).all(axis=1)
        return HeightChanges(self.per_block, self.keys[rows], self.dz_m[rows])

    def digest(self) -> str:
        """Hash of the table, for keys."""
        digest = xxhash.xxh3_128(str(self.per_block).encode())
        digest.update(np.ascontiguousarray(self.keys).data)
        digest.update(np.ascontiguousarray(self.dz_m).data)
        return digest.hexdigest()

    def at(self, positions: Float64) -> Float32:
        """Interpolate the height differences at positions.

        Parameters
        ----------
        positions : ndarray of shape (V, 3), float64
            In widths of a block, from the lattice's anchor.

        Returns
        -------
        ndarray of shape (V,), float32
            Bilinear between the middles of the columns that have a value; NaN in a column that has
            none, and where the difference is beyond :data:`HEIGHT_CHANGE_SCALE`.
        """
        wide = positions * np.array([self.per_block, 1.0, self.per_block])
        level = self._levels(wide)
        # (1) The four columns about each position; the one that it lies in is among them.
        x, z = wide[:, 0] - 0.5, wide[:, 2] - 0.5
        low_x, low_z = np.floor(x), np.floor(z)
        total = np.zeros(len(wide))
        weights = np.zeros(len(wide))
        for step_x, step_z in itertools.product((0, 1), repeat=2):
            dz_m = self._look_up(low_x + step_x, level, low_z + step_z)
            weight = np.abs(1 - step_x - (x - low_x)) * np.abs(1 - step_z - (z - low_z))
            weight[np.isnan(dz_m)] = 0.0
            total += weight * np.nan_to_num(dz_m)
            weights += weight
        # (2) No value is drawn out beyond the columns that have one.
        own = self._look_up(np.floor(wide[:, 0]), level, np.floor(wide[:, 2]))
        with np.errstate(invalid="ignore"):
            mean = np.where(np.isnan(own), np.nan, total / weights)
        mean[np.abs(mean) > _GREATEST_M] = np.nan
        return mean.astype(np.float32)

    def _moved_columns(
        self, raster: ChangeRaster, cube_columns: int, blocks: Int64
    ) -> Iterator[tuple[Int64, Float32]]:
        """Yield keys and differences of the columns of some blocks where the ground moved."""
        p = self.per_block
        # Widths of a column: a raster's cells are wider by a power of two, and aligned with them.
        cell = round(raster.cell_m / raster.cube_m) * cube_columns
        corner = [round(side) * cube_columns // cell for side in raster.low]
        x, z = (axis.ravel() for axis in np.meshgrid(np.arange(p), np.arange(p), indexing="ij"))
        at_once = max(1, _COLUMNS_AT_ONCE // (p * p))
        for begin in range(0, len(blocks), at_once):
            some = blocks[begin : begin + at_once]
            column_x = (some[:, 0, None] * p + x).ravel()
            column_z = (some[:, 2, None] * p + z).ravel()
            i, j = column_x // cell - corner[0], column_z // cell - corner[1]
            nx, nz = raster.moved.shape
            rows = np.flatnonzero((i >= 0) & (i < nx) & (j >= 0) & (j < nz))
            rows = rows[raster.moved[i[rows], j[rows]]]
            level = np.repeat(some[:, 1], p * p)
            index = np.stack([column_x[rows], level[rows], column_z[rows]], axis=1)
            yield cell_keys(index.astype(np.float64)), raster.dz_m[i[rows], j[rows]]

    def _levels(self, wide: Float64) -> Float64:
        """Choose the block along y: the next one where the surface just leaves a block's samples.

        Samples lie within a column's width of their surface, and a block without samples has no
        columns.
        """
        level = np.floor(wide[:, 1])
        x, z = np.floor(wide[:, 0]), np.floor(wide[:, 2])
        missing = ~self._has(x, level, z)
        near = 1.0 / self.per_block
        for step, close in (
            (-1.0, wide[:, 1] - level < near),
            (1.0, level + 1.0 - wide[:, 1] < near),
        ):
            moves = missing & close & self._has(x, level + step, z)
            level[moves] += step
            missing &= ~moves
        return level

    def _has(self, x: Float64, y: Float64, z: Float64) -> Bool:
        return self._rows(x, y, z) >= 0

    def _look_up(self, x: Float64, y: Float64, z: Float64) -> Float32:
        rows = self._rows(x, y, z)
        dz_m: Float32 = np.full(len(rows), np.nan, np.float32)
        dz_m[rows >= 0] = self.dz_m[rows[rows >= 0]]
        return dz_m

    def _rows(self, x: Float64, y: Float64, z: Float64) -> Int64:
        """Rows of columns; -1 for those that are not in the table."""
        keys = cell_keys(np.stack([x, y, z], axis=1))
        rows: Int64 = np.searchsorted(self.keys, keys).astype(np.int64)
        rows[rows == len(self.keys)] = -1
        present = rows >= 0
        rows[present] = np.where(self.keys[rows[present]] == keys[present], rows[present], -1)
        return rows
