"""``terraport list``: which scenes there are."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors

if TYPE_CHECKING:
    from terraport_pipeline.upkeep.listing import SceneRow

__all__ = ["list_command", "register"]

_WIDE: Final = 130
"""Characters of a line that have room for extent and CRS beside the rest."""

_PIPED_WIDTH: Final = 200
"""Characters of a line where nobody says how wide the screen is."""


def register(app: typer.Typer) -> None:
    """Add ``terraport list`` to the command line `app`."""
    app.command("list")(list_command)


def list_command(
    location: Annotated[
        str,
        typer.Argument(
            metavar="[DIR]",
            help="Folder of scenes, one scene, or the address of either (s3://BUCKET/PREFIX).",
        ),
    ] = ".",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """List scenes: version, size, extent, CRS, when published, and what builds keep beside them.

    A scene that is being built now, or whose build was stopped before it published anything, is
    listed too: its work directory is what the same build command goes on from, or what terraport rm
    --work frees.

    For example:

        terraport list scenes

        terraport list s3://bucket/scenes

        terraport list scenes --json | jq '.[].version'
    """
    from terraport_pipeline.upkeep.listing import list_rows

    with reporting_errors(Console(stderr=True, soft_wrap=True)):
        rows = list(list_rows(location))
    if as_json:
        typer.echo(json.dumps([plain_row(row) for row in rows], indent=1))
        return
    console = Console()
    if not console.is_terminal:
        console.width = _PIPED_WIDTH
    if not rows:
        console.print(f"no scene in {location}", markup=False, highlight=False)
        return
    is_wide = console.width >= _WIDE
    console.print(_table(rows, is_wide=is_wide))
    for row in () if is_wide else rows:
        if row.extent is not None:
            text = f"{row.name}: {row.extent}, {_crs_name(row)}"
            console.print(text, markup=False, highlight=False, soft_wrap=True)
    for row in rows:
        if row.problem is not None:
            console.print(f"{row.name}: {row.problem}", markup=False, highlight=False)


def plain_row(row: SceneRow) -> dict[str, Any]:
    """Return a row's facts as ``--json`` names them."""
    manifest = row.manifest
    counts = None if manifest is None else manifest.counts
    crs = None if manifest is None else manifest.crs
    return {
        "name": row.name,
        "location": row.location,
        "state": row.state,
        "title": None if manifest is None else manifest.name,
        "version": None if manifest is None else manifest.version,
        "faces": None if counts is None else counts.detail_faces,
        "base_faces": None if counts is None else counts.base_faces,
        "segments": None if counts is None else counts.segments,
        "regions": None if counts is None else counts.regions,
        "bytes": row.bytes,
        "extent": None if row.extent is None else asdict(row.extent),
        "crs": None if crs is None else {"name": crs.name, "epsg": crs.epsg},
        "published": None if row.published is None else row.published.isoformat("T", "seconds"),
        "build_process": row.build_process,
        "work": None if row.work is None else asdict(row.work),
        "problem": row.problem,
    }


def _crs_name(row: SceneRow) -> str:
    crs = None if row.manifest is None else row.manifest.crs
    return "CRS not stated" if crs is None else crs.name


def _table(rows: list[SceneRow], *, is_wide: bool) -> Table:
    """Draw a row per scene; where it is needs a wide screen."""
    from terraport_pipeline.option import format_bytes

    table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("scene", overflow="fold")
    table.add_column("version", no_wrap=True)
    for name in ("triangles", "segments", "on disk", "work"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("published", no_wrap=True)
    if is_wide:
        table.add_column("extent")
        table.add_column("CRS")
    for row in rows:
        manifest = row.manifest
        published = "" if row.published is None else f"{row.published.astimezone():%Y-%m-%d %H:%M}"
        state = "" if row.state == "published" else row.state
        if row.build_process is not None:
            state += f" (process {row.build_process})"
        counts = None if manifest is None else manifest.counts
        where: list[str | Text] = []
        if is_wide and row.extent is not None:
            where = [str(row.extent), Text(_crs_name(row))]
        table.add_row(
            Text(row.name, "bold"),
            "" if manifest is None else manifest.version[:12],
            "" if counts is None else f"{counts.detail_faces:,}",
            "" if counts is None else f"{counts.segments:,}",
            format_bytes(row.bytes) if row.bytes else "",
            "" if row.work is None else format_bytes(row.work.bytes),
            Text.assemble(published, " " if published and state else "", (state, "yellow")),
            *where,
        )
    return table
