"""PTX (Leica Cyclone and other programs) by pyarrow's CSV reader (``terraport[text]``).

A file holds one scan after another, each a grid of returns: two lines with its columns and rows,
four with the scanner's position and axes, four with a matrix, and a line ``x y z intensity [red
green blue]`` for each cell. The matrix transforms a row vector ``x y z 1`` to the survey's
coordinates; the position repeats its translation. A cell without a return is ``0 0 0``. Lengths are
in metres.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
import pyarrow as pa
from pyarrow import csv

from terraport_payload.types import AnyArray, Float64
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.errors import ReadError

__all__ = ["PtxStream", "stream_ptx"]

_CHUNK_ROWS: Final = 200_000

_COLOURS: Final = ("red", "green", "blue")
_NAMES: Final = {
    3: ("x", "y", "z"),
    4: ("x", "y", "z", "intensity"),
    7: ("x", "y", "z", "intensity", *_COLOURS),
}
"""Names of the columns, by their number."""

_HEADER_WIDTHS: Final = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
"""Number of values in each header line of a scan."""

_ROTATION_TOLERANCE: Final = 1e-3
"""Largest error of a rotation: matrices are written with 6 decimals; a scale differs more."""

_POSITION_TOLERANCE_M: Final = 0.01

_SURPLUS: Final = (b"\t", b"  ", b" \n", b" \r", b"\n ")
"""Bytes that occur in a text whose values are not separated by single blanks; the check is fast."""

_BLANKS: Final = re.compile(rb"[ \t]+")
_EDGES: Final = re.compile(rb"^ | ?\r?$", re.MULTILINE)

_AGAIN: Final = "it is cut off or damaged: copy or export it again"


@dataclass(frozen=True, slots=True)
class _Scan:
    rows: int
    names: tuple[str, ...]
    matrix: Float64
    """(4, 4); row vectors times it are the survey's coordinates."""
    stray_m: float
    """Distance between the stated position and the matrix's translation, metres."""
    start: int
    """Byte offset of the first row."""


@dataclass(frozen=True, slots=True, eq=False)
class PtxStream:
    """An open file that yields its points chunk by chunk."""

    count: int
    """Number of cells of all scans, including those without a return."""
    warnings: tuple[str, ...]
    late_warnings: Callable[[], tuple[str, ...]]
    """Returns the warnings that are known once all chunks are read."""
    colours: tuple[str, ...]
    """Names of red, green, blue, or none."""
    scans: int
    chunks: Callable[[], Iterator[StreamChunk]]
    """Creates the iterator; call it once."""


def stream_ptx(path: Path) -> PtxStream:
    """Check the headers of all scans, and read their points in chunks.

    Raises
    ------
    ReadError
        A header is wrong, a matrix is no rotation and translation, or the file is cut off; names
        the scan. Damaged rows are found while they are read.
    """
    # (1) All headers; a field of any scan becomes a column, with NaN in the other scans.
    scans = _find_scans(path)
    names = list(dict.fromkeys(n for scan in scans for n in scan.names if n not in ("x", "y", "z")))
    total = sum(scan.rows for scan in scans)
    empty = 0

    # (2) The rows, scan by scan.
    def chunks() -> Iterator[StreamChunk]:
        nonlocal empty
        for number, scan in enumerate(scans):
            for table in _tables(path, scan, number):
                points = np.stack([table[axis] for axis in "xyz"], axis=1)
                there = points.any(axis=1)
                empty += len(points) - int(there.sum())
                placed = points[there] @ scan.matrix[:3, :3] + scan.matrix[3, :3]
                nothing = np.full(len(points), np.nan)
                columns = {name: table.get(name, nothing)[there] for name in names}
                if len(scans) > 1:
                    columns["scan"] = np.full(len(placed), number, dtype=np.float64)
                yield StreamChunk(placed, columns, len(points), scan=number)

    def late_warnings() -> tuple[str, ...]:
        if not empty:
            return ()
        return (f"{empty:,} of {total:,} cells of the scans have no return: left out.",)

    warnings = []
    has_colour = "red" in names
    grey = [str(number) for number, scan in enumerate(scans) if "red" not in scan.names]
    if has_colour and grey:
        warnings.append(f"There is no colour in scan {', '.join(grey)}: its points are grey.")
    moved = [number for number, scan in enumerate(scans) if scan.stray_m > _POSITION_TOLERANCE_M]
    if moved:
        warnings.append(
            f"In {len(moved):,} of {len(scans):,} scans the stated position differs from the "
            f"matrix by up to {max(scan.stray_m for scan in scans):,.2f} m: the matrix is used."
        )
    colours = _COLOURS if has_colour else ()
    return PtxStream(total, tuple(warnings), late_warnings, colours, len(scans), chunks)


def _find_scans(path: Path) -> list[_Scan]:
    """Read every header, and skip the rows."""
    scans: list[_Scan] = []
    with path.open("rb") as file:
        while True:
            lines = list(itertools.islice(_lines(file), len(_HEADER_WIDTHS)))
            if not lines and scans:
                return scans
            columns, rows, position, matrix = _header(path, lines, len(scans))
            stray_m = float(np.linalg.norm(position - matrix[3, :3]))
            start = file.tell()
            width = len(file.readline().split())
            if width not in _NAMES:
                raise ReadError(
                    path,
                    f"a row of scan {len(scans)} has {width} values, expected 4 (x y z intensity) "
                    "or 7 (and red green blue)",
                    "export the survey again",
                    f"byte {start:,}",
                )
            there = 1 + sum(1 for _ in itertools.islice(file, columns * rows - 1))
            if there < columns * rows:
                raise _cut(path, len(scans), there, columns * rows)
            scans.append(_Scan(columns * rows, _NAMES[width], matrix, stray_m, start))


def _lines(file: BinaryIO) -> Iterator[bytes]:
    """Yield the lines that are not blank, without reading ahead."""
    while line := file.readline():
        if line.strip():
            yield line


def _header(path: Path, lines: list[bytes], number: int) -> tuple[int, int, Float64, Float64]:
    """Parse the header of a scan: columns, rows, position, matrix."""
    values = [line.split() for line in lines]
    try:
        for line, width in zip(values, _HEADER_WIDTHS, strict=True):
            np.array(line, dtype="S").astype(np.float64).reshape(width)
        columns, rows = int(values[0][0]), int(values[1][0])
        position = np.array(values[2], dtype="S").astype(np.float64)
        matrix = np.array(values[6:], dtype="S").astype(np.float64)
    except ValueError as error:
        shown = b" | ".join(line.strip() for line in lines).decode("latin-1")[:80]
        raise ReadError(
            path,
            f"{shown!r} is not the header of scan {number}: expected two lines with its columns "
            "and rows, four of three numbers, four of four",
            f"it is no PTX, or {_AGAIN.removeprefix('it is ')}",
        ) from error
    if columns * rows <= 0:
        raise ReadError(path, f"scan {number} has {columns:,} x {rows:,} cells", _AGAIN)
    turn = matrix[:3, :3]
    is_rigid = np.allclose(turn @ turn.T, np.eye(3), atol=_ROTATION_TOLERANCE)
    is_affine = np.allclose(matrix[:, 3], (0, 0, 0, 1), atol=1e-9)
    if not (np.isfinite(matrix).all() and is_affine and is_rigid and np.linalg.det(turn) > 0):
        raise ReadError(
            path,
            f"the matrix of scan {number} is {matrix.tolist()}, expected a rotation with the "
            "translation in its last row, and 0 0 0 1 in its last column",
            "export the survey again",
        )
    return columns, rows, position, matrix


def _tables(path: Path, scan: _Scan, number: int) -> Iterator[dict[str, AnyArray]]:
    """Yield the rows of a scan, some at a time, column by column."""
    with path.open("rb") as file:
        file.seek(scan.start)
        for first in range(0, scan.rows, _CHUNK_ROWS):
            want = min(_CHUNK_ROWS, scan.rows - first)
            lines = list(itertools.islice(file, want))
            block = b"".join(lines).lstrip(b" ")
            if any(blanks in block for blanks in _SURPLUS):  # most writers use single blanks
                block = _EDGES.sub(b"", _BLANKS.sub(b" ", block))
            try:
                table = csv.read_csv(
                    io.BytesIO(block),
                    csv.ReadOptions(use_threads=False, column_names=scan.names),
                    csv.ParseOptions(delimiter=" "),
                    csv.ConvertOptions(column_types=dict.fromkeys(scan.names, pa.float64())),
                )
            except pa.ArrowInvalid as error:
                raise ReadError(
                    path,
                    f"a row of scan {number} is not {len(scan.names)} numbers "
                    f"({' '.join(str(error).split())[:160]})",
                    _AGAIN,
                    f"row {first:,} of the scan, or up to {want:,} later",
                ) from error
            if table.num_rows < want:
                raise _cut(path, number, first + table.num_rows, scan.rows)
            yield {name: table.column(name).to_numpy() for name in scan.names}


def _cut(path: Path, number: int, there: int, rows: int) -> ReadError:
    return ReadError(path, f"scan {number} ends after {there:,} of {rows:,} rows", _AGAIN)
