"""Sums of a survey's samples in small cubes: all that two surveys of one ground are compared by.

Space is cut into cubes, a few spacings wide, whose walls are those of the blocks that the tiles
count in. Of the samples in each there are kept: how many, sums of their coordinates and of the
products of these, sums of their colours, and which of its 64 voxels hold any. Sums are whole
numbers, so they do not depend on the order of the samples: coordinates count in ticks, 256 of them
across a cube (a fiftieth of a spacing), and colours in levels.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64, Int32, Int64, UInt8, UInt64

__all__ = [
    "COLOUR",
    "COUNT",
    "KEY_BITS",
    "MEAN",
    "PRODUCT",
    "SQUARE",
    "TICKS",
    "GroundSums",
    "cell_keys",
    "coarser_keys",
    "key_indices",
]

TICKS: Final = 256
"""Across a cube; a coordinate counts from the cube's middle, -128 to 127."""

KEY_BITS: Final = 21
"""Of a key, per axis; half of the indices are negative."""

_HALF: Final = 1 << (KEY_BITS - 1)

COUNT: Final = 0
MEAN: Final = 1
"""Columns of the sums: x, y, z from here."""
PRODUCT: Final = 4
"""xx, yy, zz, xy, xz, yz from here."""
COLOUR: Final = 10
"""Red, green, blue from here."""
SQUARE: Final = 13
"""Sum of the squares of all three, in units of 16."""
_COLUMNS: Final = 14

_MOST: Final = 100_000
"""Samples of a cube that are summed, at most: a 32-bit sum of squares holds 128 thousand. Some 20
are usual, so this is a survey with a sample on every tenth of a millimetre."""


def cell_keys(cells: Float64) -> Int64:
    """Compute the key of the cube that each position lies in.

    Parameters
    ----------
    cells : ndarray of shape (N, 3), float64
        Positions in widths of a cube. Those beyond a million count as in the outermost cubes.

    Returns
    -------
    ndarray of shape (N,), int64
        Ordered by x, then y, then z. A key may be moved by one cube along each axis.

    Examples
    --------
    >>> keys = cell_keys(np.array([[-0.5, 0.0, 7.2]]))
    >>> key_indices(keys).tolist()
    [[-1, 0, 7]]
    """
    index = np.clip(np.floor(cells), 1 - _HALF, _HALF - 2).astype(np.int64) + _HALF
    keys: Int64 = (((index[:, 0] << KEY_BITS) | index[:, 1]) << KEY_BITS) | index[:, 2]
    return keys


def key_indices(keys: Int64) -> Int64:
    """Return the indices (K, 3) of cubes along x, y, z."""
    low = (1 << KEY_BITS) - 1
    axes = (keys >> (2 * KEY_BITS), (keys >> KEY_BITS) & low, keys & low)
    indices: Int64 = np.stack(axes, axis=1) - _HALF
    return indices


def coarser_keys(keys: Int64) -> Int64:
    """Return the sorted keys of cubes twice as wide that hold those given."""
    index = (key_indices(keys) >> 1) + _HALF
    packed = (((index[:, 0] << KEY_BITS) | index[:, 1]) << KEY_BITS) | index[:, 2]
    return np.unique(packed)


@dataclass(frozen=True, slots=True, eq=False)
class GroundSums:
    """One survey's sums in the cubes of a list; 64 bytes for each."""

    sums: Int32
    """(K, 14): see the columns' names above."""
    voxels: UInt64
    """(K,) bit 16 x + 4 y + z is set where voxel (x, y, z) of the 4 x 4 x 4 holds a sample."""

    @classmethod
    def empty(cls, count: int) -> GroundSums:
        """Sums of no samples in so many cubes."""
        return cls(np.zeros((count, _COLUMNS), np.int32), np.zeros(count, np.uint64))

    def add(self, cells: Float64, rows: Int64, colours: UInt8 | None) -> None:
        """Add samples; in any order, the result is the same.

        Parameters
        ----------
        cells : ndarray of shape (N, 3), float64
            Positions in widths of a cube.
        rows : ndarray of shape (N,), int64
            Of the cubes that they lie in.
        colours : ndarray of shape (N, 3), uint8, optional
        """
        painted = np.zeros((0, 3), np.uint8) if colours is None else colours
        _add(cells, rows, painted, self.sums, self.voxels)


@numba.njit(cache=True, nogil=True)
def _add(
    cells: Float64, rows: Int64, colours: UInt8, sums: Int32, voxels: UInt64
) -> None:  # pragma: no cover - compiled
    for sample in range(len(rows)):
        into = sums[rows[sample]]
        voxel = 0
        x = y = z = 0
        for axis in range(3):
            share = cells[sample, axis] - np.floor(cells[sample, axis])
            tick = min(int(share * TICKS), TICKS - 1)
            voxel = 4 * voxel + tick * 4 // TICKS
            x, y, z = y, z, tick - TICKS // 2
        voxels[rows[sample]] |= np.uint64(1) << np.uint64(voxel)
        if into[COUNT] >= _MOST:
            continue
        into[COUNT] += 1
        into[MEAN] += x
        into[MEAN + 1] += y
        into[MEAN + 2] += z
        into[PRODUCT] += x * x
        into[PRODUCT + 1] += y * y
        into[PRODUCT + 2] += z * z
        into[PRODUCT + 3] += x * y
        into[PRODUCT + 4] += x * z
        into[PRODUCT + 5] += y * z
        if len(colours):
            square = 0
            for channel in range(3):
                level = int(colours[sample, channel])
                into[COLOUR + channel] += level
                square += level * level
            into[SQUARE] += square // 16
