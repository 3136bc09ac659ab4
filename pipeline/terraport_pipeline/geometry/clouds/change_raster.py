"""Height differences between two surveys as seen from above, and the volumes between them.

In each cell of a raster a plane is fitted to either survey's samples, and the heights of both at
the cell's middle are compared: they are the mean heights, wherever in the cell the samples lie. The
level of detection is that of M3C2 (see :mod:`.ground_distance`), along the vertical. Walls and
trees scatter widely about a plane, so their level is high.

Volumes are those of cells whose ground moved beyond doubt, and of the cells that touch them,
whether or not each passes its level of detection: what is left out at the toe of a pile by a
threshold for each cell is missing (2 % of a pit of ten metres in cells of two), while errors of
single cells cancel out.

References
----------
S. W. Anderson, "Uncertainty in quantitative analyses of topographic change: error propagation and
the role of thresholding", Earth Surface Processes and Landforms 44, 2019, doi:10.1002/esp.4551.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

from terraport_payload.types import Bool, Float32, Float64, Int64
from terraport_pipeline.geometry.clouds.ground_cells import (
    TICKS,
    GroundSums,
    axis_indices,
    cell_keys,
    key_indices,
)
from terraport_pipeline.geometry.clouds.ground_change import GroundScale
from terraport_pipeline.geometry.volumes.volume_error import CONFIDENCE

__all__ = ["MAX_RASTER_CELLS", "ChangeRaster", "make_raster"]

MAX_RASTER_CELLS: Final = 1 << 22
"""Cells at most, nine bytes each; wider ones are taken beyond it."""

_LEAST: Final = 5
"""Samples of each survey in a cell whose heights are compared: three make the plane. Fewer than
decide of a change, as a cell left out is missing from the volumes."""

_RIDGE: Final = 64.0
"""Ticks squared, added to the variance of the places: samples in a row have no slope across it."""

_AT_ONCE: Final = 1 << 17
"""Cells that are summed at once: 160 bytes each."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeRaster:
    """A raster over x and z; heights in metres."""

    low: tuple[float, float]
    """x and z of the corner of cell (0, 0), widths of a cube from the lattice's anchor."""
    cube_m: float
    """Width of a cube."""
    cell_m: float
    dz_m: Float32
    """(nx, nz) new mean height less old; NaN where one survey has fewer than a few samples."""
    lod_m: Float32
    """(nx, nz) level of detection at 95 %; NaN there."""
    moved: Bool
    """(nx, nz) holds ground that moved beyond doubt, or touches a cell that does."""
    only: tuple[int, int]
    """Such cells where the first survey alone has samples, and the second alone."""


def make_raster(
    keys: Int64, before: GroundSums, after: GroundSums, moved: Bool, scale: GroundScale
) -> ChangeRaster:
    """Look at the cubes of two surveys from above.

    Parameters
    ----------
    keys : ndarray of shape (K,), int64
        Of the cubes, sorted: y up.
    before, after : GroundSums
        Exchanged, they change the sign of the heights.
    moved : ndarray of shape (K,), bool
        Cubes where the ground lies elsewhere, is gone or is new.
    scale : GroundScale

    Returns
    -------
    ChangeRaster
        Cells as wide as a cube, or a power of two of that. It covers the cubes with samples enough
        to be compared: lone points far away do not widen it.
    """
    # (1) The box, and cells that keep it within bounds.
    weighty = before.sums[:, 0] + after.sums[:, 0] >= _LEAST
    x0, nx, z0, nz, factor = _box(keys[weighty] if weighty.any() else keys)
    del weighty
    near_moved = np.zeros((nx, nz), dtype=bool)
    x, z = (axis_indices(keys[moved], axis) // factor for axis in (0, 2))
    inside = (x >= x0) & (x < x0 + nx) & (z >= z0) & (z < z0 + nz)
    near_moved[x[inside] - x0, z[inside] - z0] = True
    near_moved = binary_dilation(near_moved, np.ones((3, 3), dtype=bool))
    # (2) Rows of cells at a time; cubes are ordered by x, so theirs follow each other.
    dz_m = np.full((nx, nz), np.nan, np.float32)
    lod_m = np.full((nx, nz), np.nan, np.float32)
    only = np.zeros(2, np.int64)
    rows_at_once = max(1, _AT_ONCE // nz)
    height = int(axis_indices(keys[len(keys) // 2 :][:1], 1)[0])
    for row in range(0, nx, rows_at_once):
        last = min(row + rows_at_once, nx)
        walls = np.array([[(x0 + edge) * factor, -np.inf, -np.inf] for edge in (row, last)])
        begin, end = np.searchsorted(keys, cell_keys(walls))
        index = key_indices(keys[begin:end])
        i, j = index[:, 0] // factor - x0, index[:, 2] // factor - z0
        within = (j >= 0) & (j < nz)
        cubes, cell = np.flatnonzero(within) + begin, ((i - row) * nz + j)[within]
        middle = np.stack([(i + x0) * factor, np.full(len(i), height), (j + z0) * factor], axis=1)
        offset = (index - middle - np.array([1, 0, 1]) * ((factor - 1) / 2))[within] * TICKS
        first = _cell_sums(before, cubes, cell, offset, (last - row) * nz)
        second = _cell_sums(after, cubes, cell, offset, (last - row) * nz)
        both = np.flatnonzero((first[:, 0] >= _LEAST) & (second[:, 0] >= _LEAST))
        tick_m = scale.width_m / TICKS
        old, new = (_heights(sums[both], scale.noise_m / tick_m) for sums in (first, second))
        dz_m[row:last].reshape(-1)[both] = (new[0] - old[0]) * tick_m
        error_m = np.sqrt(new[1] + old[1]) * tick_m
        lod_m[row:last].reshape(-1)[both] = CONFIDENCE * error_m + scale.registration_m
        touched = near_moved[row:last].reshape(-1)
        for side, (own, other) in enumerate(((first, second), (second, first))):
            only[side] += np.count_nonzero(touched & (own[:, 0] >= _LEAST) & (other[:, 0] == 0))
    corner = (float(x0 * factor), float(z0 * factor))
    lost, gained = only.tolist()
    width_m = scale.width_m
    return ChangeRaster(corner, width_m, width_m * factor, dz_m, lod_m, near_moved, (lost, gained))


def _box(keys: Int64) -> tuple[int, int, int, int, int]:
    """First cell and number of cells along x, the same along z, and a cell's width in cubes."""
    x, z = axis_indices(keys, 0), axis_indices(keys, 2)
    sides = [(int(x.min()), int(x.max())), (int(z.min()), int(z.max()))]
    factor = 1
    while math.prod(high // factor - low // factor + 1 for low, high in sides) > MAX_RASTER_CELLS:
        factor *= 2
    (x0, nx), (z0, nz) = ((a // factor, b // factor - a // factor + 1) for a, b in sides)
    return x0, nx, z0, nz, factor


def _cell_sums(
    ground: GroundSums, cubes: Int64, cell: Int64, offset: Float64, count: int
) -> Float64:
    """Add up sums (count, 10) of cells about their middles, of their cubes' sums about theirs."""
    sums = ground.sums[cubes, :10].astype(np.float64)
    n, mean = sums[:, 0], sums[:, 1:4]
    columns = [n, *(mean[:, axis] + n * offset[:, axis] for axis in range(3))]
    for column, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        moved = mean[:, a] * offset[:, b] + mean[:, b] * offset[:, a]
        columns.append(sums[:, 4 + column] + moved + n * offset[:, a] * offset[:, b])
    return np.stack([np.bincount(cell, column, count) for column in columns], axis=1)


def _heights(sums: Float64, noise: float) -> tuple[Float64, Float64]:
    """Heights of fitted planes at the cells' middles, and their variances; ticks."""
    n = sums[:, 0]
    x, y, z = (sums[:, axis] / n for axis in (1, 2, 3))
    xx, yy, zz, xy, xz, yz = sums[:, 4:].T - n * np.stack(
        [x * x, y * y, z * z, x * y, x * z, y * z]
    )
    xx, zz = xx + _RIDGE * n, zz + _RIDGE * n
    size = xx * zz - xz * xz
    along_x, along_z = (xy * zz - yz * xz) / size, (yz * xx - xy * xz) / size
    left = np.maximum(yy - along_x * xy - along_z * yz, 0.0)
    scatter = np.maximum(left / (n - 3.0), noise**2)
    lever = (x * x * zz - 2 * x * z * xz + z * z * xx) / size
    return y - along_x * x - along_z * z, scatter * (1.0 / n + lever)
