"""Colours of a surface as means of small cubes of space: what a texel of that size shows of it.

A texel that takes the colour of the vertex next to it shows one of many: noise, which no mip takes
out again and which no codec packs. Means of cubes as wide as a texel are added up piece by piece,
so a surface of any size takes the memory of its image.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, Float32, Float64, Int64, UInt8
from terraport_pipeline.geometry.clouds.carry import carry_values

__all__ = ["CellColours", "ColourField"]

_AXIS_BITS: Final = 21
"""Bits of a cube's number along each axis; two million cubes are wider than any image."""


@dataclass(frozen=True, slots=True, eq=False)
class CellColours:
    """Sums over the vertices in each of N cubes."""

    key: Int64
    """(N,) number of the cube, ascending."""
    total: Float64
    """(N, 7) x, y, z, red, green, blue, and how many vertices."""

    @classmethod
    def of(cls, vertices: Float32, colours: UInt8, cell_m: float) -> CellColours:
        """Sum up a piece of surface.

        Parameters
        ----------
        vertices : ndarray of shape (V, 3), float32
            Metres.
        colours : ndarray of shape (V, 3), uint8
            sRGB.
        cell_m : float
            Side of the cubes, the same for all pieces.
        """
        half = 1 << (_AXIS_BITS - 1)
        cell = np.floor(vertices / np.float64(cell_m)).astype(np.int64) + half
        cell = np.clip(cell, 0, 2 * half - 1)
        key = (cell[:, 0] << 2 * _AXIS_BITS) | (cell[:, 1] << _AXIS_BITS) | cell[:, 2]
        count = np.ones((len(key), 1))
        return _summed(key, np.concatenate([vertices, colours, count], axis=1, dtype=np.float64))

    @classmethod
    def joined(cls, pieces: Iterable[CellColours]) -> CellColours:
        """Add up pieces; cubes that two of them share become one."""
        parts = list(pieces)
        return _summed(
            np.concatenate([part.key for part in parts]),
            np.concatenate([part.total for part in parts]),
        )


class ColourField:
    """Gives any place the colour of the surface near it.

    Parameters
    ----------
    cells : CellColours
        At least one.
    threads : int
        The result does not depend on it.

    Examples
    --------
    >>> places = np.array([[0.1, 0, 0], [0.3, 0, 0], [1.5, 0, 0]], np.float32)
    >>> colours = np.array([[10, 0, 0], [30, 0, 0], [90, 0, 0]], np.uint8)
    >>> field = ColourField(CellColours.of(places, colours, 1.0))
    >>> field(np.array([[0.2, 0, 0], [1.5, 0, 0]])).tolist()
    [[20, 0, 0], [90, 0, 0]]
    """

    def __init__(self, cells: CellColours, *, threads: int = 1) -> None:
        mean = cells.total[:, :6] / cells.total[:, 6:]
        self._colours: UInt8 = np.rint(mean[:, 3:]).astype(np.uint8)
        self._tree = cKDTree(mean[:, :3], balanced_tree=False)
        self._threads = threads

    def __call__(self, places: AnyFloat) -> UInt8:
        """Mix the colours of the four nearest cubes' means, by the inverse of their distance."""
        colours, _ = carry_values(self._tree, self._colours, {}, places, workers=self._threads)
        return colours


def _summed(key: Int64, rows: Float64) -> CellColours:
    unique, cell = np.unique(key, return_inverse=True)
    # One column at a time: bincount adds in the order of the rows, so equal input, equal sums.
    columns = [np.bincount(cell, rows[:, k], len(unique)) for k in range(rows.shape[1])]
    return CellColours(unique, np.stack(columns, axis=1))
