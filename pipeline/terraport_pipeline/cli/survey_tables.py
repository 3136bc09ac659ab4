"""A survey's files as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.console import Group
from rich.table import Table
from rich.text import Text

from terraport_pipeline.report.facts import format_bytes

__all__ = ["survey_tables"]

_FILES: Final = 30
"""Files in the table; --json has all."""


def survey_tables(facts: Mapping[str, Any]) -> Group:
    """Draw the facts of :func:`terraport_pipeline.survey_inspection.inspect_survey`."""
    files, crs = facts["files"], facts["crs"]
    count = "" if len(files) == 1 else f"{len(files):,} files, "
    heading = Text.assemble(
        (str(facts["name"]), "bold"),
        f"  {count}{facts['points']:,} points, {format_bytes(facts['bytes'])}",
    )
    summary = Table(show_header=False, box=None, pad_edge=False)
    summary.add_row("coordinate reference system", crs["name"] if crs else "not stated")
    if facts["bounds"]:
        for axis, span in zip(("east", "north", "height"), _spans(facts["bounds"]), strict=True):
            summary.add_row(axis, span)
    if within := facts.get("within"):
        corners = " ".join(f"{value:.15g}" for value in within["values"])
        summary.add_row("extent", corners)
        summary.add_row(
            "within it", f"about {within['points']:,} points; {within['read']:,} are read for that"
        )
    table = Table()
    table.add_column("file")
    table.add_column("kind")
    for name in ("points", "bytes", "east", "north"):
        table.add_column(name, justify="right")
    for file in files[:_FILES]:
        east, north, _ = _spans(file["bounds"], 0) if file["bounds"] else ("", "", "")
        size = format_bytes(file["bytes"])
        table.add_row(file["name"], file["format"], f"{file['points']:,}", size, east, north)
    notes = [Text(f"and {len(files) - _FILES:,} more files")] if len(files) > _FILES else []
    for other in facts["left_out"][:_FILES]:
        style = "yellow" if other["damaged"] else ""
        kind = "damaged" if other["damaged"] else "not read"
        notes.append(Text(f"{kind}: {other['name']} ({other['reason']})", style=style))
    return Group(heading, summary, table, *notes)


def _spans(bounds: Sequence[Sequence[float]], digits: int = 2) -> tuple[str, str, str]:
    """Write least and greatest value of every axis; files' in whole metres, to fit a line."""
    east, north, height = (
        f"{low:,.{digits}f} .. {high:,.{digits}f}" for low, high in zip(*bounds, strict=True)
    )
    return east, north, height
