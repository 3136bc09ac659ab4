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

from terraport_pipeline.engines.readers.raw_survey import StreamChunk
from terraport_pipeline.engines.readers.read_e57 import open_e57
from terraport_pipeline.engines.readers.read_las import UNSET, open_las
from terraport_pipeline.engines.readers.read_pcd import stream_pcd
from terraport_pipeline.engines.readers.read_ply import stream_ply
from terraport_pipeline.engines.readers.read_xyz import stream_xyz

__all__ = ["SurveySize", "SurveyStream", "open_stream", "survey_size"]

_LAS_COLOURS: Final = ("red", "green", "blue")


_WIDEST: Final = 1e7
"""A header that states a wider box is wrong."""

_BYTES_PER_POINT: Final = {"xyz": 40, "e57": 20, "pcd": 20, "ply": 27}
"""Of usual coloured files; only decides early whether a survey might not fit."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyStream:
    """A survey of any format, open for reading chunk by chunk in bounded memory."""

    format: str
    total: int
    """What all parts' ``read`` add up to."""
    unit: str
    """Unit of `total`: ``"points"`` or ``"bytes"``."""
    chunks: Callable[[], Iterator[StreamChunk]]
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
    """Nothing is to suspect of 32-bit floats: the format says how fine its coordinates are, or the
    opener looks itself."""
    late_warnings: Callable[[], tuple[str, ...]] = tuple
    """What is known when all parts were read."""


@dataclass(frozen=True, slots=True)
class SurveySize:
    """What a survey's header says of its size."""

    points: int
    extent: float | None = None
    """Longest side, in the file's unit; None where the header does not say it."""
    area: float | None = None
    """Of the box seen from above, in the same unit squared."""


def survey_size(path: Path, name: str) -> SurveySize:
    """Read how large a survey is, without its points.

    Parameters
    ----------
    path : pathlib.Path
    name : str
        Format, from :func:`terraport_pipeline.stages.read.find_format`.

    Returns
    -------
    SurveySize
        By its header; for text, and for formats that are not read in parts, by the file's size.

    Raises
    ------
    ReadError
        The header is damaged.
    """
    if name == "las":
        with open_las(path) as stream:
            x, y, z = stream.sides
            if all(0 < side < _WIDEST for side in stream.sides):
                return SurveySize(stream.count, max(x, y, z), x * y)
            return SurveySize(stream.count)
    return SurveySize(path.stat().st_size // _BYTES_PER_POINT.get(name, 30))


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
    with _OPENERS[name](path, max_points) as stream:
        yield stream


@contextlib.contextmanager
def _open_las(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    with open_las(path, max_points=max_points) as stream:
        unset = {name: UNSET.get(name, (0,)) for name in stream.standard}
        yield SurveyStream(
            "las",
            stream.count,
            "points",
            stream.chunks,
            stream.crs,
            stream.warnings,
            _LAS_COLOURS if stream.standard.issuperset(_LAS_COLOURS) else (),
            unset,
            stated_step=True,
        )


@contextlib.contextmanager
def _open_ply(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    ply = stream_ply(path, max_points=max_points)
    yield SurveyStream(
        "ply", ply.count, "points", ply.chunks, warnings=ply.warnings, colours=ply.colours
    )


@contextlib.contextmanager
def _open_pcd(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    pcd = stream_pcd(path, max_points=max_points)
    yield SurveyStream("pcd", pcd.count, "points", pcd.chunks, colours=pcd.colours)


@contextlib.contextmanager
def _open_xyz(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    text = stream_xyz(path, max_points=max_points)
    yield SurveyStream(
        "xyz", text.size, "bytes", text.chunks, warnings=text.warnings, colours=text.colours
    )


@contextlib.contextmanager
def _open_e57(path: Path, max_points: int | None) -> Iterator[SurveyStream]:
    with open_e57(path, max_points=max_points) as stream:
        yield SurveyStream(
            "e57",
            stream.count,
            "points",
            stream.chunks,
            stream.crs,
            stream.warnings,
            stream.colours,
            narrow=True,
            stated_step=True,
            late_warnings=stream.late_warnings,
        )


_OPENERS: Final[dict[str, Callable[[Path, int | None], Any]]] = {
    "las": _open_las,
    "ply": _open_ply,
    "pcd": _open_pcd,
    "xyz": _open_xyz,
    "e57": _open_e57,
}
