"""``terraport rm``: remove scenes, or what builds keep beside them."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.errors import OptionError

if TYPE_CHECKING:
    from terraport_pipeline.upkeep.changing import Owned

__all__ = ["register", "rm"]


def register(app: typer.Typer) -> None:
    """Add ``terraport rm`` to the command line `app`."""
    app.command("rm")(rm)


def rm(
    scenes: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENE...", help="Scene directories, or scenes' addresses.", show_default=False
        ),
    ],
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Do not ask; needed where there is no terminal.")
    ] = False,
    work: Annotated[
        bool,
        typer.Option(
            "--work",
            help="Only the work directory of its builds; the scene stays, and the next build "
            "begins from the survey.",
        ),
    ] = False,
) -> None:
    """Remove scenes with all their versions, labels and reports, and their builds' work.

    Nothing is removed unless all that are named are scenes (a folder without a manifest is none),
    hold no other files, and none is being built now. Sessions of a service that has one open go on
    with what they have.

    For example:

        terraport rm scenes/trial

        terraport rm scenes/trial-1 scenes/trial-2 --yes

        terraport rm --work scenes/pit               frees what only the next build would use

        terraport rm s3://bucket/scenes/pit --yes
    """
    from terraport_pipeline.option import format_bytes
    from terraport_pipeline.upkeep.changing import owned_by, remove_scene

    with reporting_errors(Console(stderr=True, soft_wrap=True)):
        # (1) All or nothing: what is none is said before anything goes.
        owned = [owned_by(scene, only_work=work) for scene in dict.fromkeys(scenes)]
        if not yes:
            _ask(owned)
        # (2) One after the other; each is looked at again under its lock.
        freed = 0
        for one in owned:
            size = remove_scene(one.location, only_work=work)
            freed += size
            typer.echo(f"removed {_words(one, '')}, {format_bytes(size)} freed")
    if len(owned) > 1:
        typer.echo(f"{format_bytes(freed)} freed in all")


def _ask(owned: list[Owned]) -> None:
    """Ask on the terminal; raises typer.Exit where the answer is no."""
    from terraport_pipeline.option import format_bytes

    if not _is_terminal():
        names = " ".join(one.location for one in owned)
        raise OptionError(f"nobody to ask whether {names} shall go; add --yes to remove")
    for one in owned:
        typer.echo(f"  {_words(one, f'{format_bytes(one.scene_bytes)}')}")
    if not typer.confirm("remove?" if len(owned) == 1 else f"remove all {len(owned)}?"):
        typer.echo("nothing was removed", err=True)
        raise typer.Exit(1)


def _is_terminal() -> bool:
    return sys.stdin.isatty()


def _words(one: Owned, size: str) -> str:
    from terraport_pipeline.option import format_bytes

    work = f"its work directory ({format_bytes(one.work_bytes)})"
    if not one.scene_bytes:
        return f"{one.location}: only {work}"
    scene = f"{one.location} ({size})" if size else one.location
    return f"{scene} and {work}" if one.work_bytes else scene
