"""Surveys in parts: any file that can be read from its beginning to its end in bounded memory.

Each opener checks the header as the whole reader of the format does, and then hands out points and
columns as the file has them; what only the whole survey can decide (which columns say nothing, how
deep the colours are) is written down as rules for whoever puts the parts together.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.engines.raw_survey import StreamPart
from terraport_pipeline.engines.read_las import UNSET, open_las
from terraport_pipeline.errors import ReadError

__all__ = ["SurveyStream", "open_stream"]

_LAS_COLOURS: Final = ("red", "green", "blue")


@dataclass(frozen=True, slots=True, eq=False)
class SurveyStream:
    """An open survey."""

    format: str
    total: int
    """What all parts' ``read`` add up to."""
    unit: str
    """Of `total`: ``"points"`` or ``"bytes"``."""
    parts: Callable[[], Iterator[StreamPart]]
    """Makes the iterator; once. Every part has the same columns with the same dtypes."""
    crs: Any | None = None
    """pyproj.CRS as the file states it."""
    warnings: tuple[str, ...] = ()
    colours: tuple[str, ...] = ()
    """The columns that hold red, green, blue; one (n, 3) column, or none."""
    unset: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Columns to leave out when every point has one value and it is one of these."""
    narrow: bool = False
    """Columns of whole numbers get an integer type."""
    stated_step: bool = False
    """The format states how fine its coordinates are: nothing to suspect of 32-bit floats."""


@contextlib.contextmanager
def open_stream(path: Path, name: str, *, max_points: int | None = None) -> Iterator[SurveyStream]:
    """Open a survey for reading in parts.

    Parameters
    ----------
    path : pathlib.Path
    name : str
        Format, from :func:`terraport_pipeline.stages.read.find_format`.
    max_points : int, optional
        Thin to this many points.

    Raises
    ------
    ReadError
        The file is damaged, or of a kind that cannot be read in parts; says how to convert it.
    """
    opener = _OPENERS.get(name)
    if opener is None:
        raise ReadError(
            path,
            f"a survey of the format {name} cannot be read in parts",
            "convert it to LAZ (for example with CloudCompare), or give --max-memory more",
        )
    with opener(path, max_points) as stream:
        yield stream


@contextlib.contextmanager
def _open_las(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    with open_las(path, max_points=max_points) as stream:
        unset = {name: UNSET.get(name, (0,)) for name in stream.standard}
        yield SurveyStream(
            "las",
            stream.count,
            "points",
            stream.parts,
            stream.crs,
            stream.warnings,
            _LAS_COLOURS,
            unset,
            stated_step=True,
        )


_OPENERS: Final[dict[str, Callable[[Path, int | None], Any]]] = {"las": _open_las}
