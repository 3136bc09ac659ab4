"""LAS, LAZ and COPC by laspy with lazrs.

COPC is LAZ with an index: its full resolution is read in file order. Every dimension is kept as an
attribute under its LAS name, except X, Y, Z and colour, and except standard fields that hold their
"not set" value in every point (0; 1 for the return numbers). Where an extra dimension states a
value for "no data", points with that value have NaN.

With an extent and a spatial index (:mod:`.las_index`), only blocks that may have points within the
extent are read; a file whose header shows that it is outside is not read.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import laspy
import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int64
from terraport_pipeline.engines.readers.file_sample import spread_pieces
from terraport_pipeline.engines.readers.las_blocks import (
    CHUNK_POINTS,
    Blocks,
    brief,
    count_records,
    file_blocks,
    iterate_blocks,
    means_damage,
    no_blocks,
)
from terraport_pipeline.engines.readers.las_crs import LasCrs, las_crs
from terraport_pipeline.engines.readers.las_index import Selection, select_blocks
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.errors import NoPointsError, ReadError
from terraport_pipeline.extent import Extent

__all__ = ["UNSET", "LasStream", "open_las"]

_CHUNK_POINTS: Final = CHUNK_POINTS
"""Points decoded at once where a file is read from its beginning to its end."""

_MOST_BLOCK_POINTS: Final = 4 * CHUNK_POINTS
"""Points of a block that is still decoded whole; some writers put a whole file into one chunk."""

_WIDEST: Final = 1e7
"""A header that states a wider box is wrong."""

UNSET: Final = {"return_number": (0, 1), "number_of_returns": (0, 1)}
"""Values of a standard field that say nothing when every point has them; 0 for the others."""

_NOISE_CLASSES: Final = (7, 18)
"""Low and high noise (LAS 1.4 R15, table 17); before 1.4 the latter was reserved."""

_HEADER_BYTES: Final = 375
_RECORD_BYTES: Final = 54
_EXTENDED_RECORD_BYTES: Final = 60
"""Sizes of LAS 1.4: public header block, and the heads of variable length records."""

_NO_DATA_BYTE: Final = 40
"""Offset of the 64-bit "no data" value in the description of an extra dimension. laspy wraps values
that the type of the dimension cannot hold."""

_LEGACY_COUNT: Final = 107
"""Offset of the 32-bit number of points in the header."""

_REPAIR: Final = "repair its header (LAStools: lasinfo -repair_counters)"

_MAX_POINTS_PER_BYTE: Final = 2000

_MOST_STEPS: Final = 2.0**52
_STEP_ERROR: Final = 1e-6
"""Scale and offset count as whole numbers of steps of 1/k up to 2^52 of them, within a millionth of
one: what is left of a decimal fraction in float64."""

_WORST_STEP: Final = 0.05
"""Scale factors from this on are worth a warning, in the file's unit."""


@dataclass(frozen=True, slots=True, eq=False)
class LasStream:
    """An open LAS, LAZ or COPC file that yields its points chunk by chunk."""

    count: int
    """Points in the file."""
    stated: LasCrs
    """Coordinate reference system that the file states."""
    warnings: tuple[str, ...]
    standard: frozenset[str]
    """Dimensions that the standard names; they are left out where they hold nothing."""
    whole: frozenset[str]
    """Integer columns that are read as floats because the file states a value for "no data"."""
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""
    box: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    """Corners that the header states, in the file's unit; None where they are nonsense."""
    rows: int
    """Points that are read: fewer than all where an extent and an index leave some out."""
    ranges: tuple[tuple[int, int], ...] | None = None
    """Bytes that are read, as first and the one behind the last; None where all are."""
    remarks: tuple[str, ...] = ()
    """Why an index is not used."""


@contextlib.contextmanager
def open_las(
    path: Path, *, extent: Extent | None = None, share: float = 1.0
) -> Iterator[LasStream]:
    """Open a file for reading in parts of half a million points.

    Parameters
    ----------
    path : pathlib.Path
        Starts with ``LASF``.
    extent : Extent, optional
        Leave out what an index or the header shows to lie outside it. Of what is read, points may
        lie outside it all the same.
    share : float
        Read about this share of what would be read, in chunks spread over the file; of a file
        without a table of them its beginning.

    Raises
    ------
    ReadError
        When the header is damaged, or the file ends before the points that it says; damage in the
        points is found while the parts are read. Names the byte or the point.
    """
    # (1) The header; what laspy cannot read is damage, and so said.
    _check_records(path)
    try:
        reader = laspy.open(path, laz_backend=laspy.LazBackend.Lazrs)
    except BaseException as error:
        if not means_damage(error):
            raise
        raise ReadError(
            path,
            f"the LAS header or the compressed table cannot be read ({brief(error)})",
            "the file is cut off or damaged: copy or export it again",
        ) from error
    # (2) Header and size agree; several threads only where the compressed table is whole.
    with contextlib.ExitStack() as stack:
        stack.enter_context(reader)
        header = reader.header
        count, warnings = _point_count(path, header)
        header.point_count = count
        _check_size(path, header)
        warnings += _further_records(path, header)
        blocks = file_blocks(path, header)
        if header.are_points_compressed and blocks is not None:
            reader = stack.enter_context(
                laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel)
            )
            reader.header.point_count = count
        # (3) Frame, extent and columns.
        stated = las_crs(header)
        warnings += stated.warnings + _tell_steps(header.scales)
        box = _stated_box(header)
        selection, remarks = _select(path, header, box, blocks, extent)
        if share < 1.0:
            selection = _sampled(selection, blocks, share)
        names = [n for n in header.point_format.dimension_names if n not in ("X", "Y", "Z")]
        if not all(names) or len(set(names)) < len(names):
            raise ReadError(
                path,
                f"the point's fields are {', '.join(map(repr, names))}: one has no name or occurs "
                "twice",
                "the header is damaged: copy or export the file again",
            )
        no_data = _stated_no_data(header)

        # (4) Chunks in file order.
        def chunks() -> Iterator[StreamChunk]:
            if selection is not None:
                for numbers, chunk in iterate_blocks(
                    path, header, selection.blocks, selection.wanted
                ):
                    points = _points_of(chunk, header)
                    if extent is not None and selection.intervals is not None:
                        _check_index(path, selection, numbers[extent.holds(points)])
                    yield _chunk_of(points, chunk, names, no_data)
                return
            for first, chunk in _iterate(reader, path, count):
                if first and first >= share * count:
                    return
                yield _chunk_of(_points_of(chunk, header), chunk, names, no_data)

        yield LasStream(
            count,
            stated,
            warnings,
            frozenset(header.point_format.standard_dimension_names),
            _whole_columns(header, no_data),
            chunks,
            box,
            count if selection is None else selection.rows,
            None if selection is None else selection.ranges(path.stat().st_size),
            remarks,
        )


def _select(
    path: Path, header: Any, box: Any, blocks: Blocks | None, extent: Extent | None
) -> tuple[Selection | None, tuple[str, ...]]:
    """Select the blocks to read for an extent; None reads all. Also why an index is not used."""
    if extent is None:
        return None, ()
    # The margin: some writers round the box in the header, some the points.
    step = float(np.abs(header.scales[:2]).max())
    if box is not None and np.isfinite(step) and not extent.touches(box[0], box[1], margin=step):
        return Selection(no_blocks(header), np.zeros(0, bool), "the header"), ()
    if blocks is None:
        return None, ()
    selection, remarks = select_blocks(path, header, blocks, extent)
    if selection is not None and blocks.rows[selection.wanted].max(initial=0) > _MOST_BLOCK_POINTS:
        return None, remarks
    return selection, remarks


def _sampled(selection: Selection | None, blocks: Blocks | None, share: float) -> Selection | None:
    """Select some of the blocks that would be read; None reads on from the beginning."""
    if selection is None:
        if blocks is None or blocks.rows.max(initial=0) > _MOST_BLOCK_POINTS:
            return None
        selection = Selection(blocks, np.ones(len(blocks.rows), bool), "a sample")
    numbers = np.flatnonzero(selection.wanted)
    wanted = np.zeros(len(selection.wanted), bool)
    wanted[numbers[spread_pieces(selection.blocks.rows[numbers], share)]] = True
    return replace(selection, wanted=wanted)


def _stated_box(
    header: Any,
) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """Corners that a header states; some writers leave them 0."""
    low, high = _corner(header.mins), _corner(header.maxs)
    sane = all(0 < b - a < _WIDEST for a, b in zip(low, high, strict=True))
    return (low, high) if sane else None


def _points_of(chunk: Any, header: Any) -> Float64:
    """Coordinates of a chunk."""
    ticks = np.stack([np.asarray(chunk[axis]) for axis in "XYZ"], axis=1)
    return _placed(ticks, header.scales, header.offsets)


def _chunk_of(
    points: Float64, chunk: Any, names: Sequence[str], no_data: Mapping[str, AnyArray]
) -> StreamChunk:
    columns = {name: np.asarray(chunk[name]) for name in names}
    for name, value in no_data.items():
        # The standard stores it in the type of the dimension, before scale and offset.
        stored = chunk.array[name]
        missing = stored == value.astype(stored.dtype)
        kind = columns[name].dtype if columns[name].dtype.kind == "f" else np.dtype(np.float64)
        columns[name] = np.where(missing, kind.type(np.nan), columns[name].astype(kind))
    noise: Bool = np.isin(columns["classification"], _NOISE_CLASSES)
    noise |= columns["withheld"].astype(np.bool_)  # "deleted", says the standard
    return StreamChunk(points, columns, len(chunk), noise)


def _stated_no_data(header: Any) -> dict[str, AnyArray]:
    """Read the "no data" value of each extra dimension (LAS 1.4, table 24).

    Returns
    -------
    dict
        One value per component, by name. A value that the stored type cannot hold marks no point.
    """
    structs = [s for vlr in header.vlrs.get("ExtraBytesVlr") for s in vlr.extra_bytes_structs]
    extra = set(header.point_format.extra_dimension_names)
    stated: dict[str, AnyArray] = {}
    for record in structs:
        name, count = record.format_name(), record.num_elements()
        if not record.data_type or not record.options & record.NO_DATA_BIT_MASK:
            continue
        dtype = record.dtype().base
        wide = {"f": np.float64, "i": np.int64, "u": np.uint64}[dtype.kind]
        values = np.frombuffer(bytes(record), wide, count, _NO_DATA_BYTE)
        with np.errstate(over="ignore"):
            held = values.astype(dtype).astype(wide) == values
        if name in extra and (dtype.kind == "f" or held.all()):
            stated[name] = values if count > 1 else values[0]
    return stated


def _whole_columns(header: Any, no_data: Mapping[str, AnyArray]) -> frozenset[str]:
    """Name the integer columns that become floats because of missing values."""
    return frozenset(
        f"{info.name}_{component}" if info.num_elements > 1 else info.name
        for info in header.point_format.extra_dimensions
        if info.name in no_data and info.scales is None and info.kind.name != "FloatingPoint"
        for component in range(info.num_elements)
    )


def _check_index(path: Path, selection: Selection, rows: Int64) -> None:
    """Refuse an index that leaves out rows which lie within the extent: it is of other points.

    Blocks are read whole, so most indices that do not belong to the file are found out.
    """
    assert selection.intervals is not None
    first, behind = selection.intervals.T
    number = np.searchsorted(first, rows, side="right") - 1
    missed = rows[(number < 0) | (rows >= behind[number])]
    if len(missed):
        raise ReadError(
            path,
            f"{selection.index} leaves out points that lie within the extent",
            "it is of an earlier state of the file: make it again (lasindex), or delete it",
            f"point {int(missed[0]):,}",
        )


def _placed(ticks: AnyArray, scales: Float64, offsets: Float64) -> Float64:
    """Turn stored integers (n, 3) into coordinates that do not depend on the file's offset.

    Tilers give every tile an offset of its own, and ``tick * scale + offset`` in floating point
    then differs in the last bit for one and the same point. Where the offset is a whole number of
    steps of 1/k, which it nearly always is, the sum is done in integers and divided once: the
    nearest float64 to the decimal number that is meant.
    """
    points = np.empty(ticks.shape)
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged scale; dropped later
        for axis in range(3):
            scale, offset = float(scales[axis]), float(offsets[axis])
            steps = np.rint(1.0 / scale) if scale > 0 else 0.0
            first = np.rint(offset * steps)
            whole = (
                1.0 <= steps < _MOST_STEPS
                and abs(scale * steps - 1.0) < _STEP_ERROR
                and abs(first) < _MOST_STEPS
                and abs(offset * steps - first) <= max(_STEP_ERROR, float(np.spacing(abs(first))))
            )
            if whole:
                points[:, axis] = (ticks[:, axis].astype(np.int64) + int(first)) / steps
            else:
                points[:, axis] = ticks[:, axis] * scale + offset
    return points


def _corner(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _check_records(path: Path) -> None:
    """Refuse more variable length records than fit: laspy would read on past the end for hours."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES).ljust(_HEADER_BYTES, b"\0")
    header_size, points_start, records = struct.unpack_from("<HII", head, 94)
    room = min(points_start, size) - header_size
    extended_start, extended = struct.unpack_from("<QI", head, 235)
    if head[25] < 4:  # minor version: extended records came with LAS 1.4
        extended = 0
    if records * _RECORD_BYTES > max(room, 0) or (
        extended * _EXTENDED_RECORD_BYTES > max(size - extended_start, 0)
    ):
        raise ReadError(
            path,
            f"the header says {records:,} records and {extended:,} extended ones, more than fit "
            f"into {size:,} bytes",
            "the file is cut off or damaged: copy or export it again",
        )


def _point_count(path: Path, header: Any) -> tuple[int, tuple[str, ...]]:
    """Read how many points a header states; LAS 1.4 does so twice.

    LAS 1.4 has a 64-bit count and the legacy 32-bit count, which is 0 if the number is too large or
    the point format is new. Some writers fill in only one of them.

    Returns
    -------
    count : int
    warnings : tuple of str

    Raises
    ------
    NoPointsError
        The file has no points.
    ReadError
        The header states 0 points, but compressed points follow.
    """
    count, legacy = int(header.point_count), 0
    present = None if header.are_points_compressed else count_records(path, header)
    warnings: tuple[str, ...] = ()
    if header.version.minor >= 4:
        with path.open("rb") as file:
            file.seek(_LEGACY_COUNT)
            (legacy,) = struct.unpack("<I", file.read(4).ljust(4, b"\0"))
    if legacy not in (0, count):
        taken = legacy if count == 0 or legacy <= (present or 0) < count else count
        warning = (
            f"The header states {count:,} points in the field of LAS 1.4 and {legacy:,} in the "
            f"older one: {taken:,} are read. Export the file again to correct its header."
        )
        count, warnings = taken, (warning,)
    if count == 0 and present:
        warning = (
            f"The header states 0 points, but {present:,} point records follow: all are read. Its "
            f"writer did not finish the file: export it again, or {_REPAIR}."
        )
        count, warnings = present, (warning,)
    if count == 0 and present is None and _stated_chunks(path, header):
        raise ReadError(
            path,
            "the header says 0 points, but compressed points follow",
            f"its writer did not finish the file: export it again, or {_REPAIR}",
        )
    if count == 0:
        raise NoPointsError(path, "the header says 0 points", "export the survey again")
    return count, warnings


def _further_records(path: Path, header: Any) -> tuple[str, ...]:
    """Warn about point records in excess of the stated number."""
    present, count = count_records(path, header), int(header.point_count)
    if present is None or present <= count:
        return ()
    least = "at least " if header.are_points_compressed else ""
    warning = (
        f"The header states {count:,} points, but {least}{present - count:,} further point "
        "records follow: they are left out. If they are of the survey, its writer did not finish "
        f"the file: export it again, or {_REPAIR}."
    )
    return (warning,)


def _stated_chunks(path: Path, header: Any) -> int:
    """Read the number of compressed chunks from the table behind the points; 0 without one."""
    with path.open("rb") as file:
        file.seek(int(header.offset_to_point_data))
        (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\xff"))
        if table < 0:
            return 0
        file.seek(table)
        _, chunks = struct.unpack("<II", file.read(8).ljust(8, b"\0"))
    return int(chunks)


def _check_size(path: Path, header: Any) -> None:
    """Refuse an uncompressed file that is shorter than its header says, before any allocation."""
    size = path.stat().st_size
    start, length = int(header.offset_to_point_data), int(header.point_format.size)
    if header.are_points_compressed:
        _check_compressed(path, start, size, int(header.point_count))
        return
    whole = max(size - start, 0) // length
    if whole < header.point_count:
        raise ReadError(
            path,
            f"the file ends after {whole:,} of {header.point_count:,} points",
            "it is cut off: copy or export it again",
            f"byte {size:,}",
        )


def _check_compressed(path: Path, start: int, size: int, count: int) -> None:
    """Refuse a LAZ whose chunk table lies beyond its end, and one of absurdly many points.

    The points begin with the offset of the chunk table that follows them, or -1 when the writer
    could not go back (then it is in the last eight bytes, and the decoder finds out).
    """
    with path.open("rb") as file:
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\xff"))
    if start + 8 > size:
        raise ReadError(
            path,
            f"the points should begin at byte {start:,}, but the file ends",
            "it is cut off: copy or export it again",
            f"byte {size:,}",
        )
    if table + 8 > size:
        points = max(size - start - 8, 0)
        share = points / max(table - start - 8, 1)
        raise ReadError(
            path,
            f"the compressed points reach to byte {table:,}, but the file ends; about "
            f"{share:.0%} of {count:,} points are there",
            "it is cut off: copy or export it again",
            f"byte {size:,}",
        )
    if table > start:
        _check_chunk_table(path, table, count)
    # Identical points cost LAZ about 1/100 byte; a header that claims far more is damaged.
    if count > _MAX_POINTS_PER_BYTE * size:
        raise ReadError(
            path,
            f"the header says {count:,} points in {size:,} bytes",
            "the header is damaged: export the survey again",
        )


def _check_chunk_table(path: Path, table: int, count: int) -> None:
    """Refuse a table of more chunks than points: lazrs would end the process over its memory."""
    with path.open("rb") as file:
        file.seek(table)
        version, chunks = struct.unpack("<II", file.read(8))
    if version != 0 or chunks > count:
        raise ReadError(
            path,
            f"the table of compressed chunks is damaged (version {version}, {chunks:,} chunks for "
            f"{count:,} points)",
            "copy or export the file again",
            f"byte {table:,}",
        )


def _iterate(reader: Any, path: Path, count: int) -> Iterator[tuple[int, Any]]:
    """Yield (first point, chunk); turn whatever the decoder raises into a ReadError."""
    first = 0
    chunks = reader.chunk_iterator(_CHUNK_POINTS)
    while first < count:
        try:
            chunk = next(chunks, None)
        except BaseException as error:
            if not means_damage(error):
                raise
            last = min(first + _CHUNK_POINTS, count)
            raise ReadError(
                path,
                f"the point data is cut off or damaged between points {first:,} and {last:,} of "
                f"{count:,} ({brief(error)})",
                "copy or export the file again",
                f"point {first:,}",
            ) from error
        if chunk is None or len(chunk) == 0:
            raise ReadError(
                path,
                f"the file ends after {first:,} of {count:,} points",
                "it is cut off: copy or export it again",
                f"point {first:,}",
            )
        yield first, chunk
        first += len(chunk)


def _tell_steps(scales: Float64) -> tuple[str, ...]:
    """Warn of a file that has so coarse a grid that surfaces become stairs."""
    step = float(np.abs(scales).max())
    if not step >= _WORST_STEP:
        return ()
    warning = (
        f"The file has its coordinates in steps of {step:g}: detail below that is lost, and slopes "
        "may come out as stairs. Export the survey with a finer scale factor."
    )
    return (warning,)
