"""PCD (ascii, binary, binary_compressed) by pypcd4.

Format: Point Cloud Library, "The PCD file format", version 0.7. Sizes are checked against the file
before pypcd4 allocates anything. Padding fields (``_``) are left out; the viewpoint is ignored
(PCL stores coordinates with it applied).
"""

from __future__ import annotations

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
from terraport_pipeline.engines.readers.raw_survey import (
    Advance,
    RawSurvey,
    StreamChunk,
    find_colours,
    thinning_rows,
    to_eight_bits,
)
from terraport_pipeline.errors import NoPointsError, ReadError

__all__ = ["PcdStream", "is_binary_pcd", "read_pcd", "stream_pcd"]

_MAX_HEADER_BYTES: Final = 1 << 14

_CHUNK_POINTS: Final = 1_000_000

_PADDING: Final = "#$%&~~"
"""pypcd4's own name for fields that the file calls ``_``."""

_PACKED: Final = ("rgb", "rgba")
"""Fields that hold 0x00RRGGBB in 32 bits, whatever type they claim."""

_CUT: Final = "it is cut off: copy or export it again"


def read_pcd(path: Path, *, advance: Advance, max_points: int | None = None) -> RawSurvey:
    """Read a PCD file.

    Parameters
    ----------
    path : pathlib.Path
    advance : callable
        Told of progress: once, pypcd4 reads in one go.
    max_points : int, optional
        Thin to this many points (after reading).

    Raises
    ------
    ReadError
        When the header is wrong, x, y or z is missing, or the data is cut off; names the byte.
    """
    meta, start = _check_header(path)
    try:
        table = PointCloud.from_path(path).pc_data
    except (ValueError, TypeError, LookupError, RuntimeError, OSError, struct.error) as error:
        raise ReadError(
            path,
            f"the points cannot be read ({' '.join(str(error).split())[:160]})",
            "the file is cut off or damaged: copy or export it again",
            f"byte {start:,}",
        ) from error
    table = np.atleast_1d(table)
    if len(table) < meta.points:
        raise ReadError(path, f"the file ends after {len(table):,} of {meta.points:,} points", _CUT)
    rows = thinning_rows(len(table), max_points)
    advance(len(table), len(table))
    return _assemble(table if rows is None else table[rows])


@dataclass(frozen=True, slots=True, eq=False)
class PcdStream:
    """An open binary PCD file that yields its points chunk by chunk."""

    count: int
    colours: tuple[str, ...]
    """Names of red, green, blue; of one column of three values; or none."""
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""


def stream_pcd(path: Path, *, max_points: int | None = None, share: float = 1.0) -> PcdStream:
    """Check a binary file as :func:`read_pcd` does, and read its points in parts of a million.

    With a `share` below 1 about so much is read, in parts that are spread over the file.

    Raises
    ------
    ReadError
        Also when the points are text or compressed: pypcd4 reads those only whole.
    """
    meta, start = _check_header(path)
    if meta.data != Encoding.BINARY:
        raise ReadError(
            path,
            f"a PCD file with DATA {meta.data.value} cannot be read in parts",
            "convert it to DATA binary (pcl_convert_pcd_ascii_binary in.pcd out.pcd 1) or to LAZ, "
            "or give --max-memory more",
        )
    dtype = meta.build_dtype()
    rows = thinning_rows(meta.points, max_points)
    names = [name for name in dtype.names or () if not name.startswith(_PADDING)]
    packed = next((n for n in names if n.lower() in _PACKED and dtype[n].itemsize == 4), None)
    colours = (packed,) if packed is not None else (find_colours(names) or ())

    def chunks() -> Iterator[StreamChunk]:
        starts = np.arange(0, meta.points, _CHUNK_POINTS)
        sizes = np.minimum(meta.points - starts, _CHUNK_POINTS)
        for first in starts[spread_pieces(sizes, share)].tolist():
            want = min(_CHUNK_POINTS, meta.points - first)
            offset = start + first * dtype.itemsize
            table = np.fromfile(path, dtype=dtype, count=want, offset=offset)
            if rows is not None:
                low, high = np.searchsorted(rows, (first, first + want))
                table = table[rows[low:high] - first]
            points = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
            columns = {n: np.ascontiguousarray(table[n]) for n in names if n not in ("x", "y", "z")}
            if packed is not None:
                columns[packed] = _unpacked(columns[packed])
            yield StreamChunk(points, columns, want)

    return PcdStream(meta.points, colours, chunks)


def is_binary_pcd(path: Path) -> bool:
    """Whether the points are plain binary, which :func:`stream_pcd` needs."""
    meta, _ = _check_header(path)
    return bool(meta.data == Encoding.BINARY)


def _unpacked(values: AnyArray) -> UInt8:
    """Unpack 0x00RRGGBB to red, green, blue (n, 3)."""
    bits = np.ascontiguousarray(values).view(np.uint32)
    return (np.stack([bits >> 16, bits >> 8, bits], axis=1) & 0xFF).astype(np.uint8)


def _check_header(path: Path) -> tuple[Any, int]:
    """Read the header and check all that it says; with where the points begin."""
    meta, start = _read_header(path)
    if meta.points == 0:
        raise NoPointsError(path, "the header says 0 points", "export the survey again")
    single = {name for name, count in zip(meta.fields, meta.count, strict=True) if count == 1}
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
    match = re.search(rb"^DATA[ \t]+\S+[ \t]*\r?\n", head, re.MULTILINE)
    if match is None:
        raise ReadError(
            path,
            f"no DATA line within the first {len(head):,} bytes",
            "the file is cut off or no PCD: export the survey again",
        )
    lines = head[: match.end()].decode("latin-1").splitlines()
    try:
        meta = MetaData.parse_header([line.strip() for line in lines if line.strip()])
    except (pydantic.ValidationError, ValueError, IndexError) as error:
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


def _assemble(table: AnyArray) -> RawSurvey:
    names = [name for name in table.dtype.names or () if not name.startswith(_PADDING)]
    points = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    used = {"x", "y", "z"}
    packed = next((name for name in names if name.lower() in _PACKED), None)
    triple = find_colours(names)
    colours: UInt8 | None = None
    warnings: tuple[str, ...] = ()
    if packed is not None and table.dtype[packed].itemsize == 4:
        colours, warnings = to_eight_bits(_unpacked(table[packed]), where=packed)
        used.add(packed)
    elif triple is not None:
        channels = np.stack([table[name] for name in triple], axis=1)
        colours, warnings = to_eight_bits(channels, where=", ".join(triple))
        used |= set(triple)
    attributes = {name: np.ascontiguousarray(table[name]) for name in names if name not in used}
    return RawSurvey(points, colours, attributes, None, warnings)
