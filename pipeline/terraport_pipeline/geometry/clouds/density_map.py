"""How densely a survey covers its ground, seen from above: a raster of samples per area.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import ndimage

from terraport_payload.types import Bool, Float64, Int64

__all__ = ["DensityMap", "Gap", "count_samples", "draw_text", "find_gaps", "widened"]

_SHADES: Final = " ░▒▓█"
"""Nothing, then quarters of the dense end's density."""

_DENSE_PERCENTILE: Final = 95
"""Density of the darkest shade: a few cells of walls and overlaps do not set it."""

_ALL_AROUND: Final = np.ones((3, 3), bool)


@dataclass(frozen=True, slots=True, eq=False)
class DensityMap:
    """Samples per cell of a raster; row 0 is the northernmost."""

    counts: Int64
    """(rows, columns)"""
    west: float
    north: float
    """Corner of the cell (0, 0), CRS frame."""
    cell_m: float

    @property
    def occupied(self) -> Bool:
        """Cells with a sample."""
        cells: Bool = self.counts > 0
        return cells

    @property
    def area_m2(self) -> float:
        """Ground with samples, in whole cells."""
        return float(self.occupied.sum()) * self.cell_m**2

    @property
    def effective_m2(self) -> float:
        """Ground that as many samples would cover as evenly as most of them lie.

        The square of their sum over the sum of squares: a few that are spread thinly over other
        cells hardly count.
        """
        counts = self.counts.astype(np.float64)
        squares = float((counts**2).sum())
        return float(counts.sum()) ** 2 / squares * self.cell_m**2 if squares else 0.0

    @property
    def inner(self) -> Bool:
        """Cells with samples whose neighbours all have some: of these density is meant."""
        cells: Bool = ndimage.binary_erosion(self.occupied, _ALL_AROUND)
        return cells if cells.any() else self.occupied


@dataclass(frozen=True, slots=True)
class Gap:
    """Ground without samples that samples lie all around."""

    area_m2: float
    east: float
    north: float
    """A place within it, CRS frame."""


def count_samples(
    blocks: Iterable[Float64], low: Float64, high: Float64, cell_m: float
) -> DensityMap:
    """Count samples per cell.

    Parameters
    ----------
    blocks : iterable of ndarray of shape (n, 3), float64
        Samples, CRS frame; what lies outside the box is left out.
    low, high : ndarray of shape (3,), float64
        Corners of the box.
    cell_m : float
        Side of a cell.
    """
    columns, rows = (max(1, math.ceil((high[axis] - low[axis]) / cell_m)) for axis in (0, 1))
    counts = np.zeros(rows * columns, np.int64)
    for points in blocks:
        column = np.floor((points[:, 0] - low[0]) / cell_m)
        row = np.floor((high[1] - points[:, 1]) / cell_m)
        # The southern and the eastern rim belong to the last cells.
        column[(column == columns) & (points[:, 0] <= high[0])] = columns - 1
        row[(row == rows) & (points[:, 1] >= low[1])] = rows - 1
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        keys = (row[inside] * columns + column[inside]).astype(np.int64)
        counts += np.bincount(keys, minlength=len(counts))
    return DensityMap(counts.reshape(rows, columns), float(low[0]), float(high[1]), cell_m)


def widened(fine: DensityMap, factor: int) -> DensityMap:
    """Join cells of a map, `factor` along each side."""
    rows, columns = fine.counts.shape
    padded = np.pad(fine.counts, ((0, -rows % factor), (0, -columns % factor)))
    blocks = padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor)
    return DensityMap(blocks.sum(axis=(1, 3)), fine.west, fine.north, fine.cell_m * factor)


def find_gaps(density: DensityMap, least_cells: int) -> list[Gap]:
    """Find ground without samples that samples lie all around, largest first.

    Parameters
    ----------
    density : DensityMap
        Its cells several spacings wide, or chance leaves some empty.
    least_cells : int
        Smaller gaps are not told.
    """
    empty = ~density.occupied
    labels, count = ndimage.label(empty)
    if not count:
        return []
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    # What touches the rim is outside.
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    sizes[np.unique(rim)] = 0
    sizes[0] = 0
    gaps = []
    for label in np.argsort(-sizes, kind="stable"):
        if sizes[label] < max(least_cells, 1):
            break
        # Of its cells the one in the middle of their list: within it, whatever its shape.
        row, column = (axis[len(axis) // 2] for axis in np.nonzero(labels == label))
        gaps.append(
            Gap(
                float(sizes[label]) * density.cell_m**2,
                density.west + (float(column) + 0.5) * density.cell_m,
                density.north - (float(row) + 0.5) * density.cell_m,
            )
        )
        if len(gaps) == 20:
            break
    return gaps


def draw_text(density: DensityMap) -> list[str]:
    """Draw a map with four shades of block characters, a line for two rows of its cells.

    Characters are twice as high as wide, so rows are taken two by two.

    Examples
    --------
    >>> counts = np.array([[0, 4, 1], [0, 4, 1]])
    >>> draw_text(DensityMap(counts, 0.0, 2.0, 1.0))
    [' █░']
    """
    counts = density.counts
    if len(counts) % 2:
        counts = np.vstack([counts, counts[-1:]])
    pairs = (counts[0::2] + counts[1::2]) / 2.0
    if not pairs.any():
        return [" " * pairs.shape[1]] * len(pairs)
    dense = max(float(np.percentile(pairs[pairs > 0], _DENSE_PERCENTILE)), 1e-9)
    shade = np.where(pairs > 0, np.clip(np.rint(4.0 * pairs / dense), 1, 4), 0).astype(int)
    return ["".join(_SHADES[value] for value in row) for row in shade]
