"""Facts about every region: size, colour, slope, roughness, height, attributes, neighbours.

What a pick at run time tells about a region, and what the report tabulates. Means are weighted by
face area, so that dense and sparse parts of a region count by the ground they cover.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, UInt8
from terraport_pipeline.geometry.mesh.adjacency import as_kernel_input, face_pairs
from terraport_pipeline.geometry.regions.region_kernels import (
    attribute_sums,
    face_areas,
    order_by_slope,
    region_sums,
    slope_percentile,
    squared_deviations,
)
from terraport_pipeline.geometry.regions.region_roughness import (
    automatic_roughness_scale,
    region_roughness,
)

__all__ = [
    "RegionNumbers",
    "add_borders",
    "border_lengths",
    "facts_document",
    "region_facts",
    "rows_of_borders",
]

_Neighbours = dict[int, list[dict[str, Any]]]


def region_facts(
    vertices: AnyFloat,
    faces: AnyInt,
    colours: UInt8,
    regions: Int32,
    *,
    attributes: Mapping[str, AnyFloat] | None = None,
    pairs: tuple[Int32, Int32] | None = None,
    roughness_scale_m: float | None = None,
) -> dict[str, Any]:
    """Summarise every region in plain values ready for JSON.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres, scene frame (Y up).
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    regions : ndarray of shape (F,), int32
        Region of every face, 0..R-1.
    attributes : mapping of str to ndarray of shape (V,), float, optional
        Further values per vertex; NaN means no value and is left out.
    pairs : pair of ndarray of shape (P, 2), int32, optional
        Result of ``face_pairs`` where the caller has it already.
    roughness_scale_m : float, optional
        Width of the cubes that roughness is measured in; None chooses by the density of faces.

    Returns
    -------
    dict
        ``{"roughness_scale_m": ..., "regions": [...]}``, one entry per region number: ``id``,
        ``faces``, ``area_m2``, ``plan_area_m2`` (seen from above), ``centroid`` and ``bounds``
        (scene frame), ``mean_colour`` (sRGB 0..255), ``slope_deg`` (mean and 90th percentile by
        area; 0 = level, 90 = vertical or overhanging), ``roughness_m`` (see
        ``region_roughness.py``), ``height_m`` (min, mean, max), ``attributes`` (min, mean, max,
        deviation by name), ``neighbours`` (region and length of the common border, longest first;
        tie: lower number). Numbers are rounded to what they mean: metres to 1 mm, roughness to 0.1
        mm, colours and angles to 0.1.

    Raises
    ------
    ValueError
        Arrays whose lengths do not fit, or a region without faces.

    Notes
    -----
    Colours are averaged in sRGB as stored, which is what people mean by the colour of a region on
    screen. In a region without any area every face counts alike. Linear in the faces, whatever the
    number of regions: compiled passes over all faces (``region_kernels.py``), no loop per region
    but for writing the answer.
    """
    # (0) Inputs: region numbers without gaps, so that every array below has one row per region.
    attributes = attributes or {}
    _validate_inputs(vertices, faces, colours, regions, attributes)
    if len(faces) == 0:
        return {"roughness_scale_m": roughness_scale_m or 1.0, "regions": []}
    count = int(regions.max()) + 1
    sizes = np.bincount(regions, minlength=count)
    if not sizes.all():
        msg = f"region {int(np.argmin(sizes))} has no face, expected numbers without gaps"
        raise ValueError(msg)
    points = as_kernel_input(vertices, np.float32 if vertices.dtype == np.float32 else np.float64)
    corners, labels = as_kernel_input(faces, np.int32), as_kernel_input(regions, np.int32)
    # (1) area, slope; weight by area, or alike where a region has none
    weight, area, plan, step, slope = face_areas(points, corners, labels, count)
    if not area.all():
        weight = np.where((area == 0.0)[labels], 1.0, weight)
    # (2) sums
    sums, boxes = region_sums(
        points, corners, as_kernel_input(colours, np.uint8), labels, weight, slope, count
    )
    means = sums[:, 1:] / sums[:, :1]
    order, run = order_by_slope(labels, step, count)
    steep = slope_percentile(order, run, weight, slope, 0.9)
    del order, step, slope
    statistics = [
        _attribute(values, corners, labels, weight, count) for values in attributes.values()
    ]
    # (3) roughness, borders
    extent = float((boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)).max())
    scale_m = roughness_scale_m or automatic_roughness_scale(float(area.sum()), len(faces), extent)
    rough = region_roughness(points, corners, labels, scale_m)
    borders = _borders(vertices, faces, regions, pairs)
    return facts_document(
        RegionNumbers(sizes, area, plan, means, boxes, steep, rough),
        dict(zip(attributes, statistics, strict=True)),
        borders,
        scale_m,
    )


@dataclass(frozen=True, slots=True, eq=False)
class RegionNumbers:
    """What is told of every region, row r of region r; not rounded."""

    sizes: AnyInt
    """(R,) faces."""
    area: Float64
    """(R,) square metres."""
    plan: Float64
    """(R,) square metres seen from above."""
    means: Float64
    """(R, 7) mean x, y, z, red, green, blue, slope."""
    boxes: Float64
    """(R, 6) metres."""
    steep: Float64
    """(R,) 90th percentile of the slope, degrees."""
    rough: Float64
    """(R,) metres."""


def facts_document(
    numbers: RegionNumbers,
    attributes: Mapping[str, Mapping[int, dict[str, float]]],
    borders: _Neighbours,
    scale_m: float,
) -> dict[str, Any]:
    """Write region facts down as plain rounded values; see :func:`region_facts`.

    Parameters
    ----------
    numbers : RegionNumbers
    attributes : mapping
        By name, by region: statistics; regions without any value are left out.
    borders : dict
        By region: from :func:`rows_of_borders`.
    scale_m : float
        Width of the cubes that roughness was measured in.
    """
    means = numbers.means
    # Rounded all at once, then taken apart.
    metres = np.round(
        np.column_stack([numbers.area, numbers.plan, means[:, :3], numbers.boxes]), 3
    ).tolist()
    others = np.round(np.column_stack([means[:, 3:7], numbers.steep]), 1).tolist()
    rough_m = np.round(numbers.rough, 4).tolist()
    return {
        "roughness_scale_m": scale_m,
        "regions": [
            {
                "id": number,
                "faces": size,
                "area_m2": row[0],
                "plan_area_m2": row[1],
                "centroid": row[2:5],
                "bounds": {"min": row[5:8], "max": row[8:11]},
                "mean_colour": other[:3],
                "slope_deg": {"mean": other[3], "p90": other[4]},
                "roughness_m": rough_m[number],
                "height_m": {"min": row[6], "mean": row[3], "max": row[9]},
                "attributes": {
                    name: facts[number] for name, facts in attributes.items() if number in facts
                },
                "neighbours": borders.get(number, []),
            }
            for number, (size, row, other) in enumerate(
                zip(numbers.sizes.tolist(), metres, others, strict=True)
            )
        ],
    }


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


def _attribute(
    values: AnyFloat,
    corners: Int32,
    labels: Int32,
    weight: Float64,
    count: int,
) -> dict[int, dict[str, float]]:
    """Statistics of one attribute by region; regions without any value are left out."""
    column = as_kernel_input(values, np.float32 if values.dtype == np.float32 else np.float64)
    sums = attribute_sums(column, corners, labels, weight, count)
    has_value, total = sums[:, 0] > 0, sums[:, 1]
    # Values on faces without area only: every corner counts alike.
    alike = has_value & (total == 0.0)
    divisor = np.where(alike | ~has_value, np.maximum(sums[:, 0], 1.0), total)
    mean = np.where(alike, sums[:, 3], sums[:, 2]) / divisor
    squares = squared_deviations(column, corners, labels, weight, mean)
    deviation = np.sqrt(np.where(alike, squares[:, 1], squares[:, 0]) / divisor)
    rows = np.column_stack([sums[:, 4], mean, sums[:, 5], deviation])[has_value].tolist()
    names = ("min", "mean", "max", "deviation")
    return {
        region: dict(zip(names, row, strict=True))
        for region, row in zip(np.flatnonzero(has_value).tolist(), rows, strict=True)
    }


def _borders(
    vertices: AnyFloat,
    faces: AnyInt,
    regions: Int32,
    pairs: tuple[Int32, Int32] | None,
) -> _Neighbours:
    """Per region its neighbours and the length of the common border, longest first."""
    keys, length = border_lengths(vertices, faces, regions, pairs)
    return rows_of_borders(keys, length)


def border_lengths(
    vertices: AnyFloat,
    faces: AnyInt,
    regions: Int32,
    pairs: tuple[Int32, Int32] | None = None,
) -> tuple[Int32, Float64]:
    """Pairs of regions that touch, lower first, ascending (B, 2), and their border, metres (B,)."""
    neighbours, edges = face_pairs(faces, len(vertices)) if pairs is None else pairs
    left, right = regions[neighbours[:, 0]], regions[neighbours[:, 1]]
    crossing = left != right
    along = vertices[edges[crossing, 0]].astype(np.float64) - vertices[edges[crossing, 1]]
    length = np.sqrt((along * along).sum(axis=1))
    return add_borders(np.stack([left[crossing], right[crossing]], axis=1), length)


def add_borders(pairs: Int32, length: Float64) -> tuple[Int32, Float64]:
    """Add the lengths of equal pairs, whichever way round: (B, 2) ascending, (B,)."""
    if not len(pairs):
        return np.zeros((0, 2), np.int32), np.zeros(0)
    span = int(pairs.max()) + 1
    keys, index = np.unique(
        pairs.min(axis=1).astype(np.int64) * span + pairs.max(axis=1), return_inverse=True
    )
    both = np.stack(np.divmod(keys, span), axis=1).astype(np.int32)
    added: Float64 = np.bincount(index, weights=length).astype(np.float64)
    return both, added


def rows_of_borders(pairs: Int32, length: Float64) -> _Neighbours:
    """Per region its neighbours and the length of the common border, longest first."""
    metres = np.round(length, 3)
    one, other = pairs[:, 0], pairs[:, 1]
    region, near = np.concatenate([one, other]), np.concatenate([other, one])
    border = np.concatenate([metres, metres])
    order = np.lexsort((near, -border, region))
    neighbours: _Neighbours = {}
    for r, n, m in zip(
        region[order].tolist(), near[order].tolist(), border[order].tolist(), strict=True
    ):
        neighbours.setdefault(r, []).append({"region": n, "border_m": m})
    return neighbours
