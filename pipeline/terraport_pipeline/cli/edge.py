"""Where errors become one line and an exit code, and progress a bar."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from terraport_pipeline.errors import OptionError, PipelineError

if TYPE_CHECKING:
    from terraport_pipeline.progress import Progress

__all__ = ["reporting_errors", "watching"]


@contextmanager
def reporting_errors(console: Console) -> Iterator[None]:
    """Print an error as ``error: ...`` and leave with its exit code.

    Parameters
    ----------
    console : Console
        On standard error.

    Raises
    ------
    typer.Exit
        2 for a wrong option, 130 after Ctrl-C, 1 for any other error. The trace of one that nobody
        foresaw is in the file that the line names.
    """
    try:
        yield
    except (PipelineError, OSError) as error:
        text = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            text = f"{error.filename}: {error.strerror}"  # without its number
        console.print(f"error: {text}", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2 if isinstance(error, OptionError) else 1) from error
    except KeyboardInterrupt as error:
        console.print("stopped", markup=False)
        raise typer.Exit(130) from error
    except (typer.Exit, typer.Abort, typer.BadParameter):  # said already
        raise
    except ModuleNotFoundError:  # an extra is missing: the error message names it
        raise
    except Exception as error:
        from terraport_store import StoreError  # slow to import, and wrong words need none of it

        text = str(error)
        if not isinstance(error, StoreError):
            from terraport_pipeline.unforeseen import stage_failed

            text = str(stage_failed(error, "this command", "nothing was finished by it"))
        console.print(f"error: {text}", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from error


@contextmanager
def watching(console: Console, *, quiet: bool) -> Iterator[Progress]:
    """Show progress on `console` while the block runs, or none."""
    from terraport_pipeline.progress import NullProgress, RichProgress

    if quiet:
        yield NullProgress()
        return
    with RichProgress(console) as progress:
        yield progress
