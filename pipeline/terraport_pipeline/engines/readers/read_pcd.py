"""PCD (ascii, binary, binary_compressed) by pypcd4.

Format: Point Cloud Library, "The PCD file format", versions .5 to .7; keywords and field names in
any case. Sizes are checked against the file before pypcd4 allocates anything. Padding fields
(``_``) are left out; the viewpoint is ignored (PCL stores coordinates with it applied).
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pydantic
from pypcd4.pypcd4 import Encoding, MetaData, PointCloud

from terraport_payload.types import AnyArray, UInt8
from terraport_pipeline.engines.readers.file_sample import spread_pieces
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.survey_colours import find_colours
from terraport_pipeline.errors import NoPointsError, ReadError

__all__ = ["PcdStream", "stream_pcd"]

_MAX_HEADER_BYTES: Final = 1 << 14

_CHUNK_POINTS: Final = 1_000_000

_PADDING: Final = "#$%&~~"
"""pypcd4's own name for fields that the file calls ``_``."""

_VERSIONS: Final = (".5", ".6", ".7")
"""Older versions that store points like 0.7; headers before .6 have no COUNT."""

_PACKED: Final = ("rgb", "rgba")
"""Fields that hold 0x00RRGGBB in 32 bits, whatever type they claim."""

_CUT: Final = "it is cut off: copy or export it again"

_DAMAGED: Final = (ValueError, TypeError, LookupError, RuntimeError, OSError, struct.error)
"""What pypcd4 raises on damaged files."""


@dataclass(frozen=True, slots=True, eq=False)
class PcdStream:
    """An open file that yields its points chunk by chunk."""

    count: int
    colours: tuple[str, ...]
    """Names of red, green, blue; of one column of three values; or none."""
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""


def stream_pcd(path: Path, *, bounded: bool = True, share: float = 1.0) -> PcdStream:
    """Check a file's header and size, and read its points in parts of a million.

    Parameters
    ----------
    path : pathlib.Path
    bounded : bool
        Refuse points that are text or compressed: pypcd4 reads those only whole. Otherwise they
        are read at once and come as one part.
    share : float
        Read about this share, in parts that are spread over the file; of a file that is read whole
        all of it.

    Raises
    ------
    ReadError
        When the header is wrong, x, y or z is missing, or the data is cut off; names the byte.
    """
    # (1) What a row holds; colours packed into one field, or three fields.
    meta, start = _check_header(path)
    dtype = _row_type(path, meta, start)
    names = [name for name in dtype.names or () if not name.startswith(_PADDING)]
    lower = {name.lower(): name for name in reversed(names)}
    axes = [lower[axis] for axis in "xyz"]
    packed = next((n for n in names if n.lower() in _PACKED and dtype[n].itemsize == 4), None)
    colours = (packed,) if packed is not None else (find_colours(names) or ())

    def chunk_of(table: AnyArray) -> StreamChunk:
        points = np.stack([table[axis].astype(np.float64) for axis in axes], axis=1)
        columns = {n: np.ascontiguousarray(table[n]) for n in names if n not in axes}
        if packed is not None:
            columns[packed] = _unpacked(columns[packed])
        return StreamChunk(points, columns, len(table))

    # (2) Text and compressed points.
    if meta.data != Encoding.BINARY:
        if bounded:
            raise ReadError(
                path,
                f"a PCD file with DATA {meta.data.value} cannot be read in parts",
                "convert it to DATA binary (pcl_convert_pcd_ascii_binary in.pcd out.pcd 1) or to "
                "LAZ, or give --max-memory more",
            )
        chunk = chunk_of(_whole_table(path, meta, start))
        return PcdStream(chunk.read, colours, lambda: iter((chunk,)))

    # (3) Binary points.
    def chunks() -> Iterator[StreamChunk]:
        starts = np.arange(0, meta.points, _CHUNK_POINTS)
        sizes = np.minimum(meta.points - starts, _CHUNK_POINTS)
        for first in starts[spread_pieces(sizes, share)].tolist():
            want = min(_CHUNK_POINTS, meta.points - first)
            offset = start + first * dtype.itemsize
            yield chunk_of(np.fromfile(path, dtype=dtype, count=want, offset=offset))

    return PcdStream(meta.points, colours, chunks)


def _row_type(path: Path, meta: Any, start: int) -> np.dtype[Any]:
    """Type of a row; a type that PCD does not have, or a name twice, is an error."""
    try:
        dtype: np.dtype[Any] = meta.build_dtype()
    except _DAMAGED as error:
        raise _unreadable(path, start, error) from error
    return dtype


def _whole_table(path: Path, meta: Any, start: int) -> AnyArray:
    """Read all points of a text or of compressed data."""
    try:
        with path.open("rb") as file:
            file.seek(start)
            if meta.data == Encoding.ASCII:
                dtype = meta.build_dtype()
                table: AnyArray = np.loadtxt(file, dtype, max_rows=meta.points, ndmin=1)
            else:
                # pypcd4 reads only version 0.7 headers, so it is given one.
                whole = io.BytesIO(meta.compose_header().encode() + file.read())
                table = np.atleast_1d(PointCloud.from_fileobj(io.BufferedReader(whole)).pc_data)
                _interleave(table, meta)
    except _DAMAGED as error:
        raise _unreadable(path, start, error) from error
    if len(table) < meta.points:
        raise ReadError(path, f"the file ends after {len(table):,} of {meta.points:,} points", _CUT)
    return table


def _interleave(table: AnyArray, meta: Any) -> None:
    """Put the values of fields with COUNT > 1 in order: PCL compresses them point by point.

    pypcd4 reads each of the values as a separate column.
    """
    first = 0
    for count in meta.count:
        names = (table.dtype.names or ())[first : first + count]
        first += count
        if count > 1:
            values = np.concatenate([table[name] for name in names]).reshape(len(table), count)
            for name, column in zip(names, values.T, strict=True):
                table[name] = column


def _unreadable(path: Path, start: int, error: Exception) -> ReadError:
    return ReadError(
        path,
        f"the points cannot be read ({' '.join(str(error).split())[:160]})",
        "the file is cut off or damaged: copy or export it again",
        f"byte {start:,}",
    )


def _unpacked(values: AnyArray) -> UInt8:
    """Unpack 0x00RRGGBB to red, green, blue (n, 3)."""
    bits = np.ascontiguousarray(values).view(np.uint32)
    return (np.stack([bits >> 16, bits >> 8, bits], axis=1) & 0xFF).astype(np.uint8)


def _check_header(path: Path) -> tuple[Any, int]:
    """Read the header and check all that it says; with where the points begin."""
    meta, start = _read_header(path)
    if meta.points == 0:
        raise NoPointsError(path, "the header says 0 points", "export the survey again")
    single = {n.lower() for n, count in zip(meta.fields, meta.count, strict=True) if count == 1}
    missing = [axis for axis in "xyz" if axis not in single]
    if missing:
        fields = ", ".join(name for name in meta.fields if not name.startswith(_PADDING))
        raise ReadError(
            path,
            f"there is no field {', '.join(missing)}; the fields are {fields}",
            "export the survey with coordinates named x, y, z",
        )
    _check_size(path, meta, start)
    return meta, start


def _read_header(path: Path) -> tuple[Any, int]:
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER_BYTES)
    match = re.search(rb"^DATA[ \t]+\S+[ \t]*\r?\n", head, re.MULTILINE | re.IGNORECASE)
    if match is None:
        raise ReadError(
            path,
            f"no DATA line within the first {len(head):,} bytes",
            "the file is cut off or no PCD: export the survey again",
        )
    try:
        meta = MetaData.model_validate(_header_entries(head[: match.end()].decode("latin-1")))
    except (pydantic.ValidationError, ValueError, IndexError, KeyError) as error:
        reason = " ".join(str(error).split())[:160]
        raise ReadError(
            path, f"the PCD header is wrong ({reason})", "export the survey again"
        ) from error
    if not len(meta.fields) == len(meta.size) == len(meta.type) == len(meta.count):
        raise ReadError(
            path,
            f"FIELDS, SIZE, TYPE and COUNT have {len(meta.fields)}, {len(meta.size)}, "
            f"{len(meta.type)} and {len(meta.count)} entries, expected the same number",
            "export the survey again",
        )
    return meta, match.end()


def _header_entries(text: str) -> dict[str, Any]:
    """Parse a header; entries that older versions do not have get their default.

    Raises
    ------
    ValueError, IndexError, KeyError
        An entry has no value, is no number, or is missing.
    """
    lines = [line.split() for line in text.splitlines() if line.strip()]
    words = {line[0].upper(): line[1:] for line in lines if not line[0].startswith("#")}
    fields = words["FIELDS"] if "FIELDS" in words else words["COLUMNS"]  # COLUMNS before .7
    version = words.get("VERSION", ["0.7"])[0]
    height = int(words.get("HEIGHT", ["1"])[0])
    width = int(words.get("WIDTH", words.get("POINTS", []))[0])
    return {
        "version": "0.7" if version.removeprefix("0") in _VERSIONS else version,
        "fields": tuple(f"{_PADDING}{i}" if n == "_" else n for i, n in enumerate(fields)),
        "size": tuple(int(word) for word in words.get("SIZE", ["4"] * len(fields))),
        "type": tuple(word.upper() for word in words.get("TYPE", ["F"] * len(fields))),
        "count": tuple(int(word) for word in words.get("COUNT", ["1"] * len(fields))),
        "width": width,
        "height": height,
        "points": int(words["POINTS"][0]) if "POINTS" in words else width * height,
        "data": words["DATA"][0].lower(),
    }


def _check_size(path: Path, meta: Any, start: int) -> None:
    size = path.stat().st_size
    length = sum(s * c for s, c in zip(meta.size, meta.count, strict=True))
    # The least size of each kind of data; text has a digit and a blank a value.
    if meta.data == Encoding.ASCII:
        need = meta.points * 2 * sum(meta.count) - 1
        have = size - start
    elif meta.data == Encoding.BINARY:
        need, have = meta.points * length, size - start
    else:
        with path.open("rb") as file:
            file.seek(start)
            sizes = file.read(8)
        packed, whole = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
        if whole != meta.points * length and len(sizes) == 8:
            raise ReadError(
                path,
                f"the compressed data holds {whole:,} bytes, expected {meta.points * length:,}",
                "the header is damaged: export the survey again",
                f"byte {start:,}",
            )
        need, have = 8 + packed, size - start
    if have < need:
        whole_points = have // length if meta.data == Encoding.BINARY else None
        reason = (
            f"the file ends after {whole_points:,} of {meta.points:,} points"
            if whole_points is not None
            else f"{have:,} bytes of points, expected at least {need:,}"
        )
        raise ReadError(path, reason, _CUT, f"byte {size:,}")
