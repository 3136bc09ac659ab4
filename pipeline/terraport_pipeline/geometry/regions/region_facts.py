"""Facts about every region: size, colour, slope, roughness, height, attributes, neighbours.

What a pick at run time tells about a region, and what the report tabulates. Means are weighted by
face area, so that dense and sparse parts of a region count by the ground they cover. Colours are
averaged in sRGB as stored, which is what people mean by the colour of a region on screen.
``region_totals.py`` computes the numbers, tile by tile; here they are written down.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32

__all__ = [
    "RegionNumbers",
    "add_borders",
    "border_lengths",
    "facts_document",
    "rows_of_borders",
]

_Neighbours = dict[int, list[dict[str, Any]]]


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
    """Write region facts down as plain rounded values, ready for JSON.

    Parameters
    ----------
    numbers : RegionNumbers
    attributes : mapping
        By name, by region: statistics; regions without any value are left out.
    borders : dict
        By region: from :func:`rows_of_borders`.
    scale_m : float
        Width of the cubes that roughness was measured in.

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


def border_lengths(
    vertices: AnyFloat,
    regions: Int32,
    pairs: tuple[Int32, Int32],
) -> tuple[Int32, Float64]:
    """Pairs of regions that touch, lower first, ascending (B, 2), and their border, metres (B,)."""
    neighbours, edges = pairs
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
