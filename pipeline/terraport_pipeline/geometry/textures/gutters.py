"""What lies around the charts of an atlas: filled from the charts themselves.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Int32, UInt8

__all__ = ["fill_cells"]


def fill_cells(image: UInt8, covered: UInt8, cells: Int32) -> None:
    """Fill what no face covers: gutters from their own charts, the rest with the mean colour.

    Parameters
    ----------
    image : ndarray of shape (H, W, 3), uint8
        Written to.
    covered : ndarray of shape (H, W), uint8
        1 where a face was drawn; 1 in all cells afterwards.
    cells : ndarray of shape (C, 4), int32
        x, y, width, height of each chart's cell.

    Notes
    -----
    Pull-push (S. J. Gortler et al., "The Lumigraph", 1996, section 3.4) within each cell: averages
    of 2 x 2 covered texels, again and again, until everything has one; then downwards into the
    gaps. Smooth, so it compresses to nothing, and a mip's texel in the gutter is the average that
    the mip would make of its chart alone.
    """
    for x, y, width, height in cells.tolist():
        _fill_cell(image, covered, x, y, width, height)
    inside = covered.astype(bool)
    if not inside.all():
        image[~inside] = np.rint(image[inside].mean(axis=0)) if inside.any() else 128


@numba.njit(cache=True, nogil=True)
def _fill_cell(
    image: UInt8, covered: UInt8, left: int, upper: int, width: int, height: int
) -> None:
    # (1) How often the cell can be halved until one texel is left.
    levels = 1
    side = max(width, height)
    while side > 1:
        side = (side + 1) // 2
        levels += 1
    if levels == 1:
        return
    # All levels in one array; level 0 is the image itself.
    starts = np.zeros(levels + 1, np.int64)
    sides = np.zeros((levels, 2), np.int64)
    w, h = width, height
    for level in range(levels):
        sides[level, 0], sides[level, 1] = w, h
        starts[level + 1] = starts[level] + (w * h if level else 0)
        w, h = (w + 1) // 2, (h + 1) // 2
    value = np.zeros((starts[levels], 3), np.float32)
    filled = np.zeros(starts[levels], np.uint8)
    # (2) Upwards: each texel is the mean of the covered ones of its four children. Invariant: a
    # texel is filled exactly where something below it is covered.
    for level in range(1, levels):
        fine_w, fine_h = sides[level - 1]
        for j in range(sides[level, 1]):
            for i in range(sides[level, 0]):
                r = g = b = np.float32(0.0)
                n = np.float32(0.0)
                for jj in range(2 * j, min(2 * j + 2, fine_h)):
                    for ii in range(2 * i, min(2 * i + 2, fine_w)):
                        if level == 1:
                            if covered[upper + jj, left + ii]:
                                r += image[upper + jj, left + ii, 0]
                                g += image[upper + jj, left + ii, 1]
                                b += image[upper + jj, left + ii, 2]
                                n += np.float32(1.0)
                        else:
                            fine = starts[level - 1] + jj * fine_w + ii
                            if filled[fine]:
                                r += value[fine, 0]
                                g += value[fine, 1]
                                b += value[fine, 2]
                                n += np.float32(1.0)
                if n > 0:
                    texel = starts[level] + j * sides[level, 0] + i
                    value[texel, 0], value[texel, 1], value[texel, 2] = r / n, g / n, b / n
                    filled[texel] = 1
    # (3) Downwards: unfilled texels take their parent's colour, so every level is full before the
    # next.
    if not filled[starts[levels - 1]]:
        return  # nothing at all in this cell
    for level in range(levels - 2, 0, -1):
        for j in range(sides[level, 1]):
            for i in range(sides[level, 0]):
                texel = starts[level] + j * sides[level, 0] + i
                if not filled[texel]:
                    parent = starts[level + 1] + (j // 2) * sides[level + 1, 0] + i // 2
                    for k in range(3):
                        value[texel, k] = value[parent, k]
    # (4) The image: only texels that no chart drew.
    for j in range(height):
        for i in range(width):
            if not covered[upper + j, left + i]:
                parent = starts[1] + (j // 2) * sides[1, 0] + i // 2
                for k in range(3):
                    image[upper + j, left + i, k] = np.uint8(value[parent, k] + np.float32(0.5))
                covered[upper + j, left + i] = 1
