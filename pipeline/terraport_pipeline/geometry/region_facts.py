"""Facts about every region: size, colour, slope, height, attributes, neighbours.

What a pick at run time tells about a region, and what the report tabulates. Means are weighted by
face area, so that dense and sparse parts of a region count by the ground they cover.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.adjacency import face_pairs

__all__ = ["region_facts"]

_Float64 = npt.NDArray[np.float64]
_Int32 = npt.NDArray[np.int32]


def region_facts(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    colours: npt.NDArray[np.uint8],
    regions: _Int32,
    *,
    attributes: Mapping[str, npt.NDArray[np.floating]] | None = None,
    pairs: tuple[_Int32, _Int32] | None = None,
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

    Returns
    -------
    dict
        ``{"regions": [...]}``, one entry per region number: ``id``, ``label`` (None: nothing has
        named it yet), ``faces``, ``area_m2``, ``plan_area_m2`` (seen from above), ``centroid`` and
        ``bounds`` (scene frame), ``mean_colour`` (sRGB 0..255), ``slope_deg`` (mean and 90th
        percentile by area; 0 = level, 90 = vertical or overhanging), ``height_m`` (min, mean, max),
        ``attributes`` (min, mean, max, deviation by name), ``neighbours`` (region and length of the
        common border, longest first; tie: lower number). Numbers are rounded to what they mean:
        metres to 1 mm, colours and angles to 0.1.

    Raises
    ------
    ValueError
        Arrays whose lengths do not fit.

    Notes
    -----
    Colours are averaged in sRGB as stored, which is what people mean by the colour of a region on
    screen.
    """
    if regions.shape != (len(faces),):
        msg = f"regions have shape {regions.shape}, expected ({len(faces)},)"
        raise ValueError(msg)
    if colours.shape != vertices.shape:
        msg = f"colours have shape {colours.shape}, expected {vertices.shape}"
        raise ValueError(msg)
    for name, values in (attributes or {}).items():
        if values.shape != (len(vertices),):
            msg = f"attribute {name!r} has shape {values.shape}, expected ({len(vertices)},)"
            raise ValueError(msg)
    if len(faces) == 0:
        return {"regions": []}
    count = int(regions.max()) + 1
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    normal = 0.5 * np.cross(b - a, c - a)
    area = np.sqrt((normal * normal).sum(axis=1))
    centre = (a + b + c) / 3.0
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    slope = np.degrees(np.arccos(np.clip(normal[:, 1] / np.maximum(area, 1e-300), 0.0, 1.0)))
    slope[area == 0.0] = 0.0
    colour = sum(colours[faces[:, i]].astype(np.float64) for i in range(3)) / 3.0
    order = np.argsort(regions, kind="stable")
    sizes = np.bincount(regions, minlength=count)
    starts = np.cumsum(sizes) - sizes
    borders = _borders(vertices, faces, regions, pairs)
    return {
        "regions": [
            _one_region(
                number, order[starts[number] : starts[number] + sizes[number]],
                low, high, centre,
                area, normal, slope, colour, faces, attributes or {}, borders.get(number, []),
            )
            for number in range(count)
        ]
    }  # fmt: skip


def _one_region(
    number: int,
    chosen: npt.NDArray[np.int64],
    low: _Float64,
    high: _Float64,
    centre: _Float64,
    area: _Float64,
    normal: _Float64,
    slope: _Float64,
    colour: _Float64,
    faces: npt.NDArray[np.integer],
    attributes: Mapping[str, npt.NDArray[np.floating]],
    neighbours: list[tuple[int, float]],
) -> dict[str, Any]:
    if len(chosen) == 0:
        msg = f"region {number} has no face, expected numbers without gaps"
        raise ValueError(msg)
    weight = area[chosen]
    total = float(weight.sum())
    if total == 0.0:
        weight = np.ones(len(chosen))  # only zero-area faces: every face counts alike
    least, most = low[chosen].min(axis=0), high[chosen].max(axis=0)
    mean = np.average(centre[chosen], axis=0, weights=weight)
    facts: dict[str, Any] = {}
    for name, values in attributes.items():
        corner = np.asarray(values, dtype=np.float64)[faces[chosen]]
        share = np.repeat(weight[:, None], 3, axis=1)
        known = np.isfinite(corner)
        if not known.any():
            continue
        if share[known].sum() == 0.0:
            share = np.ones_like(share)
        average = float(np.average(corner[known], weights=share[known]))
        variance = float(np.average((corner[known] - average) ** 2, weights=share[known]))
        facts[name] = {
            "min": float(corner[known].min()),
            "mean": average,
            "max": float(corner[known].max()),
            "deviation": float(np.sqrt(variance)),
        }
    by_slope = np.argsort(slope[chosen], kind="stable")
    passed = np.cumsum(weight[by_slope])
    steep = slope[chosen][by_slope[np.searchsorted(passed, 0.9 * passed[-1])]]
    return {
        "id": number,
        "label": None,
        "faces": len(chosen),
        "area_m2": round(total, 3),
        "plan_area_m2": round(float(np.abs(normal[chosen, 1]).sum()), 3),
        "centroid": [round(float(value), 3) for value in mean],
        "bounds": {
            "min": [round(float(value), 3) for value in least],
            "max": [round(float(value), 3) for value in most],
        },
        "mean_colour": [
            round(float(value), 1) for value in np.average(colour[chosen], axis=0, weights=weight)
        ],
        "slope_deg": {
            "mean": round(float(np.average(slope[chosen], weights=weight)), 1),
            "p90": round(float(steep), 1),
        },
        "height_m": {
            "min": round(float(least[1]), 3),
            "mean": round(float(mean[1]), 3),
            "max": round(float(most[1]), 3),
        },
        "attributes": facts,
        "neighbours": [
            {"region": region, "border_m": round(length, 3)} for region, length in neighbours
        ],
    }


def _borders(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    regions: _Int32,
    pairs: tuple[_Int32, _Int32] | None,
) -> dict[int, list[tuple[int, float]]]:
    """Per region its neighbours and the length of the common border, longest first."""
    neighbours, edges = face_pairs(faces, len(vertices)) if pairs is None else pairs
    left, right = regions[neighbours[:, 0]], regions[neighbours[:, 1]]
    crossing = left != right
    if not crossing.any():
        return {}
    along = vertices[edges[crossing, 0]].astype(np.float64) - vertices[edges[crossing, 1]]
    length = np.sqrt((along * along).sum(axis=1))
    span = int(regions.max()) + 1
    low = np.minimum(left[crossing], right[crossing]).astype(np.int64)
    keys, index = np.unique(low * span + np.maximum(left, right)[crossing], return_inverse=True)
    found: dict[int, list[tuple[int, float]]] = {}
    for key, metres in zip(keys.tolist(), np.bincount(index, weights=length).tolist(), strict=True):
        a, b = divmod(key, span)
        found.setdefault(a, []).append((b, metres))
        found.setdefault(b, []).append((a, metres))
    return {region: sorted(near, key=lambda n: (-n[1], n[0])) for region, near in found.items()}
