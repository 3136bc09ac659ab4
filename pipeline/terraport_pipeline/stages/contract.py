"""What every stage is made of.

A stage is a module with

``NAME``
    Its name in the work directory, on the progress bar and in reports.
``Options``
    A frozen dataclass of plain values; checked in ``__post_init__`` before any work.
``run(...)``
    Values in, a frozen result out. No files, except where an engine needs them in
    :attr:`Context.scratch`, and a result that is larger than memory.
``FORM``
    How the result is kept: as arrays and plain values, and back.

What runs it: :class:`terraport_pipeline.workflow.runner.Stage`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from terraport_pipeline.progress import NullProgress, Progress

__all__ = ["IN_FOLDER", "STORED", "Context", "Facts", "Form", "Json", "Stored"]

T = TypeVar("T")

Json = Any
"""A value that `json` writes and reads unchanged."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What a stage tells its reader: part of its result, so equal from run to run."""

    counts: dict[str, Json] = field(default_factory=dict)
    """Numbers by name, units in the names."""
    warnings: tuple[str, ...] = ()
    """Whole sentences for the person who builds."""
    notes: dict[str, Json] = field(default_factory=dict)
    """For the build's report alone: what is no part of the result, such as the files it came in."""
    choices: tuple[str, ...] = ()
    """What the build decided otherwise than asked or than may be thought: no fault of the survey,
    whole sentences for the person who builds."""


@dataclass(frozen=True, slots=True)
class Context:
    """What a stage may use while it runs. Nothing in it changes a result."""

    scratch: Path
    """An empty folder that is deleted afterwards."""
    progress: Progress = field(default_factory=NullProgress)
    threads: int = 1
    max_memory_bytes: int | None = None
    result_folder: Path | None = None
    """See :attr:`folder`."""

    @property
    def folder(self) -> Path:
        """Where a stage writes ``.npy`` files of a result that is larger than memory."""
        assert self.result_folder is not None
        return self.result_folder


@dataclass(frozen=True, slots=True)
class Stored:
    """Arrays and plain values of a result, as a work directory holds them."""

    arrays: Mapping[str, npt.NDArray[np.generic]]
    """By file name without ``.npy``."""
    values: Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class Form(Generic[T]):
    """How a stage's result is kept."""

    store: Callable[[T], Stored]
    """The result as arrays and plain values."""
    restore: Callable[[Stored, Facts], T]
    """And back."""
    facts: Callable[[T], Facts]
    """What to tell of it."""


STORED: Final[Form[Stored]] = Form(
    store=lambda result: result,
    restore=lambda stored, _facts: stored,
    facts=lambda result: Facts(dict(result.values)),
)
"""Of a result that is arrays and values already; the values are its facts."""


IN_FOLDER: Final[Form[tuple[Mapping[str, Json], Facts]]] = Form(
    store=lambda result: Stored({}, result[0]),
    restore=lambda stored, facts: (stored.values, facts),
    facts=lambda result: result[1],
)
"""Of a result whose arrays the stage wrote into :attr:`Context.folder` itself; what it
returns is the result's plain values and its facts."""
