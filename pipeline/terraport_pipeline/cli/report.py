"""``terraport report``: an HTML page about a scene, and one page of PDF."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors

__all__ = ["register", "report"]


def register(app: typer.Typer) -> None:
    """Add ``terraport report`` to the command line `app`."""
    app.command("report")(report)


def report(
    scene: Annotated[Path, typer.Argument(help="Scene directory.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="The page; SCENE/report.html by default. The PDF lies beside it."
        ),
    ] = None,
    width: Annotated[
        int, typer.Option(help="Width of the pictures, pixels.", min=160, max=3840)
    ] = 1280,
    work: Annotated[
        Path | None,
        typer.Option(
            help="The build's work directory, for the survey's points (accuracy, picture of the "
            "input); .SCENE.work beside the scene by default."
        ),
    ] = None,
    survey: Annotated[
        Path | None,
        typer.Option(
            help="The survey itself, where the work directory is gone: a file, or its folder.",
            show_default=False,
            exists=True,
        ),
    ] = None,
    photos: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a textured scene's photos, to show them beside it.",
            show_default=False,
            exists=True,
            file_okay=False,
        ),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Their cameras; looked for beside the photos by default.",
            show_default=False,
            exists=True,
        ),
    ] = None,
    rays: Annotated[
        int, typer.Option(help="Rays of the hand-off's proof; 0 leaves it out.", min=0)
    ] = 200_000,
    subsets: Annotated[int, typer.Option(help="Random sets of loaded segments.", min=1)] = 40,
) -> None:
    """Write a surveyor's report of a scene: an HTML page, and one page of PDF to print.

    Plan with scale and coordinates, distance of the mesh to the survey's points, density, areas and
    volumes by region, change, warnings; below, pictures and how the scene was built. The page holds
    everything itself and asks nothing of the network: send it as it is. In the scene directory, the
    server offers it as /scenes/{id}/report.

    For example:

        terraport report scenes/quarry

        terraport report scenes/quarry -o quarry.html --width 1920

        terraport report scenes/quarry --photos survey/images

        terraport report scenes/quarry --survey pit.laz
    """
    from terraport_pipeline.engines.odm_project import originals_in
    from terraport_pipeline.option import format_bytes
    from terraport_pipeline.progress import RichProgress
    from terraport_pipeline.report.input_cloud import find_input_cloud, read_input_cloud
    from terraport_pipeline.report.picture import PictureOptions
    from terraport_pipeline.report.report import ReportOptions, write_report
    from terraport_pipeline.report.textures import open_scene_photos

    errors = Console(stderr=True)
    start = time.perf_counter()
    with reporting_errors(errors):
        # Survey and photos are not in the scene: they are opened only when a picture wants them.
        options = ReportOptions(PictureOptions(width, width * 9 // 16), rays, subsets)
        with RichProgress(errors) as progress:
            result = write_report(
                scene,
                output,
                options,
                cloud=lambda opened: (
                    find_input_cloud(opened, work)
                    if survey is None
                    else read_input_cloud(opened, survey, progress)
                ),
                photos=(
                    None
                    if photos is None
                    else lambda model: open_scene_photos(model, originals_in(photos), cameras)
                ),
                work=work,
                progress=progress,
            )
    seconds = time.perf_counter() - start
    Console().print(
        f"{result.path}  {format_bytes(result.bytes)}, {len(result.pictures)} pictures, "
        f"{seconds:,.1f} s",
        highlight=False,
        soft_wrap=True,
    )
    Console().print(
        f"{result.pdf_path}  {format_bytes(result.pdf_bytes)}, one page",
        highlight=False,
        soft_wrap=True,
    )
