"""Where each chart lies in the atlas: skyline packing in cells of 8 texels.

Cells start and end at multiples of 8 texels, and a chart keeps 4 texels away from its cell's rim.
The full size and the first three mips below it then never mix two charts: a texel of mip 3 is 8
texels wide and lies in one cell, and a sample in the chart reaches half a texel of mip 3 beyond it,
4 texels.

This work is based on: J. Jylanki, "A Thousand Ways to Pack the Bin", 2010 (skyline, bottom-left),
with the skyline as an array of heights, one a column of cells.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64

__all__ = ["ALIGN", "GUTTER", "SMALLEST_CELL", "Atlas", "pack_charts"]

ALIGN: Final = 8
"""Texels: cells start and end at multiples of it. Mips 0 to log2(ALIGN) are free of bleeding."""

GUTTER: Final = ALIGN // 2
"""Texels between a chart and its cell's rim."""

SMALLEST_CELL: Final = 2 * ALIGN
"""Texels: side of the cell of a chart that has no size, its gutters rounded up."""

_SMALLEST_SIDE: Final = 16

_SHRINKS: Final = (1.0, 0.95, 0.9)
"""Rather 10 % coarser than twice the texture: sides are powers of two, so the next size up is half
empty."""

_STEP_DOWN: Final = 0.93
"""Factor from try to try once the largest texture is too small."""

_LEAST_SCALE: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """Size of an image, and the cell of each of C charts in it."""

    width: int
    height: int
    """Texels; powers of two."""
    scale: float
    """Every chart was scaled by this, at most 1."""
    cells: Int32
    """(C, 4) x, y, width, height of each chart's cell, texels."""
    turned: Bool
    """(C,) charts whose x and y are exchanged."""

    def to_texels(self, uvs: Float64, chart: Int32) -> Float64:
        """Turn coordinates within charts into texels of the image.

        Parameters
        ----------
        uvs : ndarray of shape (F, 3, 2), float64
            Texels from the chart's lower corner, before scaling.
        chart : ndarray of shape (F,), int32

        Returns
        -------
        ndarray of shape (F, 3, 2), float64
            Texels from the image's upper left corner; texel (i, j) has its centre at (i + 0.5,
            j + 0.5).
        """
        turned = self.turned[chart][:, None, None]
        inside = np.where(turned, uvs[:, :, ::-1], uvs) * self.scale
        return inside + (self.cells[chart, None, :2] + (GUTTER + 0.5))

    @property
    def use(self) -> float:
        """Share of the image that belongs to cells."""
        cells = self.cells.astype(np.int64)
        return float((cells[:, 2] * cells[:, 3]).sum()) / (self.width * self.height)


def pack_charts(sizes: Float64, *, max_side: int, scale: float = 1.0) -> Atlas:
    """Pack charts into the smallest image that holds them.

    Parameters
    ----------
    sizes : ndarray of shape (C, 2), float64
        Width and height of each chart in texels, finite, >= 0; C >= 1.
    max_side : int
        Longest side of the image, a power of two, >= 16.
    scale : float
        Scale to start with, at most 1.

    Returns
    -------
    Atlas
        Charts are scaled down together until they fit; by up to a tenth also where that saves half
        the image. Equal input, equal result.

    Raises
    ------
    ValueError
        A size is not finite, or there are so many charts that their gutters alone overflow the
        largest image.

    Examples
    --------
    >>> atlas = pack_charts(np.array([[50.0, 20.0], [20.0, 50.0]]), max_side=64)
    >>> atlas.width, atlas.height, atlas.cells.tolist(), atlas.turned.tolist()
    (64, 64, [[0, 0, 64, 32], [0, 32, 64, 32]], [False, True])
    """
    if len(sizes) == 0 or not (np.isfinite(sizes).all() and (sizes >= 0).all()):
        raise ValueError(f"{len(sizes)} charts, expected at least one, all of finite size")
    while scale > _LEAST_SCALE:
        for width, height in _image_sides(max_side):
            for shrink in _SHRINKS:
                packed = _try(sizes, scale * shrink, width, height)
                if packed is not None:
                    return packed
        scale *= _STEP_DOWN
    raise ValueError(f"{len(sizes)} charts, expected fewer: gutters alone overflow {max_side}^2")


def _image_sides(max_side: int) -> Iterator[tuple[int, int]]:
    """Squares and double squares by area; the wide one, since flat charts are laid down flat."""
    side = _SMALLEST_SIDE
    while side <= max_side:
        yield side, side
        if 2 * side <= max_side:
            yield 2 * side, side
        side *= 2


def _try(sizes: Float64, scale: float, width: int, height: int) -> Atlas | None:
    cells = (np.ceil(sizes * scale).astype(np.int64) + (1 + 2 * GUTTER) + ALIGN - 1) // ALIGN
    columns, rows = width // ALIGN, height // ALIGN
    turned = cells[:, 1] > cells[:, 0]
    flat = np.where(turned[:, None], cells[:, ::-1], cells)
    if int((flat[:, 0] * flat[:, 1]).sum()) > columns * rows:
        return None
    if int(flat[:, 0].max()) > columns or int(flat[:, 1].max()) > rows:
        return None
    # High ones first: the skyline stays level. Ties by width, then by number.
    order = np.lexsort((np.arange(len(flat)), -flat[:, 0], -flat[:, 1]))
    corners = np.zeros((len(flat), 2), np.int64)
    if not _skyline(flat, order, columns, rows, corners):
        return None
    placed = np.concatenate([corners, flat], axis=1) * ALIGN
    return Atlas(width, height, scale, placed.astype(np.int32), turned)


@numba.njit(cache=True, nogil=True)
def _skyline(
    cells: Int64,
    order: Int64,
    columns: int,
    rows: int,
    corners: Int64,
) -> bool:
    """Put each rectangle where its upper rim is lowest, then leftmost; False when one is left."""
    # Invariant: `height[c]` is the upper rim of what stands in column c; nothing lies above it,
    # so a rectangle at or above the highest rim of its columns overlaps none.
    height = np.zeros(columns, np.int64)
    for number in order:
        wide, high = cells[number, 0], cells[number, 1]
        best_top, best_x = rows + 1, -1
        x = 0
        while x + wide <= columns:
            ground = np.int64(0)
            highest = x
            for column in range(x, x + wide):
                if height[column] >= ground:
                    ground = height[column]
                    highest = column
            if ground + high < best_top:
                best_top, best_x = ground + high, x
            x = highest + 1  # until it is passed the ground cannot be lower
        if best_top > rows:
            return False
        corners[number, 0], corners[number, 1] = best_x, best_top - high
        height[best_x : best_x + wide] = best_top
    return True
