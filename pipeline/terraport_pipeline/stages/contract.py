"""What every stage is made of.

A stage is a module with

``NAME``
    Its name in the work directory, on the progress bar and in reports.
``Options``
    A frozen dataclass of plain values; checked in ``__post_init__`` before any work.
``run(...)``
    Values in, a frozen result out. No files, except where an engine needs them in
    :attr:`Context.scratch`.
``store(result)`` and ``restore(stored)``
    The result as arrays and plain values, and back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from terraport_pipeline.progress import NullProgress, Progress

__all__ = ["Context", "Facts", "Json", "Stored"]

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


@dataclass(frozen=True, slots=True)
class Context:
    """What a stage may use while it runs. Nothing in it changes a result."""

    scratch: Path
    """An empty folder that is deleted afterwards."""
    progress: Progress = field(default_factory=NullProgress)
    threads: int = 1
    max_memory_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class Stored:
    """Arrays and plain values of a result, as a work directory holds them."""

    arrays: Mapping[str, npt.NDArray[np.generic]]
    """By file name without ``.npy``."""
    values: Mapping[str, Json]
