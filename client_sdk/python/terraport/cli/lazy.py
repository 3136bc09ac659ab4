"""Verbs that are loaded when they are called, and what is said when they cannot be."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import typer
from typer.core import TyperGroup

from terraport.cli.addresses import refuse_addresses
from terraport.errors import MissingExtraError, TerraportError, UsageError

__all__ = ["STOPPED", "VERBS", "LazyGroup", "Verb", "fail", "stub"]

STOPPED: Final = 130
"""128 + SIGINT, as shells count."""


@dataclass(frozen=True, slots=True)
class Verb:
    """One command: where it is, and what it needs."""

    name: str
    module: str
    """Has ``register(app: typer.Typer)``, which adds the command."""
    extra: str | None
    """Extra that brings what it needs; None for the core."""
    help: str


# fmt: off
VERBS: Final = (
    Verb("demo", "terraport_pipeline.cli.demo", "all",
         "Make a sample quarry, build it, serve it and land in it: everything at a glance."),
    Verb("build", "terraport_pipeline.cli.build", "pipeline",
         "Turn a survey (LAS, LAZ, PLY, E57, XYZ, PCD) into a scene."),
    Verb("serve", "terraport_server.cli", "server",
         "Serve scenes to VR clients: landings over WebSocket, files over HTTP."),
    Verb("token", "terraport_server.auth.cli", "server",
         "Make keys, and tokens that expire, for a service that asks for them."),
    Verb("land", "terraport.cli.land", None,
         "Land in a served scene without a headset: the plan, times, bytes, a picture."),
    Verb("inspect", "terraport_pipeline.cli.inspect", "pipeline",
         "Show what is in a scene: counts, sizes, coordinates."),
    Verb("label", "terraport_pipeline.cli.label", "pipeline",
         "Call the regions of a scene something; picks in VR answer with it."),
    Verb("teach", "terraport_pipeline.cli.teach", "teach",
         "Teach a scene what its ground is called, by a few strokes per name."),
    Verb("validate", "terraport_pipeline.cli.validate", "pipeline",
         "Check that a scene is whole, and that its hand-off has no holes."),
    Verb("list", "terraport_pipeline.cli.list_scenes", "pipeline",
         "List scenes of a folder or in object storage: version, size, extent, CRS."),
    Verb("mv", "terraport_pipeline.cli.mv", "pipeline",
         "Rename or move a scene with all that belongs to it."),
    Verb("rm", "terraport_pipeline.cli.rm", "pipeline",
         "Remove scenes, or only the working files of their builds."),
    Verb("diff", "terraport_pipeline.cli.diff", "pipeline",
         "Compare two scenes or versions: segments, bytes to load, regions, heights."),
    Verb("upload", "terraport_pipeline.cli.upload", "pipeline",
         "Put a scene into object storage (S3), for terraport serve s3://..."),
    Verb("report", "terraport_pipeline.cli.report", "pipeline",
         "Write one HTML page with pictures and figures of a scene."),
    Verb("export", "terraport_pipeline.cli.export", "export",
         "Hand a scene on: orthophoto, heights, mesh, points, contours, regions."),
    Verb("segment", "terraport_pipeline.cli.segment", "pipeline",
         "Cut any mesh (OFF, PLY, OBJ, STL, GLB) into segments."),
    Verb("synth", "terraport_pipeline.cli.synth", "pipeline",
         "Make a procedural quarry with known truth, as a survey to build from."),
    Verb("evaluate", "terraport_research.cli", "research",
         "Compare algorithms with each other and with the thesis, for researchers."),
)
# fmt: on
"""Every verb, in the order of the help."""

_OWN_PACKAGES: Final = ("terraport",)


def stub() -> None:
    """Stand for a verb in the help; never run."""


def fail(message: str, code: int = 1) -> typer.Exit:
    """Print ``error: ...`` on standard error; return what to raise.

    Parameters
    ----------
    message : str
        Lower-case, no full stop: what was received, what was expected, what to do.
    code : int
        1 failed, 2 wrong usage.
    """
    typer.echo(f"error: {message}", err=True)
    return typer.Exit(code)


class LazyGroup(TyperGroup):
    """A group whose commands stand in the help as stubs and are imported when called."""

    _calling = False

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command to call; only here the real one is imported."""
        self._calling = True
        try:
            name, command, words = super().resolve_command(ctx, args)
        finally:
            self._calling = False
        if command is not None:
            refuse_addresses(name or "", command, words)
        return name, command, words

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command: the real one when it is about to be called, else its stub."""
        command = super().get_command(ctx, cmd_name)
        if command is None or not self._calling:
            return command
        verb = next(verb for verb in VERBS if verb.name == cmd_name)
        with _reporting(verb):
            return _load(verb)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; expected errors become one line and an exit code."""
        verb = next((verb for verb in VERBS if verb.name in _arguments(ctx)[:1]), None)
        with _reporting(verb):
            return super().invoke(ctx)


def _arguments(ctx: Any) -> list[str]:
    """Return the words behind the options of the group: the verb first."""
    return [*getattr(ctx, "_protected_args", getattr(ctx, "protected_args", [])), *ctx.args]


def _load(verb: Verb) -> Any:
    """Import a verb and return its command."""
    module = importlib.import_module(verb.module)
    carrier = typer.Typer(add_completion=False, rich_markup_mode="markdown")
    carrier.callback()(stub)  # so that it stays a group, however few commands are registered
    module.register(carrier)
    group: Any = typer.main.get_command(carrier)
    return group.commands[verb.name]


@contextmanager
def _reporting(verb: Verb | None) -> Iterator[None]:
    """Turn expected errors into ``error: ...`` and an exit code; bugs keep their traceback."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("stopped", err=True)
        raise typer.Exit(STOPPED) from None
    except BrokenPipeError:
        # The reader of our output (head, less) has gone: nobody is left to be told.
        sys.stderr.close()
        raise typer.Exit(0) from None
    except (UsageError, MissingExtraError) as error:
        raise fail(str(error), 2) from None
    except TerraportError as error:
        raise fail(str(error)) from None
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if verb is None or verb.extra is None or missing.startswith(_OWN_PACKAGES):
            raise
        text = f'"terraport {verb.name}" needs {missing}: install "terraport[{verb.extra}]"'
        raise fail(text, 2) from None
    except OSError as error:
        named = error.filename is not None
        text = f"{error.filename}: {error.strerror}" if named else str(error)  # without its number
        raise fail(text) from None
