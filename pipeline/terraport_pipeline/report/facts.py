"""What a report says in words and numbers, taken from a scene's manifest, index and records."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_pipeline.engines.palettes import distinct_colours
from terraport_pipeline.mesh_statement import MESH
from terraport_pipeline.option import format_bytes
from terraport_pipeline.progress import format_fact
from terraport_pipeline.region_table import region_rows
from terraport_pipeline.report.change_map import ChangeFacts, change_facts
from terraport_pipeline.report.class_facts import name_table
from terraport_pipeline.report.histogram import Histogram, histogram
from terraport_pipeline.report.scene_colour import SceneColour
from terraport_pipeline.report.survey_crs import crs_line, tiles_line
from terraport_pipeline.report.survey_units import SurveyUnit
from terraport_pipeline.survey.one_survey import OUTSIDE
from terraport_store import DamagedSceneError, Manifest, RegionNames, Scene, read_labels
from terraport_store.layout import BASE, ENCODING

__all__ = [
    "ReportFacts",
    "collect_facts",
    "extent_line",
    "input_line",
    "named_count",
    "points_note",
    "read_build_record",
]

MAX_REGIONS: Final = 20
"""Largest regions that the table lists."""

MAX_RECORD_BYTES: Final = 4 << 20
"""Largest build.json that is read."""

MAX_INPUTS: Final = 20
"""Files of the survey that are named; build.json has all."""


@dataclass(frozen=True, slots=True)
class ReportFacts:
    """Everything the page says beside the pictures."""

    name: str
    cards: tuple[dict[str, str], ...]
    has_input: bool
    segment_faces: Histogram
    segment_bytes: Histogram
    regions: tuple[dict[str, Any], ...]
    region_columns: tuple[str, ...]
    regions_note: str
    name_columns: tuple[str, ...]
    names: tuple[tuple[str, ...], ...]
    """Areas and volumes of all regions of a name, together; empty where none has one."""
    change: ChangeFacts | None
    """None where the scene was not built over another."""
    files: tuple[dict[str, Any], ...]
    attributes: tuple[dict[str, str], ...]
    stages: tuple[dict[str, Any], ...]
    stages_note: str
    details: tuple[dict[str, str], ...]
    """Of the survey: input, files, colour, CRS."""
    internals: tuple[dict[str, str], ...]
    """Of what is streamed, and of the format."""
    options: str
    terraport: str


def collect_facts(scene: Scene, *, has_input: bool, has_change_map: bool = False) -> ReportFacts:
    """Read what a report says.

    Parameters
    ----------
    scene : Scene
        Open.
    has_input : bool
        Whether there is a picture of the input.
    has_change_map : bool
        Whether there is one of what the last survey changed.

    Returns
    -------
    ReportFacts
    """
    # (1) Distributions, regions, stages: what index and records say.
    manifest, index = scene.manifest, scene.index
    faces, lengths = histogram(index.face_count), histogram(index.length)
    assert faces is not None  # a scene has at least one segment
    assert lengths is not None
    columns, regions, note = _regions(scene)
    name_columns, names = _names(scene)
    record = read_build_record(scene.path)
    stages, stages_note = _stages(record)
    # (2) Size and frame: what the manifest says. Values stay plain, words and units are theirs.
    total = sum(info.bytes for info in manifest.files.values())
    return ReportFacts(
        name=manifest.name,
        cards=_cards(scene, total),
        has_input=has_input,
        segment_faces=faces,
        segment_bytes=lengths,
        regions=regions,
        region_columns=columns,
        regions_note=note,
        name_columns=name_columns,
        names=names,
        change=_change(scene, has_map=has_change_map),
        files=tuple(
            {"name": key, "bytes": info.bytes, "share": info.bytes / max(1, total)}
            for key, info in sorted(manifest.files.items(), key=lambda item: -item[1].bytes)
        ),
        attributes=tuple(
            {
                "name": one.name,
                "min": "" if one.min is None else f"{one.min:.6g}",
                "max": "" if one.max is None else f"{one.max:.6g}",
                "step": f"{one.step:.3g}",
            }
            for one in manifest.attributes
        ),
        stages=stages,
        stages_note=stages_note,
        details=_details(scene, record),
        internals=_internals(scene, record),
        options=json.dumps(manifest.build.options, indent=1) if manifest.build.options else "",
        terraport=manifest.build.terraport,
    )


def read_build_record(scene_path: Path) -> dict[str, Any]:
    """Read what the build said of itself.

    Parameters
    ----------
    scene_path : Path
        The scene directory.

    Returns
    -------
    dict
        Contents of build.json; empty when it is not there or not a JSON object: a report does not
        fail for want of timings.
    """
    try:
        with (scene_path / "build.json").open("rb") as file:
            data = file.read(MAX_RECORD_BYTES + 1)
        record = json.loads(data) if len(data) <= MAX_RECORD_BYTES else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def input_line(record: Mapping[str, Any]) -> str:
    """Say which files a scene was built from; empty where ``build.json`` does not say it.

    Parameters
    ----------
    record : mapping
        With ``inputs``, as :func:`terraport_pipeline.workflow.read_step.inputs_of` makes them.
    """
    files = _rows(record, "inputs")
    if not files:
        return ""
    size = format_bytes(sum(_number(file.get("bytes"), 0.0) for file in files))
    if len(files) == 1:
        return f"{files[0].get('name')}, {size}"
    if files[0].get("format") == MESH:
        return f"{files[0].get('name')} with {len(files) - 1:,} files beside it, {size}"
    points = sum(_number(file.get("points"), 0.0) for file in files)
    repeats = sum(_number(file.get("repeats"), 0.0) for file in files)
    names = [str(file.get("name")) for file in files[:MAX_INPUTS]]
    more = f" and {len(files) - MAX_INPUTS:,} more" if len(files) > MAX_INPUTS else ""
    return (
        f"{len(files):,} files, {size}, {points:,.0f} points ({repeats:,.0f} of them in several, "
        f"taken once): {', '.join(names)}{more}"
    )


def points_note(manifest: Manifest) -> str:
    """Say what a scene's points are: of a survey, or of a mesh that was brought."""
    is_mesh = MESH in manifest.build.options
    return "vertices of the mesh" if is_mesh else "used of the survey"


def extent_line(record: Mapping[str, Any]) -> str:
    """Say which extent a scene was built from; empty where it is all of the survey.

    Parameters
    ----------
    record : mapping
        With ``extent``, as :func:`terraport_pipeline.workflow.read_step.inputs_of` makes it.
    """
    extent = record.get("extent")
    values = extent.get("values") if isinstance(extent, Mapping) else None
    if not isinstance(extent, Mapping) or not isinstance(values, list):
        return ""
    corners = " ".join(f"{_number(value, np.nan):.15g}" for value in values)
    files = _number(extent.get("files"), 0.0)
    among = f", {files:,.0f} whole files among them" if files else ""
    return (
        f"{corners} in the files' coordinates; {_number(extent.get('points'), 0.0):,.0f} points "
        f"lie outside it{among}"
    )


def _files_beside(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows on files that were not read: damaged ones, and what is no survey."""
    rows = []
    for title, damaged in (("damaged files, left out", True), ("files not read", False)):
        each = [
            f"{file.get('name')} ({file.get('reason')})"
            for file in _rows(record, "left_out")
            if bool(file.get("damaged")) == damaged and file.get("reason") != OUTSIDE
        ]
        if each:
            more = f" and {len(each) - MAX_INPUTS:,} more" if len(each) > MAX_INPUTS else ""
            rows.append((title, "; ".join(each[:MAX_INPUTS]) + more))
    return rows


def _rows(record: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    listed = record.get(key)
    return [row for row in listed if isinstance(row, Mapping)] if isinstance(listed, list) else []


def _cards(scene: Scene, total_bytes: int) -> tuple[dict[str, str], ...]:
    manifest = scene.manifest
    counts = manifest.counts
    payload = manifest.encodings[ENCODING].payload_bytes
    return (
        {"label": "points", "value": f"{counts.points:,}", "note": points_note(manifest)},
        {
            "label": "detail",
            "value": f"{counts.detail_faces:,}",
            "note": f"triangles, {counts.detail_vertices:,} vertices",
        },
        {
            "label": "base",
            "value": f"{counts.base_faces:,}",
            "note": f"triangles, {format_bytes(manifest.files[BASE].bytes)}",
        },
        {
            "label": "segments",
            "value": f"{counts.segments:,}",
            "note": f"{format_bytes(payload / max(1, counts.segments))} on average",
        },
        {"label": "regions", "value": f"{counts.regions:,}", "note": ""},
        {
            "label": "scene",
            "value": format_bytes(total_bytes),
            "note": f"{payload / max(1, counts.detail_faces):.2f} bytes per triangle",
        },
    )


def _regions(scene: Scene) -> tuple[tuple[str, ...], tuple[dict[str, Any], ...], str]:
    """Table of the largest regions: columns, rows, and a note."""
    # (1) Names and labels; damaged labels cost the labels, not the table.
    try:
        names = RegionNames.of(scene.regions, file=scene.manifest.files["regions.json"].path)
    except DamagedSceneError as error:
        return (), (), str(error)
    problem = ""
    try:
        names = names.with_labels(read_labels(scene.path))
    except DamagedSceneError as error:
        problem = f" Labels are left out: {error}."
    # (2) One row per region, largest first.
    rows = region_rows(names, scene.regions, scene.manifest.origin)
    unit = SurveyUnit.of(scene.manifest)
    colours = distinct_colours(len(rows))
    columns: tuple[str, ...] = (
        "label",
        f"surface {unit.name}²",
        "triangles",
        "mean colour",
        "slope",
        "roughness m",
        f"height {unit.height_name}",
    )
    table: list[dict[str, Any]] = [
        {
            "name": f"{row['region'] if row['stable_id'] is None else row['stable_id']}",
            "colour": _css(colours[row["region"]]),
            "cells": _region_cells(row, unit),
        }
        for row in rows[:MAX_REGIONS]
    ]
    # (3) Only columns that say something.
    # A column that nobody filled is not shown.
    filled = [
        any(row["cells"][index]["text"] or row["cells"][index]["swatch"] for row in table)
        for index in range(len(columns))
    ]
    for row in table:
        row["cells"] = [cell for cell, full in zip(row["cells"], filled, strict=True) if full]
    columns = tuple(column for column, full in zip(columns, filled, strict=True) if full)
    scale = _number(scene.regions.get("roughness_scale_m"), np.nan)
    note = (
        f"The {len(table)} largest of {len(rows)} regions, largest first; the colour is that of "
        "the picture"
        + (", the number the stable id" if names.stable_ids is not None else "")
        + "."
        + ("" if np.isnan(scale) else f" Roughness is measured in cubes of {scale:g} m.")
        + problem
    )
    return columns, tuple(table), note


def _named_rows(scene: Scene) -> list[dict[str, Any]]:
    """Rows of all regions with the labels that can be read; none where regions cannot."""
    try:
        names = RegionNames.of(scene.regions, file=scene.manifest.files["regions.json"].path)
    except DamagedSceneError:
        return []  # said where the regions are
    with contextlib.suppress(DamagedSceneError):
        names = names.with_labels(read_labels(scene.path))
    return region_rows(names, scene.regions, scene.manifest.origin)


def _names(scene: Scene) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    return name_table(_named_rows(scene), SurveyUnit.of(scene.manifest))


def _change(scene: Scene, *, has_map: bool) -> ChangeFacts | None:
    """Volumes of the regions, with their colours in the picture of regions."""
    rows = _named_rows(scene)
    facts = change_facts(scene.regions, rows, has_map=has_map, unit=SurveyUnit.of(scene.manifest))
    colours = distinct_colours(len(rows))
    for row in () if facts is None else facts.rows:
        row["colour"] = "" if row["region"] is None else _css(colours[row["region"]])
    return facts


def _region_cells(row: Mapping[str, Any], unit: SurveyUnit) -> list[dict[str, str]]:
    low, high = row["lowest_m"], row["highest_m"]
    texts = (
        row["label"],
        _formatted(row["surface_area_m2"], "{:,.0f}", unit.plan_m**2),
        _formatted(row["faces"], "{:,.0f}"),
        "",
        _formatted(row["slope_deg"], "{:.0f}°"),
        _formatted(row["roughness_m"], "{:.3f}"),
        "" if low is None or high is None else f"{unit.height(low)} to {unit.height(high)}",
    )
    cells = [{"text": text, "swatch": ""} for text in texts]
    cells[3]["swatch"] = row["mean_colour"] or ""
    return cells


def _formatted(value: float | None, form: str, unit: float = 1.0) -> str:
    return "" if value is None else form.format(value / unit)


def _stages(record: Mapping[str, Any]) -> tuple[tuple[dict[str, Any], ...], str]:
    listed = [row for row in record.get("stages", []) if isinstance(row, Mapping)]
    seconds = [_number(row.get("seconds"), 0.0) for row in listed]
    whole = sum(seconds)
    rows = []
    for row, spent in zip(listed, seconds, strict=True):
        memory = _number(row.get("peak_bytes"), 0.0)
        counts = row.get("counts")
        result = (
            # Most zeros are exceptions that did not occur.
            ", ".join(named_count(key, value) for key, value in counts.items() if value)
            if isinstance(counts, Mapping)
            else ""
        )
        skipped = bool(row.get("taken_up"))
        rows.append(
            {
                "name": str(row.get("name", "?")),
                "seconds": "taken up" if skipped else f"{spent:,.1f}",
                "share": 0.0 if skipped or not whole else spent / whole,
                "memory": format_bytes(memory) if memory else "",
                "result": result,
            }
        )
    total = _number(record.get("seconds"), whole)
    return tuple(rows), f"{total:,.1f} seconds in all." if rows else ""


def _details(scene: Scene, record: Mapping[str, Any]) -> tuple[dict[str, str], ...]:
    """Say what the scene was made of."""
    manifest = scene.manifest
    source, unit = manifest.build.input, SurveyUnit.of(manifest)
    rows = [
        ("input", input_line(record) or (source.name if source else "not stated")),
        *((("extent", line),) if (line := extent_line(record)) else ()),
        *_files_beside(record),
        ("colour", str(SceneColour.of(manifest))),
        ("coordinate reference system", crs_line(manifest)[0]),
        ("box of the scene", _box(manifest)),
        ("units", unit.full_name),
        ("as 3D Tiles", tiles_line(manifest)),
        ("version", manifest.version),
    ]
    return tuple({"label": label, "value": value} for label, value in rows)


def _internals(scene: Scene, record: Mapping[str, Any]) -> tuple[dict[str, str], ...]:
    """Say what is streamed, and how finely; in metres, as the scene's format has it."""
    manifest = scene.manifest
    limits = manifest.limits
    origin = ", ".join(f"{value:,.3f}" for value in manifest.origin)
    rows = [
        ("origin (east, north, height)", f"{origin} m"),
        *_reconstruction(record),
        ("grid step", f"{manifest.step_m * 1000:.4g} mm"),
        (
            "base to detail",
            f"{manifest.hand_off.deviation_m:.3g} m apart (99.9th percentile)",
        ),
        (
            "cover",
            f"segments within {manifest.hand_off.tolerance_m:.3g} m lie over a base face",
        ),
        ("largest segment", f"{limits.max_segment_faces:,} triangles"),
        ("largest payload", format_bytes(limits.max_segment_bytes)),
        ("widest segment", f"{limits.max_extent_m:.1f} m"),
        ("format", f"{manifest.format} {manifest.format_version}"),
    ]
    return tuple({"label": label, "value": value} for label, value in rows)


def _reconstruction(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How fine the surface was solved beside how dense the survey is, where the build says so."""
    counts: dict[str, Any] = {}
    for row in record.get("stages", []):
        if isinstance(row, Mapping) and isinstance(row.get("counts"), Mapping):
            counts.update(row["counts"])
    cell_m, spacing_m = (_number(counts.get(name), 0.0) for name in ("cell_m", "spacing_m"))
    if not cell_m or not spacing_m:
        return []
    line = f"cells of {cell_m:.3g} m; a sample every {spacing_m:.3g} m"
    smoothing_m, noise_m = (_number(counts.get(name), 0.0) for name in ("smoothing_m", "noise_m"))
    if smoothing_m:
        line += f"; noise of {noise_m:.2g} m, smoothed over {smoothing_m:.2g} m about each sample"
    return [("reconstruction", line)]


def _box(manifest: Manifest) -> str:
    """Say the box of a scene in the survey's own coordinates and units."""
    unit = SurveyUnit.of(manifest)
    (east, north, height), low, high = manifest.origin, manifest.bounds.min, manifest.bounds.max
    axes = (
        ("E", east + low[0], east + high[0], unit.plan_m),
        ("N", north - high[2], north - low[2], unit.plan_m),
        ("H", height + low[1], height + high[1], unit.height_m),
    )
    return ", ".join(f"{axis} {a / m:,.2f} to {b / m:,.2f}" for axis, a, b, m in axes)


def _css(colour: Any) -> str:
    red, green, blue = (max(0, min(255, round(float(value)))) for value in colour)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _number(value: object, default: float) -> float:
    return (
        float(value) if isinstance(value, int | float) and not isinstance(value, bool) else default
    )


def named_count(name: str, value: object) -> str:
    """Format one count of a stage, with the unit from its name.

    Examples
    --------
    >>> named_count("cut_m3", 3925.8813691526675), named_count("changed_share", 1 / 6)
    ('cut 3,926 m3', 'changed 16.7%')
    >>> named_count("cell_m", 0.05), named_count("bytes_per_face", 11.84512)
    ('cell 0.05 m', 'bytes per face 11.85')
    """
    words = name.replace("_", " ")
    if isinstance(value, int | float) and not isinstance(value, bool):
        if name.endswith("_share"):
            return f"{words[:-6]} {value:.1%}"
        if name.endswith("_bytes"):
            return f"{words[:-6]} {format_bytes(value)}"
        for unit in ("m", "m2", "m3"):
            if name.endswith(f"_{unit}"):
                return f"{words.removesuffix(unit)}{format_fact(value)} {unit}"
    return f"{words} {format_fact(value)}"
