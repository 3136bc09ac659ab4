"""Surveys in parts: any file that can be read from its beginning to its end in bounded memory.

Each opener checks the header, and then hands out points and columns as the file has them; what only
the whole survey can decide (which columns say nothing, how deep the colours are) is written down as
rules for whoever puts the parts together.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.engines.readers.file_sample import first_chunks, text_sample
from terraport_pipeline.engines.readers.read_las import UNSET, open_las
from terraport_pipeline.engines.readers.read_pcd import stream_pcd
from terraport_pipeline.engines.readers.read_ply import stream_ply
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.survey_crs import UnitDoubt
from terraport_pipeline.engines.readers.survey_format import find_format
from terraport_pipeline.extent import Extent

__all__ = [
    "FileHead",
    "SurveySize",
    "SurveyStream",
    "open_stream",
    "read_head",
    "survey_size",
]

_LAS_COLOURS: Final = ("red", "green", "blue")

_WIDEST: Final = 1e7
"""A survey that is said to be wider has a wrong header."""

_BYTES_PER_POINT: Final = {"xyz": 40, "pcd": 20}
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
    """Columns of red, green, blue; or one (n, 3) column, or none. NaN means no colour."""
    colour_limits: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Smallest and largest value that colours can have, as the file states, by scan."""
    scan_column: str | None = None
    """Column with the scan number of each point, if there are several scans: colour depth is
    decided per scan."""
    unset: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Columns to leave out when every point has one value and it is one of these."""
    narrow: bool = False
    """Columns of whole numbers get an integer type."""
    whole: frozenset[str] = frozenset()
    """Integer columns that are read as floats because points may have no value."""
    stated_step: bool = False
    """Nothing is to suspect of 32-bit floats: the format says how fine its coordinates are, or the
    opener looks itself."""
    late_warnings: Callable[[], tuple[str, ...]] = tuple
    """What is known when all parts were read."""
    skipped: int = 0
    """Points that are not read, because an index shows that they lie outside the extent."""
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Corners that the header states, in the file's unit."""
    remarks: tuple[str, ...] = ()
    """What changes how the file is read, and not what is read of it."""
    units: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Units that a text states for x, y and z: its words, and the unit."""
    doubts: tuple[UnitDoubt, ...] = ()
    """Units that are unclear in the file."""


@dataclass(frozen=True, slots=True)
class FileHead:
    """What a file's header says, without its points."""

    points: int
    """By the header; for text, and formats whose header is not looked at, by the file's size."""
    crs: Any | None = None
    """pyproj.CRS as the file states it."""
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    """Corners of its box, in the file's unit; None where the header does not say them."""
    rows: int | None = None
    """Points that are read where an extent and an index leave some out; None: all."""
    ranges: tuple[tuple[int, int], ...] | None = None
    """Bytes that are read then, as first and the one behind the last; None: all."""
    doubts: tuple[UnitDoubt, ...] = ()
    """Units that are unclear in the file."""


@dataclass(frozen=True, slots=True)
class SurveySize:
    """How large a survey is by the headers of its files."""

    points: int
    extent: float | None = None
    """Longest side, in the files' unit; None where a header does not say it."""
    area: float | None = None
    """Of the box seen from above, in the same unit squared."""


def read_head(path: Path, name: str, extent: Extent | None = None) -> FileHead:
    """Read what a file's header says.

    Parameters
    ----------
    path : pathlib.Path
    name : str
        Format, from :func:`~terraport_pipeline.engines.readers.survey_format.find_format`; empty
        where that refused the file: it does so again here.
    extent : Extent, optional
        That the file is to be read for.

    Raises
    ------
    ReadError
        The header is damaged.
    """
    name = name or find_format(path)
    if name == "las":
        with open_las(path, extent=extent) as las:
            rows = None if las.ranges is None else las.rows
            low, high = las.box or (None, None)
            stated = las.stated
            return FileHead(las.count, stated.crs, low, high, rows, las.ranges, stated.doubts)
    if name == "e57":
        from terraport_pipeline.engines.readers.read_e57 import open_e57  # of an extra

        with open_e57(path) as e57:
            return FileHead(e57.count, e57.crs)
    if name == "ply":
        return FileHead(stream_ply(path).count)
    if name == "ptx":
        from terraport_pipeline.engines.readers.read_ptx import stream_ptx  # of an extra

        return FileHead(stream_ptx(path).count)
    return FileHead(path.stat().st_size // _BYTES_PER_POINT[name])


def survey_size(heads: Sequence[FileHead], extent: Extent | None = None) -> SurveySize:
    """Say how large a survey of so many files is, or what lies of it within an extent.

    Points are taken to be spread evenly over each file's box.
    """
    if extent is not None:
        heads = [_within(head, extent) for head in heads]
    points = sum(head.points for head in heads)
    boxes = [(h.low, h.high) for h in heads if h.low is not None and h.high is not None]
    if len(boxes) < len(heads):
        return SurveySize(points)
    sides = [
        max(high[axis] for _, high in boxes) - min(low[axis] for low, _ in boxes)
        for axis in range(3)
    ]
    if not all(0 < side < _WIDEST for side in sides):
        return SurveySize(points)
    return SurveySize(points, max(sides), sides[0] * sides[1])


def _within(head: FileHead, extent: Extent) -> FileHead:
    """Reduce a head to the part of its box within an extent."""
    most = head.points if head.rows is None else head.rows
    if head.low is None or head.high is None:
        return replace(head, points=most)
    points = min(most, math.ceil(head.points * extent.share(head.low, head.high)))
    low, high = extent.clipped(head.low, head.high)
    return replace(head, points=points, low=low, high=high)


@contextlib.contextmanager
def open_stream(
    path: Path,
    name: str,
    *,
    bounded: bool = True,
    extent: Extent | None = None,
    columns: tuple[str, ...] | None = None,
    share: float = 1.0,
) -> Iterator[SurveyStream]:
    """Open a survey for reading in parts.

    Parameters
    ----------
    path : pathlib.Path
    name : str
        Format, from :func:`~terraport_pipeline.engines.readers.survey_format.find_format`.
    bounded : bool
        Refuse files that can only be read whole; otherwise they are read as one part.
    extent : Extent, optional
        Skip parts that an index or the header shows to be outside. Other formats, and LAS without
        an index, are read whole: the caller selects the points that are within.
    columns : tuple of str, optional
        Names of the columns of a text; other formats name theirs.
    share : float
        Read about this share, in pieces spread over the file; of E57, PTX, and PLY as text or with
        lists, its beginning. 1 reads all.

    Raises
    ------
    ReadError
        The file is damaged, or of a format that cannot be read in parts; says how to convert it.
    """
    if name == "las":
        opened = _open_las(path, extent, share)
    elif name == "xyz":
        opened = _open_xyz(path, columns, share)
    else:
        opened = _OPENERS[name](path, bounded, share)
    with opened as stream:
        yield stream


@contextlib.contextmanager
def _open_las(path: Path, extent: Extent | None, share: float) -> Iterator[SurveyStream]:
    with open_las(path, extent=extent, share=share) as stream:
        unset = {name: UNSET.get(name, (0,)) for name in stream.standard}
        yield SurveyStream(
            "las",
            stream.rows,
            "points",
            stream.chunks,
            stream.stated.crs,
            stream.warnings,
            _LAS_COLOURS if stream.standard.issuperset(_LAS_COLOURS) else (),
            unset=unset,
            whole=stream.whole,
            stated_step=True,
            skipped=stream.count - stream.rows,
            box=stream.box,
            remarks=stream.remarks,
            doubts=stream.stated.doubts,
        )


@contextlib.contextmanager
def _open_ply(path: Path, _bounded: bool, share: float) -> Iterator[SurveyStream]:
    ply = stream_ply(path, share=share)
    yield SurveyStream(
        "ply", ply.count, "points", ply.chunks, warnings=ply.warnings, colours=ply.colours
    )


@contextlib.contextmanager
def _open_pcd(path: Path, bounded: bool, share: float) -> Iterator[SurveyStream]:
    pcd = stream_pcd(path, bounded=bounded, share=share)
    yield SurveyStream("pcd", pcd.count, "points", pcd.chunks, colours=pcd.colours)


@contextlib.contextmanager
def _open_xyz(path: Path, columns: tuple[str, ...] | None, share: float) -> Iterator[SurveyStream]:
    from terraport_pipeline.engines.readers.read_xyz import stream_xyz  # of an extra

    with text_sample(path, share) if share < 1.0 else contextlib.nullcontext(path) as source:
        text = stream_xyz(source, columns=columns, sampled=share < 1.0)
        yield SurveyStream(
            "xyz",
            text.size,
            "bytes",
            text.chunks,
            warnings=text.warnings,
            colours=text.colours,
            units=text.units,
        )


@contextlib.contextmanager
def _open_e57(path: Path, _bounded: bool, share: float) -> Iterator[SurveyStream]:
    from terraport_pipeline.engines.readers.read_e57 import open_e57  # of an extra

    with open_e57(path) as stream:
        yield SurveyStream(
            "e57",
            stream.count,
            "points",
            lambda: first_chunks(stream.chunks(), stream.count, share),
            stream.crs,
            stream.warnings,
            stream.colours,
            colour_limits=stream.colour_limits,
            scan_column="scan" if stream.scans > 1 else None,
            narrow=True,
            stated_step=True,
            late_warnings=stream.late_warnings,
        )


@contextlib.contextmanager
def _open_ptx(path: Path, _bounded: bool, share: float) -> Iterator[SurveyStream]:
    from terraport_pipeline.engines.readers.read_ptx import stream_ptx  # of an extra

    ptx = stream_ptx(path)
    yield SurveyStream(
        "ptx",
        ptx.count,
        "points",
        lambda: first_chunks(ptx.chunks(), ptx.count, share),
        warnings=ptx.warnings,
        colours=ptx.colours,
        scan_column="scan" if ptx.scans > 1 else None,
        narrow=True,
        stated_step=True,
        late_warnings=ptx.late_warnings,
    )


_OPENERS: Final[dict[str, Callable[[Path, bool, float], Any]]] = {
    "ply": _open_ply,
    "pcd": _open_pcd,
    "e57": _open_e57,
    "ptx": _open_ptx,
}
