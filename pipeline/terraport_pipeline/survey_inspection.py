"""``terraport inspect`` for surveys: what is in them, what looks wrong, what a build will take.

First by the headers of the files, which a delivery of any size answers within seconds; then by a
bounded part of their points (:mod:`.sample`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from pyproj import CRS

from terraport_pipeline.crs_axes import (
    UnusableAxesError,
    code_of,
    height_axis,
    parts_of,
    plan_axes,
)
from terraport_pipeline.engines.readers.survey_stream import FileHead, survey_size
from terraport_pipeline.errors import ReadError, ResourceError, SurveyError
from terraport_pipeline.geometry.clouds.density_map import DensityMap, widened
from terraport_pipeline.geometry.clouds.detail_cell import noise_ratio
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.sample.chosen_files import MAX_POINTS
from terraport_pipeline.sample.survey_sample import SurveySample, sample_survey
from terraport_pipeline.survey.one_survey import OUTSIDE, listed, one_crs
from terraport_pipeline.survey.survey_files import SurveyFiles, meaning_of
from terraport_pipeline.workflow.build_forecast import forecast_build
from terraport_store import EAST_NORTH_UP

__all__ = ["inspect_headers", "inspect_points", "inspect_survey"]

MAP_COLUMNS: Final = 48
"""Cells along the longer side of the map in the facts."""

_DRAWN: Final = 100_000
"""Points of a sample that its densities are taken at, about."""

_WIDER: Final = 3
"""Cells of the map along the side of one that density is told of: 144 samples, so that ground forty
times thinner has some in every one."""

_PERCENTILES: Final = (("p5", 5), ("median", 50), ("p95", 95))

_MANY_COPIES: Final = 0.01
_MANY_OUTLIERS: Final = 0.02
"""Shares of the points that are told of."""

_NOISY: Final = 0.3
"""Noise over spacing from which samples are smoothed (docs/decisions/cell-size.md)."""

_UNEVEN: Final = 10.0
"""Dense places hold so many times more points an area than thin ones."""

_GAP_SHARE: Final = 0.005
"""Gaps together, of the ground."""


def inspect_survey(
    survey: SurveyFiles, *, max_memory_bytes: int, threads: int = 1, max_points: int = MAX_POINTS
) -> dict[str, Any]:
    """Describe a survey: :func:`inspect_headers` and :func:`inspect_points` together."""
    survey, heads = survey.heads(NullProgress(), check_meaning=False)
    facts = inspect_headers(survey, heads)
    if facts["refused"] is not None:
        return facts
    return inspect_points(
        survey, heads, facts, max_memory_bytes=max_memory_bytes, threads=threads,
        max_points=max_points,
    )[0]  # fmt: skip


def inspect_headers(survey: SurveyFiles, heads: Sequence[FileHead]) -> dict[str, Any]:
    """Describe a survey by the headers of its files.

    Parameters
    ----------
    survey : SurveyFiles
        From :meth:`.SurveyFiles.heads`, with coordinates not yet checked.
    heads : sequence of FileHead
        Headers of its files.

    Returns
    -------
    dict
        Plain values, ready for JSON: ``name``, ``refused`` (why a build refuses the survey by its
        headers, else None), ``warnings`` (what looks wrong, sentences),
        ``points`` (of text and PCD estimated by size), ``bytes``, ``crs``, ``units`` (of the CRS,
        ``horizontal_m`` and ``vertical_m``: metres of each, ``axes``: directions of x, y and z
        where they are not east, north and up; None without one), ``bounds`` (None
        where a header does not say it; in the files' unit), ``files`` (each with ``name``,
        ``format``, ``points``, ``bytes``, ``bounds``) and ``left_out`` (``name``, ``reason``,
        ``damaged``). With an extent only of files that touch it, and ``within``: its ``values``,
        about how many ``points`` lie in it, and how many are ``read`` for that.
    """
    bounds = [
        None if head.low is None or head.high is None else [list(head.low), list(head.high)]
        for head in heads
    ]
    stated = [corners for corners in bounds if corners is not None]
    whole = None
    if len(stated) == len(bounds):
        lows, highs = zip(*stated, strict=True)
        whole = [[min(axis) for axis in zip(*lows, strict=True)],
                 [max(axis) for axis in zip(*highs, strict=True)]]  # fmt: skip
    within = None
    if survey.extent is not None:
        rows = [head.points if head.rows is None else head.rows for head in heads]
        about = survey_size(heads, survey.extent).points
        within = {"values": [*survey.extent.values], "points": about, "read": sum(rows)}
    names = [file.name for file in survey.files]
    stated_crs = list(zip(names, (head.crs for head in heads), strict=True))
    crs = one_crs(stated_crs, statement=survey.statement)
    refused: str | None = None
    warnings: list[str] = []
    units = None
    try:
        units, warnings = meaning_of(survey.files, heads, crs, survey.statement)
    except ReadError as error:
        refused = str(error)
    taken = crs if survey.statement.system is None else survey.statement.system
    if units is not None and units.crs_wkt:
        taken = CRS.from_wkt(units.crs_wkt)
    return {
        "name": survey.title,
        "refused": refused,
        "warnings": [*_damage(survey), *warnings],
        "points": survey_size(heads).points,
        "bytes": survey.size_bytes,
        "crs": None if taken is None else {"name": taken.name, "epsg": code_of(taken)},
        "units": _units(taken),
        "bounds": whole,
        **({} if within is None else {"within": within}),
        "files": [
            {
                "name": file.name,
                "format": file.format,
                "points": head.points,
                "bytes": file.bytes,
                "bounds": corners,
            }
            for file, head, corners in zip(survey.files, heads, bounds, strict=True)
        ],
        "left_out": [
            *({"name": n, "reason": why, "damaged": True} for n, why in survey.damaged),
            *({"name": n, "reason": why, "damaged": False} for n, why in survey.ignored),
            *({"name": n, "reason": OUTSIDE, "damaged": False} for n, _ in survey.outside),
        ],
    }


def inspect_points(
    survey: SurveyFiles,
    heads: Sequence[FileHead],
    facts: dict[str, Any],
    *,
    max_memory_bytes: int,
    threads: int = 1,
    max_points: int = MAX_POINTS,
    progress: Progress | None = None,
) -> tuple[dict[str, Any], DensityMap | None]:
    """Add to the facts of the headers what a bounded part of the points says.

    Parameters
    ----------
    survey, heads
        As of :func:`inspect_headers`.
    facts : dict
        What that returned; not modified.
    max_memory_bytes : int
        That a build may take.
    threads : int
        Cores; the build is forecast for as many.
    max_points : int
        Points that are read, about.
    progress : Progress, optional

    Returns
    -------
    facts : dict
        The same, more ``warnings`` among them, ``points`` and ``bounds`` as read where all were
        and no header says them. With ``refused``
        (why a build refuses the points) nothing of the following is there:

        ``sample``
            ``points`` that were read, ``share`` of all, ``whole``, ``files``, ``seconds``.
        ``ground``
            ``area_m2`` seen from above, ``surface_m2``, ``gaps`` (``area_m2``, ``east``, ``north``
            in the survey's own unit; None of a sample).
        ``density``
            ``points_per_m2`` (p5, median, p95) and ``map``: ``cell_m``, ``west`` and ``north`` in
            the survey's own unit, and ``points_per_m2``, rows from north to south.
        ``spacing``
            ``median_m``, ``surface_m``, ``noise_m``, ``noise_spacings``.
        ``duplicates``
            ``records`` and ``positions`` of the sample that repeat another, ``share``.
        ``outliers_share``
            Of a thinned copy.
        ``colours``
            ``depths``, ``distinct``, ``black_share``; None where there are none.
        ``attributes``
            ``name``, ``type``, ``min``, ``max``, ``missing``, ``values`` (points by value, of
            codes; else None).
        ``forecast``
            As :class:`~terraport_pipeline.workflow.build_forecast.BuildForecast`, with ``cores``
            and ``max_memory_bytes`` that it is for.
    density : DensityMap or None
        The map as it was measured.
    """
    began = time.monotonic()
    try:
        sample = sample_survey(
            survey, heads, max_memory_bytes=max_memory_bytes, max_points=max_points,
            threads=threads, progress=progress,
        )  # fmt: skip
    except (ReadError, SurveyError, ResourceError) as error:
        return {**facts, "refused": str(error)}, None
    forecast = forecast_build(sample.ground, max_memory_bytes=max_memory_bytes, threads=threads)
    density = _density(sample)
    measured = sample.measured
    spacing_m = measured["surface_spacing_m"]
    added: dict[str, Any] = {
        **({"points": sample.points} if survey.extent is None else {}),
        **({"bounds": _bounds(sample)} if facts["bounds"] is None and sample.whole else {}),
        "refused": None,
        "sample": {
            "points": sample.read,
            "share": round(min(1.0, sample.read / sample.points), 4),
            "whole": sample.whole,
            "files": sample.files,
            "seconds": round(time.monotonic() - began, 2),
        },
        "ground": {
            "area_m2": round(sample.ground_m2, 2),
            "surface_m2": round(sample.surface_m2, 2),
            "gaps": _gaps(sample) if sample.whole else None,
        },
        "density": density,
        "spacing": {
            "median_m": measured["spacing_m"],
            "surface_m": spacing_m,
            "noise_m": measured["noise_m"],
            "noise_spacings": round(noise_ratio(spacing_m, measured["noise_m"]), 3),
        },
        "duplicates": {
            "records": sample.repeats,
            "positions": sample.copies,
            "share": round((sample.repeats + sample.copies) / max(1, sample.read), 6),
        },
        "outliers_share": round(sample.outliers, 5),
        "colours": None
        if sample.colours is None
        else {
            "depths": [*sample.colours.depths],
            "distinct": sample.colours.distinct,
            "black_share": round(sample.colours.black / max(1, sample.read), 5),
        },
        "attributes": [
            {
                "name": column.name,
                "type": column.type,
                "min": column.low,
                "max": column.high,
                "missing": column.missing,
                "values": column.values,
            }
            for column in sample.attributes
        ],
        "forecast": {**asdict(forecast), "cores": threads, "max_memory_bytes": max_memory_bytes},
    }
    warnings = [*facts["warnings"], *_point_warnings(sample, added), *sample.warnings]
    return {**facts, **added, "warnings": list(dict.fromkeys(warnings))}, sample.density


def _damage(survey: SurveyFiles) -> list[str]:
    """Say how many files are damaged, and which."""
    if not survey.damaged:
        return []
    count = len(survey.damaged)
    names = listed([name for name, _ in survey.damaged])
    return [
        (
            f"{count:,} of {len(survey.files) + count:,} files cannot be read ({names}): build "
            "refuses them, --skip-damaged goes on without."
        )
    ]


def _units(crs: Any | None) -> dict[str, Any] | None:
    """Units of a CRS's axes; heights are in the horizontal one where none is stated."""
    if crs is None:
        return None
    axes = [axis for part in parts_of(crs) if part is not None for axis in part.axis_info]
    level = [axis for axis in axes if axis.direction not in ("up", "down")]
    upright = [axis for axis in axes if axis.direction in ("up", "down")]
    if not level:
        return None
    height = upright[0] if upright else level[0]
    is_angle = bool(crs.is_geographic)
    return {
        "horizontal": level[0].unit_name,
        "horizontal_m": None if is_angle else level[0].unit_conversion_factor,
        "vertical": height.unit_name,
        "vertical_m": None if is_angle and not upright else height.unit_conversion_factor,
        **_axes(crs),
    }


def _axes(crs: CRS) -> dict[str, list[str]]:
    """Name the directions of x, y and z where they are not east, north and up."""
    horizontal = parts_of(crs)[0]
    if horizontal is None or horizontal.is_geographic or horizontal.is_geocentric:
        return {}
    try:
        directions, _ = plan_axes(horizontal)
    except UnusableAxesError:
        return {}
    height = height_axis(crs)
    axes = (*directions, "up" if height is None else height[0])
    return {} if axes == EAST_NORTH_UP else {"axes": [*axes]}


def _density(sample: SurveySample) -> dict[str, Any]:
    """Points per area of the whole survey: percentiles of inner cells, and a coarse map."""
    fine = sample.density
    wide = widened(fine, _WIDER)
    scale = 1.0 / (wide.cell_m**2 * sample.local_share)
    cells = wide.counts[wide.inner]
    if not sample.whole:
        # Of a sample the ground between its pieces says nothing: densities at its points instead.
        cells = np.repeat(cells, np.ceil(cells * (_DRAWN / cells.sum())).astype(np.int64))
    low, middle, high = np.percentile(cells * scale, [p for _, p in _PERCENTILES])
    coarse = widened(fine, max(1, -(-max(fine.counts.shape) // MAP_COLUMNS)))
    rows = coarse.counts / (coarse.cell_m**2 * sample.local_share)
    return {
        "points_per_m2": {
            name: float(f"{value:.5g}")
            for (name, _), value in zip(_PERCENTILES, (low, middle, high), strict=True)
        },
        "map": {
            "cell_m": coarse.cell_m,
            "west": coarse.west / sample.units.horizontal_m,
            "north": coarse.north / sample.units.horizontal_m,
            "points_per_m2": [[float(f"{value:.3g}") for value in row] for row in rows],
        },
    }


def _bounds(sample: SurveySample) -> list[list[float]]:
    """Corners of all points, in the survey's own units."""
    ends = np.sort(sample.units.from_metres(np.array([sample.low, sample.high])), axis=0)
    return [ends[0].tolist(), ends[1].tolist()]


def _gaps(sample: SurveySample) -> list[dict[str, float]]:
    if not sample.gaps:
        return []
    places = sample.units.from_metres(np.array([(gap.east, gap.north) for gap in sample.gaps]))
    return [
        {"area_m2": gap.area_m2, "east": x, "north": y}
        for gap, (x, y) in zip(sample.gaps, places.tolist(), strict=True)
    ]


def _point_warnings(sample: SurveySample, facts: dict[str, Any]) -> list[str]:
    """Say what looks wrong by what was measured; the worst first."""
    warnings = []
    copies = facts["duplicates"]
    if copies["share"] >= _MANY_COPIES:
        warnings.append(
            f"{copies['share']:.1%} of the points are there twice ({copies['records']:,} records "
            f"that equal another, {copies['positions']:,} more at the place of another): each "
            "place is built once."
        )
    ratio = facts["spacing"]["noise_spacings"]
    if ratio >= _NOISY:
        warnings.append(
            f"The points scatter {_metres(facts['spacing']['noise_m'])} about their surface, "
            f"{ratio:.1f} times their spacing: they are smoothed, and detail below that is lost."
        )
    if sample.outliers >= _MANY_OUTLIERS:
        warnings.append(f"{sample.outliers:.1%} of the points stand alone and would be dropped.")
    spread = facts["density"]["points_per_m2"]
    if sample.whole and spread["p95"] >= _UNEVEN * max(spread["p5"], 1e-12):
        warnings.append(
            f"The density is uneven: {spread['p5']:,.3g} points per m2 in thin places, "
            f"{spread['p95']:,.3g} in dense ones; all are built with cells of one size."
        )
    missing_m2 = sum(gap.area_m2 for gap in sample.gaps)
    if missing_m2 >= _GAP_SHARE * sample.ground_m2:
        first = facts["ground"]["gaps"][0]
        warnings.append(
            f"{missing_m2:,.0f} m2 within the survey have no points, {first['area_m2']:,.0f} m2 "
            f"of them at {first['east']:,.0f}, {first['north']:,.0f}: they become holes, or are "
            "bridged."
        )
    return warnings


def _metres(value_m: float) -> str:
    return f"{value_m * 1000:,.0f} mm" if value_m < 1.0 else f"{value_m:,.2f} m"
