"""Where errors become one line and an exit code."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from terraport_pipeline.errors import OptionError, PipelineError
from terraport_store import StoreError

__all__ = ["reporting_errors"]


@contextmanager
def reporting_errors(console: Console) -> Iterator[None]:
    """Print an expected error as ``error: ...`` and leave with its exit code.

    Parameters
    ----------
    console : Console
        On standard error.

    Raises
    ------
    typer.Exit
        2 for a wrong option, 130 after Ctrl-C, 1 for any other expected error. Unexpected ones
        pass: they are bugs, and their trace is wanted.
    """
    try:
        yield
    except (PipelineError, StoreError, OSError) as error:
        console.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2 if isinstance(error, OptionError) else 1) from error
    except KeyboardInterrupt as error:
        console.print("stopped", markup=False)
        raise typer.Exit(130) from error
