"""The points of a LAS or LAZ file in blocks that can be read one by one.

A block is a chunk of LAZ, or a run of rows where points are not compressed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import laspy
import lazrs
import numpy as np

from terraport_payload.types import Bool, Int64
from terraport_pipeline.errors import ReadError

__all__ = [
    "CHUNK_POINTS",
    "Blocks",
    "brief",
    "count_records",
    "file_blocks",
    "iterate_blocks",
    "means_damage",
    "no_blocks",
]

CHUNK_POINTS: Final = 500_000
"""Points decoded at once: about 60 MB."""

_LAS_BLOCK_ROWS: Final = 50_000
"""Rows of a block where points are not compressed; as many as LAZ writers put into a chunk."""

_DAMAGED: Final = (
    laspy.LaspyException,
    lazrs.LazrsError,
    ArithmeticError,
    EOFError,
    MemoryError,
    OSError,
    ValueError,
)
"""What laspy and lazrs raise on damaged files (found by flipping bytes)."""

_PANIC_MODULE: Final = "pyo3_runtime"
"""Home of the exception that a failed check inside lazrs raises; it has no importable name and is
no :class:`Exception`."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """The points of a file in blocks that can be read one by one, in file order."""

    start: int
    """Byte at which the first begins; the others follow without gaps."""
    rows: Int64
    """(B,) points of each."""
    bytes: Int64
    """(B,)"""

    @property
    def first_row(self) -> Int64:
        """(B,) number of each block's first point."""
        first: Int64 = np.cumsum(self.rows) - self.rows
        return first

    @property
    def first_byte(self) -> Int64:
        """(B,) where each begins."""
        first: Int64 = np.cumsum(self.bytes) - self.bytes + self.start
        return first


def file_blocks(path: Path, header: Any) -> Blocks | None:
    """Cut a file into blocks; None where the table of its chunks is not whole.

    It accounts for every point and byte where it is. The decoder in threads trusts it, and so does
    what reads some blocks only; the decoder that reads on in the file does not need it.
    """
    start, count = int(header.offset_to_point_data), int(header.point_count)
    if not header.are_points_compressed:
        return _row_blocks(start, int(header.point_format.size), count)
    chunks, table = _chunk_table(path, header)
    most = sum(chunk[0] for chunk in chunks)
    end = start + 8 + sum(chunk[1] for chunk in chunks)
    if not (chunks and most - chunks[-1][0] < count <= most and end == table):
        return None
    rows, sizes = np.array(chunks, np.int64).T
    rows = rows.copy()
    rows[-1] -= most - count
    return Blocks(start + 8, rows, sizes)


def _chunk_table(path: Path, header: Any) -> tuple[list[tuple[int, int]], int]:
    """Read (points, bytes) of every chunk, and the offset of their table; none if it is damaged.

    If all chunks have one size, the table states the last one as full, which it need not be.
    """
    start = int(header.offset_to_point_data)
    try:
        with path.open("rb") as file:
            file.seek(start)
            (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\xff"))
            file.seek(start)
            records = header.vlrs.get("LasZipVlr")
            chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(records[0].record_data))
    except BaseException as error:
        if not means_damage(error) and not isinstance(error, (IndexError, TypeError)):
            raise
        return [], 0
    while chunks and chunks[-1] == (0, 0):  # writers that end a chunk before they know of more
        chunks.pop()
    return chunks, table


def count_records(path: Path, header: Any) -> int | None:
    """Count the point records that are in a file, whatever its header says.

    Parameters
    ----------
    path : pathlib.Path
    header : laspy.LasHeader

    Returns
    -------
    int or None
        For a compressed file, the least number that its chunk table allows; None without a table.
    """
    start, size = int(header.offset_to_point_data), path.stat().st_size
    if header.are_points_compressed:
        chunks, table = _chunk_table(path, header)
        if not chunks or table != start + 8 + sum(chunk[1] for chunk in chunks):
            return None
        one_size = len({chunk[0] for chunk in chunks}) == 1
        return sum(chunk[0] for chunk in chunks) - (chunks[-1][0] - 1 if one_size else 0)
    # Extended variable length records may follow the points.
    others = [int(getattr(header, "start_of_waveform_data_packet_record", 0))]
    if header.version.minor >= 4 and header.number_of_evlrs:
        others.append(int(header.start_of_first_evlr))
    end = min([size, *(other for other in others if start < other)])
    return max(end - start, 0) // int(header.point_format.size)


def no_blocks(header: Any) -> Blocks:
    """Give the blocks of a file of which nothing is read: none."""
    return _row_blocks(int(header.offset_to_point_data), 0, 0)


def _row_blocks(start: int, row_bytes: int, count: int) -> Blocks:
    """Cut the rows of a file that is not compressed into blocks."""
    first = np.arange(0, count, _LAS_BLOCK_ROWS, dtype=np.int64)
    rows = np.minimum(count - first, _LAS_BLOCK_ROWS)
    return Blocks(start, rows, rows * row_bytes)


def iterate_blocks(
    path: Path, header: Any, blocks: Blocks, wanted: Bool
) -> Iterator[tuple[Int64, Any]]:
    """Yield (numbers of the rows, points) of some blocks, in file order, in bounded batches."""
    form, compressed = header.point_format, header.are_points_compressed
    record = header.vlrs.get("LasZipVlr")[0].record_data if compressed else b""
    first_row, first_byte = blocks.first_row, blocks.first_byte
    with path.open("rb") as file:
        for batch in _batches(np.flatnonzero(wanted), blocks):
            # (1) The bytes of all its blocks.
            table = [(int(blocks.rows[n]), int(blocks.bytes[n])) for n in batch]
            data = bytearray()
            for number, (_, size) in zip(batch, table, strict=True):
                file.seek(int(first_byte[number]))
                data += file.read(size)
            # (2) Points of them.
            count = sum(rows for rows, _ in table)
            try:
                if compressed:
                    plain = bytearray(count * form.size)
                    lazrs.decompress_points_with_chunk_table(data, record, plain, table)
                    data = plain
                array = np.frombuffer(data, form.dtype(), count)
            except BaseException as error:
                if not means_damage(error):
                    raise
                low, high = int(first_row[batch[0]]), int(first_row[batch[-1]] + table[-1][0])
                raise ReadError(
                    path,
                    f"the point data is cut off or damaged between points {low:,} and {high:,} of "
                    f"{header.point_count:,} ({brief(error)})",
                    "copy or export the file again",
                    f"point {low:,}",
                ) from error
            numbers = np.concatenate(
                [np.arange(first_row[n], first_row[n] + blocks.rows[n]) for n in batch]
            )
            yield numbers, laspy.PackedPointRecord(array, form)


def _batches(numbers: Int64, blocks: Blocks) -> Iterator[Int64]:
    """Cut the blocks that are read into batches of half a million points, or of one block."""
    first = rows = 0
    for at, number in enumerate(numbers):
        if at > first and rows + blocks.rows[number] > CHUNK_POINTS:
            yield numbers[first:at]
            first, rows = at, 0
        rows += int(blocks.rows[number])
    if len(numbers):
        yield numbers[first:]


def means_damage(error: BaseException) -> bool:
    """Whether laspy or lazrs raise it on damaged files."""
    return isinstance(error, _DAMAGED) or type(error).__module__ == _PANIC_MODULE


def brief(error: BaseException) -> str:
    """Say an error in one line of some length, for a message."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text[:160]
