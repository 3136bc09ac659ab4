"""Height differences between two surveys as seen from above, and the volumes between them.

In each cell of a raster the mean heights of both surveys' samples are compared, less what the
ground's slope makes of samples that lie elsewhere in the cell; the level of detection is that of
M3C2 (see :mod:`.ground_distance`), along the vertical. Walls and trees scatter widely in a cell, so
their level is high.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int64
from terraport_pipeline.geometry.clouds.ground_cells import TICKS, GroundSums, key_indices
from terraport_pipeline.geometry.clouds.ground_change import CONFIDENCE, GroundScale
from terraport_pipeline.geometry.clouds.ground_distance import LEAST, fit_planes

__all__ = ["MAX_RASTER_CELLS", "ChangeRaster", "make_raster"]

MAX_RASTER_CELLS: Final = 1 << 22
"""Cells at most, nine bytes each; wider ones are taken beyond it."""

_AT_ONCE: Final = 1 << 17
"""Cells that are summed at once: 160 bytes each."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeRaster:
    """A raster over x and z; heights in metres."""

    low: tuple[float, float]
    """x and z of the corner of cell (0, 0), widths of a cube from the lattice's anchor."""
    cell_m: float
    dz_m: Float32
    """(nx, nz) new mean height less old; NaN where one survey has fewer than a few samples."""
    lod_m: Float32
    """(nx, nz) level of detection at 95 %; NaN there."""
    changed: Bool
    """(nx, nz) holds ground that changed or touches such."""
    only: tuple[int, int]
    """Cells that changed where the first survey alone has samples, and the second alone."""

    @property
    def significant(self) -> Bool:
        """Cells (nx, nz) that changed by more than the level of detection."""
        beyond: Bool = self.changed & (np.abs(self.dz_m) > self.lod_m)
        return beyond

    @property
    def volumes_m3(self) -> tuple[float, float]:
        """Volumes of cut and of fill, not negative, of significant cells."""
        steps_m = self.dz_m[self.significant].astype(np.float64)
        area_m2 = self.cell_m**2
        return (
            float(-steps_m[steps_m < 0].sum()) * area_m2,
            float(steps_m[steps_m > 0].sum()) * area_m2,
        )


def make_raster(
    keys: Int64, before: GroundSums, after: GroundSums, renewed: Bool, scale: GroundScale
) -> ChangeRaster:
    """Look at the cubes of two surveys from above.

    Parameters
    ----------
    keys : ndarray of shape (K,), int64
        Of the cubes, sorted: y up.
    before, after : GroundSums
        Exchanged, they change the sign of the heights.
    renewed : ndarray of shape (K,), bool
        Cubes that changed or touch such.
    scale : GroundScale

    Returns
    -------
    ChangeRaster
        Cells as wide as a cube, or a power of two of that. It covers the cubes with samples enough
        to be compared: lone points far away do not widen it.
    """
    # (1) The box, and cells that keep it within bounds.
    index = key_indices(keys)
    weighty = before.sums[:, 0] + after.sums[:, 0] >= LEAST
    if not weighty.any():
        weighty[:] = True
    low, high = index[weighty].min(axis=0), index[weighty].max(axis=0)
    factor = 1
    while np.prod(high[::2] // factor - low[::2] // factor + 1) > MAX_RASTER_CELLS:
        factor *= 2
    x0, z0 = low[0] // factor, low[2] // factor
    nx, nz = (int(n) for n in high[::2] // factor - low[::2] // factor + 1)
    x, z = index[:, 0] // factor - x0, index[:, 2] // factor - z0
    inside = (x >= 0) & (x < nx) & (z >= 0) & (z < nz)
    changed = np.zeros((nx, nz), dtype=bool)
    changed[x[inside & renewed], z[inside & renewed]] = True
    # (2) Rows of cells at a time; cubes are ordered by x, so theirs follow each other.
    dz_m = np.full((nx, nz), np.nan, np.float32)
    lod_m = np.full((nx, nz), np.nan, np.float32)
    only = np.zeros(2, np.int64)
    rows_at_once = max(1, _AT_ONCE // nz)
    middle = np.array([(factor - 1) / 2, float(np.median(index[:, 1])), (factor - 1) / 2])
    for row in range(0, nx, rows_at_once):
        last = min(row + rows_at_once, nx)
        begin, end = np.searchsorted(x, (row, last))
        cubes = np.arange(begin, end)[inside[begin:end]]
        cell = (x[cubes] - row) * nz + z[cubes]
        offset = index[cubes] - middle
        offset[:, 0] -= (x[cubes] + x0) * factor
        offset[:, 2] -= (z[cubes] + z0) * factor
        first = _cell_sums(before, cubes, cell, offset * TICKS, (last - row) * nz)
        second = _cell_sums(after, cubes, cell, offset * TICKS, (last - row) * nz)
        both = np.flatnonzero((first[:, 0] >= LEAST) & (second[:, 0] >= LEAST))
        fits = fit_planes(first[both], second[both], 1)
        tick_m = scale.width_m / TICKS
        dz_m[row:last].reshape(-1)[both] = fits[:, 0] * tick_m
        error_m = np.sqrt(fits[:, 1]) * tick_m
        lod_m[row:last].reshape(-1)[both] = CONFIDENCE * error_m + scale.registration_m
        touched = changed[row:last].reshape(-1)
        for side, (own, other) in enumerate(((first, second), (second, first))):
            only[side] += np.count_nonzero(touched & (own[:, 0] >= LEAST) & (other[:, 0] == 0))
    corner = (float(x0 * factor), float(z0 * factor))
    lost, gained = only.tolist()
    return ChangeRaster(corner, scale.width_m * factor, dz_m, lod_m, changed, (lost, gained))


def _cell_sums(
    ground: GroundSums, cubes: Int64, cell: Int64, offset: Float64, count: int
) -> Float64:
    """Sums (count, 10) of cells about their middles, of their cubes' sums about theirs."""
    sums = ground.sums[cubes, :10].astype(np.float64)
    n, mean = sums[:, 0], sums[:, 1:4]
    columns = [n, *(mean[:, axis] + n * offset[:, axis] for axis in range(3))]
    for column, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        moved = mean[:, a] * offset[:, b] + mean[:, b] * offset[:, a]
        columns.append(sums[:, 4 + column] + moved + n * offset[:, a] * offset[:, b])
    return np.stack([np.bincount(cell, column, count) for column in columns], axis=1)
