"""``terraport mv``: give a scene another name or another place."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors

__all__ = ["mv", "register"]


def register(app: typer.Typer) -> None:
    """Add ``terraport mv`` to the command line `app`."""
    app.command("mv")(mv)


def mv(
    scene: Annotated[
        str, typer.Argument(help="Scene directory, or a scene's address.", show_default=False)
    ],
    target: Annotated[
        str,
        typer.Argument(
            help="Its new name, or a folder that is there; in object storage an address, with / at "
            "its end for a folder.",
            show_default=False,
        ),
    ],
) -> None:
    """Rename a scene or move it, with its labels, its report and its builds' work directory.

    Refused while a build of it runs, and where a scene is already. To another disk it is copied
    beside the target and renamed when all of it is there; in object storage every object is copied,
    then deleted, and the same command goes on where it was interrupted. A service that serves the
    folder has the scene under its new name within a second or so.

    For example:

        terraport mv scenes/pit scenes/pit-2026-05

        terraport mv scenes/pit /archive/

        terraport mv s3://bucket/scenes/pit s3://bucket/archive/pit
    """
    from terraport_pipeline.progress import NullProgress, RichProgress
    from terraport_pipeline.upkeep.changing import move_scene, target_of

    console = Console(stderr=True, soft_wrap=True)
    with reporting_errors(console):
        whither = target_of(scene, target)
        with RichProgress(console) as bar:
            moved = move_scene(scene, whither, bar if console.is_terminal else NullProgress())
    work = ", with its work directory" if moved.has_work else ""
    copied = ", copied" if moved.was_copied else ""
    kept = f"; {moved.kept_objects} objects were there" if moved.kept_objects else ""
    typer.echo(f"{scene} -> {moved.target}{copied}{work}{kept}")
