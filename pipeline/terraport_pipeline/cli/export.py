"""``terraport export``: hand a scene on to other tools."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.export.products import ENDINGS, Product, product_of
from terraport_pipeline.extent import Extent
from terraport_pipeline.option import EXTENT

if TYPE_CHECKING:
    from terraport_pipeline.export.hand_on import Exported

__all__ = ["export", "register"]


_PACKAGES: Final = ("contourpy", "ezdxf", "pyogrio", "rasterio", "shapely")
"""What the extra brings; some are imported only by the formats that need them."""


def register(app: typer.Typer) -> None:
    """Add ``terraport export`` to the command line `app`."""
    app.command("export")(export)


def export(
    scene: Annotated[
        str,
        typer.Argument(
            help="Scene directory, or a scene's address (s3://...).", show_default=False
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help=f"The file; its ending is the format: {' '.join(ENDINGS)}. Or a folder, --as "
            "tiles.",
            show_default=False,
        ),
    ],
    product: Annotated[
        Product | None,
        typer.Option(
            "--as",
            help="What the file shall hold, where its ending leaves a choice (.tif, .dxf), or is "
            "not what it usually holds (regions in .gpkg, .geojson).",
            show_default=False,
        ),
    ] = None,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar=EXTENT.metavar,
            help="Only what lies in this rectangle, in the coordinates and the unit of the "
            "survey's CRS.",
            show_default=False,
        ),
    ] = None,
    region: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LABEL|ID",
            help="Only this region, by label or stable id (see terraport label); may be repeated.",
            show_default=False,
        ),
    ] = None,
    step_m: Annotated[
        float | None,
        typer.Option(
            help="Size of a pixel on the ground, metres; of contours the step of the heights that "
            "they are drawn from. [default: about the distance of the mesh's vertices]",
            show_default=False,
        ),
    ] = None,
    interval: Annotated[
        float | None,
        typer.Option(
            help="Between contours, in the unit of the survey's heights. [default: 1]",
            show_default=False,
        ),
    ] = None,
    line: Annotated[
        str | None,
        typer.Option(
            metavar='"E,N E,N ..."',
            help="What a section is cut along, in the survey's coordinates.",
            show_default=False,
        ),
    ] = None,
    radius_m: Annotated[
        float | None,
        typer.Option(
            help="Of tiles: full detail within so many metres of the eye, and the base beyond. "
            "[default: by the error on the screen, as viewers do]",
            show_default=False,
        ),
    ] = None,
    height_shift_m: Annotated[
        float | None,
        typer.Option(
            help="Of tiles: metres added to all heights, for surveys above sea level: the geoid's "
            "height above the ellipsoid there. [default: 0]",
            show_default=False,
        ),
    ] = None,
    full_coordinates: Annotated[
        bool,
        typer.Option(
            "--full-coordinates",
            help="Write a mesh (.ply, .obj) with its whole coordinates and no shift, for programs "
            "that shift them themselves (CloudCompare).",
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
) -> None:
    """Hand a scene on: orthophoto, heights, mesh, points, contours, sections, regions, tiles.

    All coordinates are the survey's, in its own CRS and unit; those of 3D Tiles (for Cesium and
    others) are Earth-centred. Whole, in a rectangle, or some regions.

    For example:

        terraport export scenes/pit -o pit.tif --as orthophoto --step-m 0.05

        terraport export scenes/pit -o heights.tif --as heights --step-m 0.1

        terraport export scenes/pit -o pit.glb --extent 641200 8594700 641300 8594800

        terraport export scenes/pit -o stockpile.laz --region "stockpile 3"

        terraport export scenes/pit -o contours.gpkg --interval 0.5

        terraport export scenes/pit -o regions.gpkg --as regions

        terraport export scenes/pit -o cut.dxf --as section --line "641150,8594650 641250,8594750"

        terraport export scenes/pit -o pit.3tz --radius-m 60
    """
    errors = Console(stderr=True)
    start = time.perf_counter()
    with reporting_errors(errors):
        # (1) Report wrong arguments or a missing package before slow imports.
        product = product_of(output, product, interval=interval, line=line)
        for package in _PACKAGES:
            if find_spec(package) is None:
                raise ModuleNotFoundError(f"No module named {package!r}", name=package)
        # (2) The export.
        from terraport_pipeline.export.hand_on import ExportRequest, export_scene
        from terraport_pipeline.progress import RichProgress
        from terraport_store import is_url

        request = ExportRequest(
            output,
            product,
            None if extent is None else Extent(*extent),
            tuple(region or ()),
            step_m,
            interval,
            line,
            radius_m,
            height_shift_m,
            full_coordinates,
            force,
        )
        with RichProgress(errors) as progress:
            written = export_scene(scene if is_url(scene) else Path(scene), request, progress)
    seconds = time.perf_counter() - start
    Console().print(_line(written, seconds), markup=False, highlight=False, soft_wrap=True)


def _line(written: Exported, seconds: float) -> str:
    from terraport_pipeline.option import format_bytes

    facts = ", ".join(f"{name} {value}" for name, value in written.facts.items())
    beside = f"\nbeside it: {', '.join(written.companions)}" if written.companions else ""
    return (
        f"{written.path}  {written.product}, {format_bytes(written.bytes)}, {facts}, "
        f"{seconds:,.1f} s\ncoordinates: {written.crs}, unit {written.unit}{beside}"
    )
