"""``terraport teach``: a few strokes per name, and all ground has a name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.cli.extras import require_drawings, require_learning
from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import parse_bytes

__all__ = ["register", "teach"]


def register(app: typer.Typer) -> None:
    """Add ``terraport teach`` to the command line `app`."""
    app.command("teach")(teach)


def teach(
    scene: Annotated[
        str,
        typer.Argument(
            help="Scene directory; with --watch and no STROKES also a folder of scenes.",
            show_default=False,
        ),
    ],
    strokes: Annotated[
        Path | None,
        typer.Argument(
            help="Lines, polygons or points, each with a name: GeoJSON, GeoPackage, Shapefile, "
            "DXF. [default: what was painted in the viewer]",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            help="Instead of strokes: what an earlier survey of the site was taught.",
            show_default=False,
        ),
    ] = None,
    save_model: Annotated[
        Path | None,
        typer.Option(help="Keep what was learned, for the next survey.", show_default=False),
    ] = None,
    uncertainty: Annotated[
        Path | None,
        typer.Option(
            help="Write where it is unsure: a picture (.tif), or the places where the next stroke "
            "pays (.geojson, .gpkg).",
            show_default=False,
        ),
    ] = None,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch",
            help="Go on: teach anew at each stroke painted, or when the file is saved. "
            "Ctrl-C ends it.",
        ),
    ] = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Say what would be, write the files, leave the scene."),
    ] = False,
    name_field: Annotated[
        str | None,
        typer.Option(
            metavar="PROPERTY",
            help="What names the strokes. [default: name, label or layer]",
            show_default=False,
        ),
    ] = None,
    stroke_width_m: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Of lines and points. [default: four squares]",
            show_default=False,
        ),
    ] = None,
    least_m2: Annotated[
        float | None,
        typer.Option(
            metavar="M2",
            help="Smaller regions join what they touch. [default: 64 squares]",
            show_default=False,
        ),
    ] = None,
    cell_m: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Side of the squares that the ground is looked at in; surroundings are up to 8 "
            "of them. [default: about three triangles]",
            show_default=False,
        ),
    ] = None,
    layer: Annotated[
        str | None, typer.Option(help="Of a file with several.", show_default=False)
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(
            metavar="EPSG:CODE",
            help="What the strokes' coordinates are in, where their file does not say.",
            show_default=False,
        ),
    ] = None,
    max_memory: Annotated[
        str | None,
        typer.Option(
            metavar="BYTES",
            help="Refuse scenes that would take more, for example 8G. [default: 80 % of what is "
            "free]",
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite model and uncertainty.")
    ] = False,
) -> None:
    """Teach a scene what its ground is called, by a few strokes per name.

    Draw three short lines on each kind of ground (in your GIS, or with the viewer's brush), and
    name them: "haul road", "stockpile", "bench". Then

        terraport teach scenes/pit strokes.geojson --save-model pit.model

    learns what each looks like (colour, texture, slope, roughness, height above its surroundings,
    every attribute of the survey) and cuts all ground into regions with these names, each with a
    confidence. The scene is published anew; its regions before are replaced. A plan of the mine
    (terraport label SCENE PLAN) goes on top afterwards.

    Or paint them in the viewer (the brush, which needs a token with the scope teach), and run,
    beside the service and where the scenes lie,

        terraport teach scenes --watch

    which answers every stroke at once, and publishes once nobody has painted for 10 s.

    Where it is wrong, draw a stroke and run it again; --uncertainty says where one pays most. The
    next survey needs none:

        terraport teach scenes/pit-june --model pit.model
    """
    from terraport_pipeline.progress import RichProgress
    from terraport_store import is_url

    console = Console(stderr=True, soft_wrap=True)

    def say(lines: list[str]) -> None:
        for line in lines:
            console.print(line, markup=False, highlight=False)

    with reporting_errors(console):
        if is_url(scene):
            raise OptionError(
                f"{scene} is an address; teach the scene's folder, then: terraport upload SCENE "
                f"{scene}"
            )
        if model is None:
            require_drawings("terraport teach")
            require_learning("terraport teach")
        if watch and (model is not None or dry_run):
            raise OptionError("--watch is of strokes, and not of --dry-run")
        # What reads drawings and grows forests is loaded for this command alone.
        from terraport_pipeline.naming.painted import teach_painted
        from terraport_pipeline.naming.teaching import Lesson, teach_again
        from terraport_pipeline.naming.teaching import teach as teach_scene

        lesson = Lesson(
            Path(scene),
            strokes,
            model,
            save_model,
            uncertainty,
            name_field,
            layer,
            crs,
            stroke_width_m,
            cell_m,
            least_m2,
            None if max_memory is None else parse_bytes(max_memory, "max memory"),
            force or watch,
            dry_run,
        )
        if watch and lesson.is_painted:
            say([f"waiting for strokes on {scene}"])
            teach_painted(lesson, say)
        with RichProgress(console) as progress:
            if watch:
                teach_again(lesson, say, progress)
            said, _ = teach_scene(lesson, progress)
        say(said)
