"""Volumes of cut and fill by region, distributed from the cells of a change raster.

A cell of the raster is divided among the regions whose surface is in it, in proportion to their
plan area in the cell. So the volumes of all regions, and of cells without a surface, add up to the
raster's. Uncertainties do not: errors of single cells partly cancel out in the sum.

Uncertainty (:mod:`terraport_pipeline.geometry.volumes.volume_error`): the offset between the
surveys, as measured on ground that did not move, is an error shared by all cells; the noise of
each cell's height difference is independent; the bias from summing only one sign of the noise is
added.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.volumes.volume_error import CONFIDENCE, clipping_bias, interval_m3

__all__ = ["ChangeMap", "RegionVolumes", "add_shares", "region_volumes"]


_BLOCK_CELLS: Final = 8
"""Side of a block, cells, whose mean gives the surveys' offset: it has a tenth of a cell's
noise."""

_LEAST_BLOCKS: Final = 5
"""Minimum number of blocks that did not move, to measure the offset of the surveys."""

_MEDIAN_TO_DEVIATION: Final = 1.4826
"""Ratio of the standard deviation of normal values to the median of their absolute values."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeMap:
    """A :class:`~.change_raster.ChangeRaster` in the scene frame."""

    low_m: tuple[float, float]
    """x and z of the corner of cell (0, 0)."""
    cell_m: float
    dz_m: Float32
    """(nx, nz) new mean height less old; NaN where there is none."""
    lod_m: Float32
    """(nx, nz) level of detection at 95 %."""
    moved: Bool
    """(nx, nz) counts for the volumes."""
    registration_m: float
    """Offset common to all heights that the levels of detection assume."""

    @property
    def counted(self) -> Bool:
        """(nx, nz) cells that have a volume."""
        counted: Bool = self.moved & ~np.isnan(self.dz_m)
        return counted

    @property
    def noise_m(self) -> Float64:
        """(nx, nz) standard deviation of each cell's difference, without the common offset."""
        noise: Float64 = np.maximum(self.lod_m.astype(np.float64) - self.registration_m, 0.0)
        return noise / CONFIDENCE

    @property
    def shared_m(self) -> float:
        """Standard deviation of the offset between the surveys where nothing moved.

        The median of the absolute means of blocks of cells. If too little ground did not move, the
        offset that the levels of detection assume.
        """
        still = ~self.moved & ~np.isnan(self.dz_m)
        i, j = np.nonzero(still)
        block = (i // _BLOCK_CELLS) * (self.dz_m.shape[1] // _BLOCK_CELLS + 1) + j // _BLOCK_CELLS
        cells = np.bincount(block)
        sums = np.bincount(block, self.dz_m[still].astype(np.float64), len(cells))
        large = cells >= _BLOCK_CELLS**2 // 2
        if np.count_nonzero(large) < _LEAST_BLOCKS:
            return self.registration_m
        return _MEDIAN_TO_DEVIATION * float(np.median(np.abs(sums[large] / cells[large])))

    def cells_at(self, x: AnyFloat, z: AnyFloat) -> Int64:
        """Look up the cell that each place lies in, numbered row by row; -1 outside."""
        i = np.floor((x.astype(np.float64) - self.low_m[0]) / self.cell_m).astype(np.int64)
        j = np.floor((z.astype(np.float64) - self.low_m[1]) / self.cell_m).astype(np.int64)
        nx, nz = self.moved.shape
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < nz)
        cells: Int64 = np.where(inside, i * nz + j, -1)
        return cells

    def touches(self, low: Float64, high: Float64) -> bool:
        """Whether a box (x, y, z) has a counted cell below or above it."""
        first, last = (
            np.floor((np.asarray(corner)[[0, 2]] - self.low_m) / self.cell_m).astype(np.int64)
            for corner in (low, high)
        )
        first = np.maximum(first, 0)
        window = self.counted[first[0] : max(last[0] + 1, 0), first[1] : max(last[1] + 1, 0)]
        return bool(window.any())


@dataclass(frozen=True, slots=True)
class RegionVolumes:
    """Volumes of one region, or of several together."""

    cut_m3: float
    fill_m3: float
    area_m2: float
    """As seen from above, of the cells that count."""
    uncertainty_m3: float
    """Half the 95 % interval of either volume."""


def add_shares(
    vertices: Float32, faces: Int32, regions: Int32, change: ChangeMap
) -> tuple[Int64, Float64]:
    """Add up the area of every region in every counted cell, seen from above.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Scene frame.
    faces : ndarray of shape (F, 3), int32
        Each counts where its middle lies.
    regions : ndarray of shape (F,), int32
    change : ChangeMap

    Returns
    -------
    keys : ndarray of shape (N, 2), int64
        Cell and region, sorted, each pair once.
    areas : ndarray of shape (N,), float64
        Square metres.
    """
    x, z = vertices[:, 0].astype(np.float64), vertices[:, 2].astype(np.float64)
    corner_x, corner_z = x[faces], z[faces]
    cells = change.cells_at(corner_x.mean(axis=1), corner_z.mean(axis=1))
    rows = np.flatnonzero(cells >= 0)
    rows = rows[change.counted.ravel()[cells[rows]]]
    corner_x, corner_z = corner_x[rows], corner_z[rows]
    edge_x, edge_z = corner_x[:, 1:] - corner_x[:, :1], corner_z[:, 1:] - corner_z[:, :1]
    area_m2 = 0.5 * np.abs(edge_x[:, 0] * edge_z[:, 1] - edge_x[:, 1] * edge_z[:, 0])
    pairs = np.stack([cells[rows], regions[rows].astype(np.int64)], axis=1)
    keys, which = np.unique(pairs, axis=0, return_inverse=True)
    return keys, np.bincount(which.ravel(), area_m2, len(keys)).astype(np.float64)


def region_volumes(
    change: ChangeMap, shares: Iterable[tuple[Int64, Float64]]
) -> tuple[dict[int, RegionVolumes], RegionVolumes, RegionVolumes]:
    """Share the volumes of a change out over regions.

    Parameters
    ----------
    change : ChangeMap
    shares : iterable of (keys, areas)
        Of :func:`add_shares`, for every piece of the surface.

    Returns
    -------
    regions : dict of int to RegionVolumes
        Those with a counted cell, ascending.
    beyond : RegionVolumes
        Cells that no surface lies in.
    whole : RegionVolumes
        All cells: regions and `beyond` together, but for rounding.
    """
    counted = np.flatnonzero(change.counted.ravel())
    dz_m = change.dz_m.ravel()[counted].astype(np.float64)
    pieces = list(shares)
    keys = np.concatenate([np.zeros((0, 2), np.int64), *(keys for keys, _ in pieces)])
    areas = np.concatenate([np.zeros(0), *(areas for _, areas in pieces)])
    # (1) Shares of each cell, one in all where any surface lies in it.
    cell = np.searchsorted(counted, keys[:, 0])
    of_cell = np.bincount(cell, areas, len(counted))
    with_area = areas > 0  # walls seen edge-on have none
    share = areas[with_area] / of_cell[cell[with_area]]
    cell, region = cell[with_area], keys[with_area, 1]
    # (2) Sums by region.
    numbers, which = np.unique(region, return_inverse=True)
    shared_m, noise_m = change.shared_m, change.noise_m.ravel()[counted]
    bias_m = clipping_bias(dz_m, noise_m)
    amounts = np.stack(
        [np.maximum(-dz_m, 0), np.maximum(dz_m, 0), np.ones(len(dz_m)), bias_m, noise_m**2]
    )
    shares_of = np.stack([share, share, share, share, share**2])
    sums = [
        np.bincount(which.ravel(), part * amount[cell], len(numbers))
        for part, amount in zip(shares_of, amounts, strict=True)
    ]
    cell_m2 = change.cell_m**2
    regions = {
        int(number): _volumes(cell_m2, shared_m, *(float(column[row]) for column in sums))
        for row, number in enumerate(numbers.tolist())
    }
    beyond, whole = (
        _volumes(cell_m2, shared_m, *amounts[:, some].sum(axis=1).tolist())
        for some in (of_cell == 0, np.ones(len(dz_m), np.bool_))
    )
    return regions, beyond, whole


def _volumes(
    cell_m2: float,
    shared_m: float,
    cut_m: float,
    fill_m: float,
    cells: float,
    bias_m: float,
    noise2_m2: float,
) -> RegionVolumes:
    """Turn sums over cells into volumes."""
    area_m2 = cells * cell_m2
    interval = interval_m3(area_m2 * shared_m, cell_m2 * float(np.sqrt(noise2_m2)))
    return RegionVolumes(cut_m * cell_m2, fill_m * cell_m2, area_m2, interval + bias_m * cell_m2)
