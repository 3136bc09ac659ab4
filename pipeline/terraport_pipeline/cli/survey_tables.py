"""A survey as tables for a terminal: its files first, then its points and what a build takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from terraport_pipeline.engines.readers.survey_colours import DEPTH_TEXTS
from terraport_pipeline.geometry.clouds.density_map import DensityMap, draw_text
from terraport_pipeline.option import format_bytes

__all__ = ["forecast_table", "point_tables", "survey_tables"]

_FILES: Final = 12
"""Files in the table; --json has all."""

_CODES: Final = 6
"""Values of an attribute that are listed, most frequent first; --json has all."""

_GAPS: Final = 3

_BY_SIZE: Final = frozenset({"xyz", "pcd"})
"""Formats whose points are told by their bytes until they are read."""


def survey_tables(facts: Mapping[str, Any]) -> Group:
    """Draw the facts of :func:`terraport_pipeline.survey_inspection.inspect_headers`."""
    files, crs, units = facts["files"], facts["crs"], facts["units"]
    count = "" if len(files) == 1 else f"{len(files):,} files, "
    about = "about " if any(file["format"] in _BY_SIZE for file in files) else ""
    heading = Text.assemble(
        (str(facts["name"]), "bold"),
        f"  {count}{about}{facts['points']:,} points, {format_bytes(facts['bytes'])}",
    )
    # (1) What looks wrong, then what it is and where.
    doubts = _doubts(facts["refused"], facts["warnings"])
    summary = _facts()
    named = "not stated"
    if crs is not None:
        named = crs["name"] + (f" (EPSG:{crs['epsg']})" if crs["epsg"] else "")
    summary.add_row("coordinate reference system", named)
    if units is not None:
        same = units["horizontal"] == units["vertical"]
        heights = "" if same else f", heights in {units['vertical']}"
        summary.add_row("unit", units["horizontal"] + heights)
    axes = _axis_names(units)
    if facts["bounds"]:
        for axis, span in zip(axes, _spans(facts["bounds"]), strict=True):
            summary.add_row(axis, span)
    if within := facts.get("within"):
        corners = " ".join(f"{value:.15g}" for value in within["values"])
        summary.add_row("extent", corners)
        summary.add_row(
            "within it", f"about {within['points']:,} points; {within['read']:,} are read for that"
        )
    # (2) The files.
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("file")
    table.add_column("kind")
    for name in ("points", "bytes", *axes[:2]):
        table.add_column(name, justify="right")
    for file in files[:_FILES]:
        east, north, _ = _spans(file["bounds"], ".0f") if file["bounds"] else ("", "", "")
        size = format_bytes(file["bytes"])
        table.add_row(file["name"], file["format"], f"{file['points']:,}", size, east, north)
    notes = [Text(f"and {len(files) - _FILES:,} more files")] if len(files) > _FILES else []
    for other in facts["left_out"][:_FILES]:
        style = "yellow" if other["damaged"] else ""
        kind = "damaged" if other["damaged"] else "not read"
        notes.append(Text(f"{kind}: {other['name']} ({other['reason']})", style=style))
    listed = [table] if len(files) > 1 or not facts["bounds"] else []
    return Group(heading, *doubts, summary, *listed, *notes)


def point_tables(facts: Mapping[str, Any], known: Sequence[str] = ()) -> Group:
    """Draw what :func:`terraport_pipeline.survey_inspection.inspect_points` added.

    Parameters
    ----------
    facts : mapping
    known : sequence of str
        Warnings that were shown already.
    """
    fresh = [text for text in facts["warnings"] if text not in known]
    doubts = _doubts(facts["refused"], fresh)
    if "sample" not in facts:
        return Group(*doubts)
    return Group(
        *doubts,
        _measures(facts),
        *_attributes(facts),
        *_map(facts),
        forecast_table(facts["forecast"], "A build"),
    )


def _doubts(refused: str | None, warnings: Sequence[str]) -> list[RenderableType]:
    first = [Text(f"build refuses it: {refused}", style="bold red")] if refused else []
    return [*first, *(Text(f"look: {text}", style="yellow") for text in warnings)]


def _facts() -> Table:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    return table


def _measures(facts: Mapping[str, Any]) -> Table:
    """Draw density, spacing, noise, copies, colours."""
    sample, ground, spacing = facts["sample"], facts["ground"], facts["spacing"]
    table = _facts()
    files = "" if len(facts["files"]) == 1 else f" in {sample['files']:,} files"
    read = "all of them" if sample["whole"] else f"{sample['share']:.1%} of them{files}"
    table.add_row("points read", f"{sample['points']:,}, {read}, in {sample['seconds']:.1f} s")
    if all(file["bounds"] is None for file in facts["files"]) and facts["bounds"]:
        for axis, span in zip(("east", "north", "height"), _spans(facts["bounds"]), strict=True):
            table.add_row(axis, span)
    density = facts["density"]["points_per_m2"]
    about = "" if sample["whole"] else "about "
    table.add_row(
        "density",
        f"{about}{_number(density['median'])} points per m2 ({_number(density['p5'])} .. "
        f"{_number(density['p95'])})",
    )
    table.add_row(
        "ground",
        f"{about}{_area(ground['area_m2'])} from above, {_area(ground['surface_m2'])} of surface",
    )
    for gap in (ground["gaps"] or [])[:_GAPS]:
        table.add_row(
            "without points", f"{_area(gap['area_m2'])} at {gap['east']:,.0f}, {gap['north']:,.0f}"
        )
    table.add_row("spacing", f"{about}{_length(spacing['surface_m'])} along the surface")
    table.add_row(
        "noise",
        f"{_length(spacing['noise_m'])} across it, {spacing['noise_spacings']:.2f} spacings",
    )
    copies = facts["duplicates"]
    table.add_row(
        "there twice",
        f"{copies['records'] + copies['positions']:,} points ({copies['share']:.2%})",
    )
    table.add_row("alone", f"{facts['outliers_share']:.2%} of the points")
    colours = facts["colours"]
    if colours is None:
        table.add_row("colours", "none")
    else:
        depths = ", ".join(DEPTH_TEXTS.get(depth, depth) for depth in colours["depths"])
        black = f", {colours['black_share']:.1%} black" if colours["black_share"] else ""
        table.add_row("colours", f"{depths}, {colours['distinct']:,} different ones{black}")
    return table


def _attributes(facts: Mapping[str, Any]) -> list[RenderableType]:
    if not facts["attributes"]:
        return [Text("no attributes but the coordinates")]
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("attribute", "type", "least", "greatest", "values"):
        table.add_column(name, justify="right" if name in ("least", "greatest") else "left")
    for column in facts["attributes"]:
        low, high = column["min"], column["max"]
        ends = ("-", "-") if low is None else (f"{low:,.7g}", f"{high:,.7g}")
        values = column["values"] or {}
        often = sorted(values.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{value}: {count:,}" for value, count in often[:_CODES])
        if len(often) > _CODES:
            listed += f" and {len(often) - _CODES} more"
        if column["missing"]:
            listed += f"{', ' if listed else ''}missing: {column['missing']:,}"
        table.add_row(escape(column["name"]), column["type"], *ends, listed)
    return [table]


def _axis_names(units: Mapping[str, Any] | None) -> tuple[str, str, str]:
    """Name the columns of coordinates by the directions in which they increase."""
    x, y, z = (units or {}).get("axes", ("east", "north", "up"))
    return x, y, "depth" if z == "down" else "height"


def _map(facts: Mapping[str, Any]) -> list[RenderableType]:
    rows = facts["density"]["map"]
    density = DensityMap(
        np.array(rows["points_per_m2"], np.float64), rows["west"], rows["north"], rows["cell_m"]
    )
    title = f"density from above, north up, a character is {_length(rows['cell_m'])} wide"
    return [Text(title, style="dim"), *(Text(line) for line in draw_text(density))]


def forecast_table(forecast: Mapping[str, Any], title: str) -> Table:
    """Draw what a build with default options is expected to make and take."""
    table = _facts()
    table.title, table.title_justify, table.title_style = title, "left", "bold"
    table.add_row(
        "faces",
        f"about {_about(forecast['faces'])}, cells of {_length(forecast['cell_m'])}; base about "
        f"{_about(forecast['base_faces'])}",
    )
    cores = "core" if forecast["cores"] == 1 else "cores"
    table.add_row("time", f"about {_time(forecast['seconds'])} on {forecast['cores']} {cores}")
    tiles = "one tile" if forecast["tiles"] == 1 else f"{forecast['tiles']:,} tiles"
    need, allowed = forecast["memory_bytes"] / 2**30, forecast["max_memory_bytes"] / 2**30
    table.add_row(
        "memory",
        f"about {need:.1f} GiB of the {allowed:.1f} it may take; {tiles}, "
        f"{forecast['workers']} at a time"
        if need <= allowed
        else f"about {need:.1f} GiB, for regions; allowed are {allowed:.1f}: terraport build "
        "refuses it without a larger --max-memory or --region-size",
    )
    table.add_row(
        "disk",
        f"about {format_bytes(forecast['scene_bytes'])} for the scene, "
        f"{format_bytes(forecast['work_bytes'])} beside it while it is built",
    )
    return table


def _spans(bounds: Sequence[Sequence[float]], form: str = ",.2f") -> tuple[str, str, str]:
    """Write least and greatest value of every axis; files' in whole units, to fit a line."""
    east, north, height = (
        f"{low:{form}} .. {high:{form}}" for low, high in zip(*bounds, strict=True)
    )
    return east, north, height


def _length(value_m: float) -> str:
    return f"{value_m * 1000:,.3g} mm" if value_m < 1.0 else f"{value_m:,.3g} m"


def _area(value_m2: float) -> str:
    if value_m2 < 100:
        return f"{value_m2:,.3g} m2"
    return f"{value_m2:,.0f} m2" if value_m2 < 1e5 else f"{value_m2 / 1e4:,.4g} ha"


def _number(value: float) -> str:
    return f"{value:,.3g}" if value < 100 else f"{value:,.0f}"


def _about(count: float) -> str:
    """Write a number with two figures: a forecast has no more."""
    if count < 1e6:
        return f"{float(f'{count:.2g}'):,.0f}"
    return f"{count / 1e6:,.1f} million"


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{float(f'{seconds:.2g}'):.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} minutes"
    return f"{seconds / 3600:.1f} hours"
