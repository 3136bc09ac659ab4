"""Failures that nobody foresaw: one line that says how to go on, and the whole trace in a file."""

from __future__ import annotations

import tempfile
import time
import traceback
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from terraport_pipeline.errors import ResourceError, StageFailedError

__all__ = ["FAILURE_NAME", "build_failed", "description_of", "stage_failed"]

FAILURE_NAME: Final = "failure.log"
"""In the work directory; the last failure alone."""

_LONGEST_REASON: Final = 300
"""Characters of an exception's text that are told; the trace has all of it."""


def build_failed(
    error: Exception, stage: str, finished: Sequence[str], work: Path
) -> StageFailedError | ResourceError:
    """Turn what ended a build into an error for people.

    Parameters
    ----------
    error : Exception
        None that was raised on purpose.
    stage : str
        What was being done.
    finished : sequence of str
        Stages that are kept.
    work : Path
        Work directory; gets the trace.

    Returns
    -------
    StageFailedError or ResourceError
        To be raised from `error`; the latter where memory was refused.
    """
    advice = "no stage was finished"
    if finished:
        advice = (
            f"the finished stages ({', '.join(dict.fromkeys(finished))}) are kept in {work}, and "
            "the same command goes on after them"
        )
        if stage.startswith("stage texture"):
            advice += ", or without --photos and --cameras makes a scene of them"
    advice += "; the scene is as it was"
    if isinstance(error, MemoryError):
        return ResourceError(
            f"{stage} was refused memory ({description_of(error)}); free some, or thin the survey "
            f"with --max-points; {advice}"
        )
    return stage_failed(error, stage, advice, work)


def stage_failed(
    error: Exception, stage: str, advice: str, directory: Path | None = None
) -> StageFailedError:
    """Turn an exception that nobody foresaw into an error for people; its trace goes to a file.

    Parameters
    ----------
    error : Exception
    stage : str
        What was being done.
    advice : str
        What is kept, and how to go on.
    directory : Path, optional
        Where :data:`FAILURE_NAME` is written; by default a new file among the system's temporary
        ones.

    Returns
    -------
    StageFailedError
        To be raised from `error`.
    """
    return StageFailedError(
        stage, description_of(error), advice, _kept_trace(error, stage, directory)
    )


def description_of(error: Exception) -> str:
    r"""Put an exception's kind and text in one line.

    Examples
    --------
    >>> description_of(ValueError("3 sizes,\n expected 2"))
    'ValueError: 3 sizes, expected 2'
    >>> description_of(ZeroDivisionError())
    'ZeroDivisionError'
    """
    text = " ".join(str(error).split())
    if len(text) > _LONGEST_REASON:
        text = text[:_LONGEST_REASON] + ".."
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _kept_trace(error: Exception, stage: str, directory: Path | None) -> Path | None:
    try:
        release = version("terraport")
    except PackageNotFoundError:
        release = "unknown"
    when = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    lines = [f"terraport {release}, {when}, {stage}\n", *traceback.format_exception(error)]
    try:
        if directory is None:
            with tempfile.NamedTemporaryFile(
                "w", encoding="utf-8", prefix="terraport-failure-", suffix=".log", delete=False
            ) as file:
                file.writelines(lines)
                return Path(file.name)
        path = directory / FAILURE_NAME
        path.write_text("".join(lines), encoding="utf-8")
    except OSError:  # a full disk must not hide what failed
        return None
    return path
