"""``terraport label``: see what the regions of a scene are called, and call them something."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.cli.extras import require_drawings
from terraport_pipeline.errors import OptionError

if TYPE_CHECKING:
    from terraport_store import RegionNames

__all__ = ["label", "regions_table", "register"]

_SHOWN: Final = 30
"""Regions that a terminal lists; the exported table has all."""

_TABLES: Final = (".csv", ".tsv", ".txt", "")
"""Endings of tables; what ends otherwise is a plan."""

_LABEL_WIDTH: Final = 16
"""Columns that labels get at least; longer ones go on in the next line."""


def register(app: typer.Typer) -> None:
    """Add ``terraport label`` to the command line `app`."""
    app.command("label")(label)


def label(
    scene: Annotated[
        str,
        typer.Argument(
            help="Scene directory; to see or to export its regions, also its address (s3://...).",
            show_default=False,
        ),
    ],
    table: Annotated[
        Path | None,
        typer.Argument(
            metavar="[TABLE|PLAN]",
            help="CSV with the columns stable_id and label; or a plan to cut the regions along: "
            "GeoJSON, Shapefile, GeoPackage, DXF. Without either: show the regions.",
            show_default=False,
        ),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(
            help="Write such a table with every region's facts; - writes to standard output.",
            show_default=False,
        ),
    ] = None,
    name_field: Annotated[
        str | None,
        typer.Option(
            metavar="PROPERTY",
            help="What names a plan's outlines. [default: name, label or layer]",
            show_default=False,
        ),
    ] = None,
    buffer_m: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="How far the region of a plan's open line (the centre line of a road) reaches to "
            "either side.",
            show_default=False,
        ),
    ] = None,
    layer: Annotated[
        str | None, typer.Option(help="Of a plan that has several.", show_default=False)
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(
            metavar="EPSG:CODE",
            help="What a plan's coordinates are in, where its file does not say (DXF) or says it "
            "wrong.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Call the regions of a scene something: "haul road", "stockpile 3", "water".

    A pick in VR then answers with that name. Three steps:

        terraport label scenes/pit --export regions.csv

        (open regions.csv in a spreadsheet; fill the column "label"; save it as CSV)

        terraport label scenes/pit regions.csv

    Which region is which: its area, centre, heights, colour, slope and roughness stand beside it,
    and the report (terraport report) shows every region in a colour of its own.

    What the mine has drawn already need not be typed:

        terraport label scenes/pit roads-and-stockpiles.gpkg

    cuts the regions along its outlines, which become regions of their own with their names. A
    triangle belongs to the outline that its centre lies in, of several to the smallest. The scene
    is published anew; clients load again what was cut, and nothing else.

    Labels belong to stable ids, so they are still there after the survey was built again: a region
    keeps its stable id as long as it is the same piece of ground. Rows that the table does not have
    keep their labels; an empty label takes one away. All rows are set or, if one is wrong, none.

    A service that runs (terraport serve) answers with the new labels within a second or so; nobody
    has to reconnect, and no client loads anything again. The report shows them when it is written
    again.
    """
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.region_table import read_label_changes, region_rows, region_table_text
    from terraport_store import change_labels, is_url, read_manifest, read_names

    console = Console(stderr=True, soft_wrap=True)
    # One of three: set labels from a table, write a table, or show the regions. Nothing is written
    # unless all of it can be.
    with reporting_errors(console):
        if table is not None and export is not None:
            raise OptionError(
                f"a table to read ({table}) and one to write ({export}); expected one of them"
            )
        if table is not None and is_url(scene):
            raise OptionError(
                f"{scene} is an address; set labels in the scene's folder, then: terraport upload "
                f"SCENE {scene}"
            )
        of_plans = {
            "--name-field": name_field,
            "--buffer-m": buffer_m,
            "--layer": layer,
            "--crs": crs,
        }
        is_plan = table is not None and table.suffix.lower() not in _TABLES
        for option, value in of_plans.items():
            if value is not None and not is_plan:
                raise OptionError(f"{option} is of plans (.geojson, .gpkg, .shp, .dxf)")
        if table is not None and is_plan:
            require_drawings("a plan")
            # What reads drawings is loaded for them alone.
            from terraport_pipeline.naming.plan import label_by_plan

            with RichProgress(console) as progress:
                said = label_by_plan(
                    Path(scene),
                    table,
                    progress,
                    name_field=name_field,
                    buffer_m=buffer_m,
                    layer=layer,
                    crs=crs,
                )
            for line in said:
                console.print(line, markup=False, highlight=False)
            return
        names, document = read_names(scene)
        if table is not None:
            changes = read_label_changes(table, names)
            now = change_labels(scene, changes)
            _print_changes(console, names, now)
            return
        if export is not None and export.exists():
            raise OptionError(
                f"{export} exists, expected a new file: it may hold labels that were not set yet"
            )
        rows = region_rows(names, document, read_manifest(scene).origin)
        if export is None:
            Console().print(regions_table(rows, _SHOWN))
            _print_lost(console, names)
        elif str(export) == "-":
            typer.echo(region_table_text(rows), nl=False)
        else:
            # With a byte order mark, without which some spreadsheets take UTF-8 for something else.
            export.write_text(region_table_text(rows), encoding="utf-8-sig")
            text = f"{export}: {len(rows)} regions, {_labelled(names)} of them with a label"
            console.print(text, markup=False, highlight=False)
            _print_lost(console, names)


def regions_table(rows: list[dict[str, Any]], shown: int) -> Table:
    """Make a table for a terminal of the largest regions.

    Parameters
    ----------
    rows : list of dict
        From ``region_rows``.
    shown : int
        At most so many.
    """
    title = "Regions, largest first" + (f" ({shown} of {len(rows)})" if len(rows) > shown else "")
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=None,
        header_style="dim",
        pad_edge=False,
        padding=(0, 2, 0, 0),
    )
    for name in (
        "stable id",
        "label",
        "surface m²",
        "slope °",
        "rough m",
        "from m",
        "to m",
        "colour",
    ):
        table.add_column(
            name,
            justify="left" if name in ("label", "colour") else "right",
            no_wrap=name != "label",
            min_width=_LABEL_WIDTH if name == "label" else None,
        )
    for row in rows[:shown]:
        colour = row["mean_colour"]
        table.add_row(
            _cell(row["stable_id"], "{}"),
            Text(row["label"]),
            _cell(row["surface_area_m2"], "{:,.0f}"),
            _cell(row["slope_deg"], "{:.0f}"),
            _cell(row["roughness_m"], "{:.3f}"),
            _cell(row["lowest_m"], "{:.0f}"),
            _cell(row["highest_m"], "{:.0f}"),
            Text(f"■ {colour}", style=colour) if colour else "",
        )
    return table


def _cell(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


def _labelled(names: RegionNames) -> int:
    return len(names.labels) - len(names.without_region())


def _print_changes(console: Console, before: RegionNames, now: RegionNames) -> None:
    new = sum(before.labels.get(number) != text for number, text in now.labels.items())
    gone = len(before.labels.keys() - now.labels.keys())
    console.print(
        f"{new} labels set, {gone} taken away; {_labelled(now)} of "
        f"{0 if now.stable_ids is None else len(now.stable_ids)} regions have one",
        markup=False,
        highlight=False,
    )


def _print_lost(console: Console, names: RegionNames) -> None:
    lost = names.without_region()
    if lost:
        listed = ", ".join(f"{text!r} ({number})" for number, text in list(lost.items())[:_SHOWN])
        console.print(
            f"{len(lost)} labels whose region is gone: {listed}", markup=False, highlight=False
        )
