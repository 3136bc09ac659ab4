"""The sampled points by themselves: in blocks, thinned, their slant, the map of their density."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.point_order import thinning_rows
from terraport_pipeline.geometry.clouds.density_map import DensityMap, count_samples
from terraport_pipeline.geometry.clouds.detail_cell import smoothing_radius_m
from terraport_pipeline.geometry.clouds.normals import estimate_normals
from terraport_pipeline.geometry.clouds.spacing import nearest_neighbours
from terraport_pipeline.model import Survey

__all__ = ["BLOCK_ROWS", "density_of", "mean_slant", "point_blocks", "thinned"]

_THINNED_POINTS: Final = 150_000
"""Of these the windows' middles and normals are taken: a second to clean, by the build's stage."""

_PATCHES: Final = 64

_PATCH_POINTS: Final = 2000
"""Patches that normals are taken of, in the density of the sample."""

_PLANE_POINTS: Final = 10

_MOST_PLANE_POINTS: Final = 128
"""Neighbours of a plane: as wide as a cell or two, or as the smoothing of noisy samples."""

_PATCH_REACH: Final = 2.0

BLOCK_ROWS: Final = 1_000_000
"""Points in memory at once."""

_MAP_CELLS: Final = 512
"""Cells along the longer side of the density map, at most..."""

_MAP_SPACINGS: Final = 4.0
"""...and the side of one at least: 16 samples, so that shades mean something."""


def point_blocks(points: NpyReader) -> Iterator[Float64]:
    """Read the points block by block."""
    for _, block in points.blocks(BLOCK_ROWS):
        yield block


def thinned(points: NpyReader, values: Mapping[str, Any]) -> Survey:
    """Take every n-th point or so; no columns, which cleaning does not change."""
    rows = thinning_rows(len(points), _THINNED_POINTS)
    some = [
        block if rows is None else block[_within(rows, first, len(block))]
        for first, block in points.blocks(BLOCK_ROWS)
    ]
    return Survey(np.concatenate(some), None, {}, None, values["format"])


def _within(rows: Int64, first: int, count: int) -> Int64:
    begin, end = np.searchsorted(rows, (first, first + count))
    return rows[begin:end] - first


def mean_slant(points: NpyReader, low: Float64, measured: Mapping[str, Any], threads: int) -> float:
    """Mean of |nx| + |ny| + |nz|, of planes as wide as what a build smooths over.

    Points lie along a curve through the box: a run of them is a patch in the density of the sample.
    """
    radius = smoothing_radius_m(measured["surface_spacing_m"], measured["noise_m"])
    wide = math.pi * (radius / measured["surface_spacing_m"]) ** 2
    k = int(min(max(_PLANE_POINTS, wide), _MOST_PLANE_POINTS))
    rows = min(_PATCH_POINTS, len(points))
    sums = []
    for first in np.linspace(0, len(points) - rows, _PATCHES).astype(np.int64).tolist():
        patch = (points.read(first, first + rows) - low).astype(np.float32)
        neighbours = nearest_neighbours(patch, k, workers=threads)
        normals, _ = estimate_normals(patch, neighbours, k=k, threads=threads)
        # Where the curve leaves a patch and comes back, neighbours are far: no planes.
        far = neighbours.distances[:, -1]
        good = far <= _PATCH_REACH * np.median(far)
        sums.append(np.abs(normals[good].astype(np.float64)).sum(axis=1))
    return float(np.concatenate(sums).mean())


def density_of(points: NpyReader, low: Float64, high: Float64, spacing_m: float) -> DensityMap:
    """Draw the map in cells of several spacings of the sample, not too many."""
    side_m = float((high - low)[:2].max())
    cell_m = max(_MAP_SPACINGS * spacing_m, side_m / _MAP_CELLS, 1e-6)
    return count_samples(point_blocks(points), low, high, cell_m)
