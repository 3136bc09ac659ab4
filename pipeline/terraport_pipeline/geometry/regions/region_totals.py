"""Facts about regions from tiles: sums of each tile, added up, and turned to facts of regions.

The mesh is never held whole. Every sum, least and greatest value adds up over tiles; the deviation
of attributes by the rule of Chan, Golub and LeVeque ("Updating formulae and a pairwise algorithm
for computing sample variances", 1979); roughness by the moments of each region in each cube, whole
also where a tile's border cuts the cube. Only the 90th percentile of the slope is rounded to a bin
of a histogram (0.05 degrees; wider beyond 8,192 regions). In a region without any area every face
counts alike. Linear in the faces, whatever the number of regions: compiled passes over all faces of
a tile (``region_kernels.py``), no loop per region but for writing the answer.

PURE: no I/O, no clock. Memory: 8 bytes per region and bin, at most 128 MiB; about 100 bytes per
region and cube, of which there is one per hundred faces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, AnyFloat, AnyInt, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.mesh.adjacency import as_kernel_input
from terraport_pipeline.geometry.regions.region_facts import (
    RegionNumbers,
    add_borders,
    border_lengths,
    facts_document,
    rows_of_borders,
)
from terraport_pipeline.geometry.regions.region_kernels import (
    attribute_sums,
    face_areas,
    region_sums,
    slope_histogram,
    squared_deviations,
)
from terraport_pipeline.geometry.regions.region_roughness import roughness_moments, roughness_of

__all__ = [
    "RegionTotals",
    "add_totals",
    "slope_bins",
    "spread_totals",
    "tile_totals",
    "totals_document",
]


_SLOPE_BINS: Final = 1800
_MOST_BINS: Final = 2**24
"""Regions times bins, at most."""
_STEEP: Final = 0.9

_KNOWN, _WEIGHT, _WEIGHED, _PLAIN, _LEAST, _MOST, _SQUARES, _PLAIN_SQUARES = range(8)


@dataclass(frozen=True, slots=True, eq=False)
class RegionTotals:
    """Sums over the faces of regions; row r belongs to region r."""

    sizes: Int64
    """(R,) faces."""
    areas: Float64
    """(R, 2) area, area seen from above."""
    sums: Float64
    """(R, 8) as ``region_sums`` gives them, weighted by area."""
    plain: Float64
    """(R, 8) the same with every face alike, where a tile's part of a region has no area."""
    boxes: Float64
    """(R, 6)."""
    slopes: Float64
    """(R, bins) area by slope."""
    attributes: Float64
    """(A, R, 8) known corners, weight, weighted sum, plain sum, least, greatest, weighted and plain
    squared deviations from the mean."""
    cubes: Int64
    """(K, 3) cubes of roughness."""
    cube_region: Int32
    """(K,)"""
    moments: Float64
    """(K, 10)"""
    touching: Int32
    """(B, 2) regions that touch, lower first."""
    border_m: Float64
    """(B,)"""


def tile_totals(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8,
    regions: Int32,
    count: int,
    *,
    attributes: Mapping[str, AnyFloat],
    pairs: tuple[Int32, Int32],
    roughness_scale_m: float,
    bins: int,
) -> RegionTotals:
    """Sum up one tile.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Of the tile; metres, scene frame (Y up).
    faces : ndarray of shape (F, 3), integer
        Vertex indices; at least one face.
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    regions : ndarray of shape (F,), int32
        Region of every face, 0..count-1: numbers of the tile's own, or of the scene.
    count : int
        Number of regions.
    attributes : mapping of str to ndarray of shape (V,), float
        Further values per vertex; NaN means no value and is left out.
    pairs : pair of ndarray of shape (P, 2), int32
        Result of ``face_pairs``.
    roughness_scale_m : float
        The same for all tiles.
    bins : int
        :func:`slope_bins` of the scene.

    Returns
    -------
    RegionTotals

    Raises
    ------
    ValueError
        Arrays whose lengths do not fit.
    """
    _validate_inputs(vertices, faces, colours, regions, attributes)
    points = as_kernel_input(vertices, np.float32 if vertices.dtype == np.float32 else np.float64)
    corners, labels = as_kernel_input(faces, np.int32), as_kernel_input(regions, np.int32)
    rgb = as_kernel_input(colours, np.uint8)
    weight, area, plan, slope = face_areas(points, corners, labels, count)
    sums, boxes = region_sums(points, corners, rgb, labels, weight, slope, count)
    sizes = np.bincount(labels, minlength=count)
    plain = np.zeros_like(sums)
    flat = (area == 0.0) & (sizes > 0)
    if flat.any():
        alike = flat[labels].astype(np.float64)
        plain = region_sums(points, corners, rgb, labels, alike, slope, count)[0]
    statistics = [
        _tile_attribute(values, corners, labels, weight, count) for values in attributes.values()
    ]
    cubes, cube_region, moments = roughness_moments(points, corners, labels, roughness_scale_m)
    return RegionTotals(
        sizes.astype(np.int64), np.stack([area, plan], axis=1), sums, plain, boxes,
        slope_histogram(labels, weight, slope, count, bins),
        np.stack(statistics) if statistics else np.zeros((0, count, 8)),
        cubes, cube_region, moments, *border_lengths(vertices, regions, pairs),
    )  # fmt: skip


def slope_bins(count: int) -> int:
    """Bins of the slope's histogram for so many regions, the same up to the next power of two.

    What tiles are summed up with must not change with every region far away.
    """
    room = _MOST_BINS >> (max(count, 1) - 1).bit_length()
    return max(min(_SLOPE_BINS, room), 90)


def spread_totals(totals: RegionTotals, regions: Int32, count: int) -> RegionTotals:
    """Take a tile's own numbers of regions to the scene's.

    Parameters
    ----------
    totals : RegionTotals
        Of regions 0..N-1.
    regions : ndarray of shape (N,), int32
        Their numbers in the scene, ascending.
    count : int
        Regions of the scene.
    """
    boxes = np.tile(np.array([np.inf] * 3 + [-np.inf] * 3), (count, 1))
    boxes[regions] = totals.boxes
    attributes = np.zeros((len(totals.attributes), count, 8))
    attributes[..., _LEAST], attributes[..., _MOST] = np.inf, -np.inf
    attributes[:, regions] = totals.attributes

    def spread(rows: AnyArray) -> AnyArray:
        all_rows = np.zeros((count, *rows.shape[1:]), rows.dtype)
        all_rows[regions] = rows
        return all_rows

    return RegionTotals(
        spread(totals.sizes), spread(totals.areas), spread(totals.sums), spread(totals.plain),
        boxes, spread(totals.slopes), attributes, totals.cubes,
        regions[totals.cube_region].astype(np.int32), totals.moments,
        regions[totals.touching].astype(np.int32), totals.border_m,
    )  # fmt: skip


def add_totals(one: RegionTotals, other: RegionTotals) -> RegionTotals:
    """Add the sums of two sets of tiles, with the same regions and attributes."""
    boxes = np.concatenate(
        [
            np.minimum(one.boxes[:, :3], other.boxes[:, :3]),
            np.maximum(one.boxes[:, 3:], other.boxes[:, 3:]),
        ],
        axis=1,
    )
    return RegionTotals(
        one.sizes + other.sizes, one.areas + other.areas, one.sums + other.sums,
        one.plain + other.plain, boxes, one.slopes + other.slopes,
        _add_attributes(one.attributes, other.attributes),
        *_add_moments(
            np.concatenate([one.cubes, other.cubes]),
            np.concatenate([one.cube_region, other.cube_region]),
            np.concatenate([one.moments, other.moments]),
        ),
        *add_borders(
            np.concatenate([one.touching, other.touching]),
            np.concatenate([one.border_m, other.border_m]),
        ),
    )  # fmt: skip


def totals_document(
    totals: RegionTotals, attributes: Sequence[str], roughness_scale_m: float
) -> dict[str, Any]:
    """Turn sums into the document of :func:`~.region_facts.facts_document`.

    Parameters
    ----------
    totals : RegionTotals
        Of all tiles, borders across seams included.
    attributes : sequence of str
        Names, in the order of ``totals.attributes``.
    roughness_scale_m : float
        As the tiles were summed up with.

    Raises
    ------
    ValueError
        A region without faces.
    """
    if not totals.sizes.all():
        msg = f"region {int(np.argmin(totals.sizes))} has no face, expected numbers without gaps"
        raise ValueError(msg)
    area = totals.areas[:, 0]
    sums = np.where((area == 0.0)[:, None], totals.plain, totals.sums)
    count = len(area)
    numbers = RegionNumbers(
        totals.sizes, area, totals.areas[:, 1], sums[:, 1:] / sums[:, :1], totals.boxes,
        _steep(totals.slopes), roughness_of(totals.cube_region, totals.moments, count),
    )  # fmt: skip
    statistics = {
        name: _statistics(sums) for name, sums in zip(attributes, totals.attributes, strict=True)
    }
    borders = rows_of_borders(totals.touching, totals.border_m)
    return facts_document(numbers, statistics, borders, roughness_scale_m)


def _validate_inputs(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8,
    regions: Int32,
    attributes: Mapping[str, AnyFloat],
) -> None:
    if regions.shape != (len(faces),):
        msg = f"regions have shape {regions.shape}, expected ({len(faces)},)"
        raise ValueError(msg)
    if colours.shape != vertices.shape:
        msg = f"colours have shape {colours.shape}, expected {vertices.shape}"
        raise ValueError(msg)
    for name, values in attributes.items():
        if values.shape != (len(vertices),):
            msg = f"attribute {name!r} has shape {values.shape}, expected ({len(vertices)},)"
            raise ValueError(msg)


def _tile_attribute(
    values: AnyFloat, corners: Int32, labels: Int32, weight: Float64, count: int
) -> Float64:
    column = as_kernel_input(values, np.float32 if values.dtype == np.float32 else np.float64)
    sums = attribute_sums(column, corners, labels, weight, count)
    mean = _mean(sums)
    return np.concatenate([sums, squared_deviations(column, corners, labels, weight, mean)], axis=1)


def _mean(sums: Float64) -> Float64:
    """Mean by weight, or of all known corners alike where they have no weight; (R,)."""
    alike = sums[:, _WEIGHT] == 0.0
    divisor = np.where(alike, np.maximum(sums[:, _KNOWN], 1.0), sums[:, _WEIGHT])
    mean: Float64 = np.where(alike, sums[:, _PLAIN], sums[:, _WEIGHED]) / divisor
    return mean


def _add_attributes(one: Float64, other: Float64) -> Float64:
    both = one + other
    both[..., _LEAST] = np.minimum(one[..., _LEAST], other[..., _LEAST])
    both[..., _MOST] = np.maximum(one[..., _MOST], other[..., _MOST])
    for a in range(len(both)):
        gap = _mean(one[a]) - _mean(other[a])
        for squares, by in ((_SQUARES, _WEIGHT), (_PLAIN_SQUARES, _KNOWN)):
            total = np.maximum(both[a][:, by], np.finfo(np.float64).tiny)
            both[a][:, squares] += gap * gap * one[a][:, by] * (other[a][:, by] / total)
    return both


def _statistics(sums: Float64) -> dict[int, dict[str, float]]:
    has_value = sums[:, _KNOWN] > 0
    alike = sums[:, _WEIGHT] == 0.0
    divisor = np.where(alike, np.maximum(sums[:, _KNOWN], 1.0), sums[:, _WEIGHT])
    squares = np.where(alike, sums[:, _PLAIN_SQUARES], sums[:, _SQUARES])
    deviation = np.sqrt(squares / divisor)
    rows = np.column_stack([sums[:, _LEAST], _mean(sums), sums[:, _MOST], deviation])[has_value]
    names = ("min", "mean", "max", "deviation")
    return {
        region: dict(zip(names, row, strict=True))
        for region, row in zip(np.flatnonzero(has_value).tolist(), rows.tolist(), strict=True)
    }


def _add_moments(cubes: Int64, region: Int32, moments: Float64) -> tuple[Int64, Int32, Float64]:
    """Unite pieces of one region in one cube; sorted by region and cube."""
    if not len(region):
        return cubes, region, moments
    order = np.lexsort((*cubes.T, region))
    cubes, region, moments = cubes[order], region[order], moments[order]
    new = (cubes[1:] != cubes[:-1]).any(axis=1) | (region[1:] != region[:-1])
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    return cubes[first], region[first], np.add.reduceat(moments, first, axis=0)


def _steep(slopes: Float64) -> Float64:
    """Middle of the bin in which the area passes nine tenths, (R,) degrees."""
    passed = np.cumsum(slopes, axis=1)
    total = passed[:, -1:]
    at = np.argmax(passed >= _STEEP * total, axis=1)
    width = 90.0 / slopes.shape[1]
    steep: Float64 = np.where(total[:, 0] > 0.0, (at + 0.5) * width, 0.0)
    return steep
