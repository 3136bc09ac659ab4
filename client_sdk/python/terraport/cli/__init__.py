"""``terraport``: one command line for surveys, scenes, servers and landings.

The frame alone is in the core install. Most verbs live in packages that need an extra; they are
loaded when they are asked for, so that ``terraport --help`` answers at once and lists them all.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
from typing import Annotated, NoReturn

import typer

from terraport.cli.lazy import STOPPED, VERBS, LazyGroup, stub

__all__ = ["app", "main"]

_HELP = """Walk a quarry in VR at full survey resolution.

A survey (a coloured point cloud) becomes a scene; a server streams from it what lies around the
place where a client has landed.

Try it, without any data of your own:

    terraport demo

With a survey:

    terraport build pit.laz -o scenes/pit     make a scene, with a report

    terraport serve scenes                    serve it

    terraport land http://127.0.0.1:8080/scenes/pit 0 0 0 --ground --png here.png

`terraport VERB --help` says more about each.
"""

app = typer.Typer(
    name="terraport",
    cls=LazyGroup,
    help=_HELP,
    no_args_is_help=True,
    add_completion=False,
    # A traceback with the values of local variables would print tokens.
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


def main() -> None:
    """Run the command line and exit: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C."""
    try:
        app(prog_name="terraport")
    except SystemExit as ended:
        if ended.code == STOPPED:
            _leave_at_once()
        raise


def _leave_at_once() -> NoReturn:
    """Exit after Ctrl-C without tearing down what is still at work.

    Threads of native libraries (reconstruction, compiled kernels) cannot be interrupted. While the
    interpreter and the libraries' own globals were taken down under them, one of some thirteen
    interrupted builds ended by a segmentation fault in place of 130.
    """
    atexit._run_exitfuncs()  # noqa: SLF001 - temporary folders, child processes
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # its reader has gone
            stream.flush()
    os._exit(STOPPED)


def _show_version(wanted: bool) -> None:
    if wanted:
        from terraport.version import __version__  # reads the metadata

        typer.echo(f"terraport {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Hold the options that stand before the verb."""


for _verb in VERBS:
    app.command(_verb.name, help=_verb.help)(stub)
