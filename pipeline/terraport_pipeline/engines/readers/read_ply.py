"""PLY (ASCII, binary little and big endian) by a structured NumPy type; no other code needed.

Format: Greg Turk, "The PLY Polygon File Format", 1994. Every scalar property of the ``vertex``
element is kept; its list properties (the images of a point, by OpenMVS) and other elements (faces)
are named in a warning and left out. plyfile would do it too, but is GPL-3.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from terraport_payload.types import AnyArray, Float64
from terraport_pipeline.engines.readers.file_sample import spread_pieces
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.survey_colours import find_colours
from terraport_pipeline.errors import ReadError

__all__ = ["PlyStream", "has_faces", "stream_ply"]

_MAX_HEADER_BYTES: Final = 1 << 16
"""A header of 64 KiB has a thousand properties; more is no PLY."""

_CHUNK_POINTS: Final = 1_000_000

_ASCII_CHUNK: Final = 200_000

_LISTS_BYTES: Final = 1 << 24
"""Bytes of rows with lists that are read at once; also the maximum size of a row."""

_TYPES: Final = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

_PROPERTY: Final = {"property": _TYPES}
"""The only further key word of a header; looking it up refuses every other one."""

_ENDIAN: Final = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

_AGAIN: Final = "export the survey again"


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    code: str
    """NumPy type code of the value, or of a list's values."""
    count_code: str | None = None
    """Type code of a list's length; None for a scalar."""


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)
    """In file order."""

    @property
    def scalars(self) -> list[_Property]:
        return [one for one in self.properties if one.count_code is None]

    @property
    def lists(self) -> list[_Property]:
        return [one for one in self.properties if one.count_code is not None]


@dataclass(frozen=True, slots=True)
class _Header:
    format: str
    elements: list[_Element]
    length: int
    """Bytes up to and including the line ``end_header``."""


@dataclass(frozen=True, slots=True, eq=False)
class PlyStream:
    """An open file; its vertices come in parts."""

    count: int
    warnings: tuple[str, ...]
    colours: tuple[str, ...]
    """Names of red, green, blue, or none."""
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""


def stream_ply(path: Path, *, share: float = 1.0) -> PlyStream:
    """Check a file's header, and read its vertices in parts of a million.

    With a `share` below 1, about that share is read: evenly spread parts of a binary file, or the
    beginning of a text file or of a file with lists at vertices. Columns keep the spelling of their
    properties; ``x``, ``y``, ``z`` and the colours are recognised in any case.

    Raises
    ------
    ReadError
        When the header is not PLY, or x, y or z is missing; names the line. Vertices that are cut
        off or damaged are found while they are read; names the byte or the vertex.
    """
    with path.open("rb") as file:
        header = _read_header(path, file)
    vertex, before, others = _find_vertex(path, header)
    _check_names(path, vertex)
    tables: Callable[..., Iterator[AnyArray]] = partial(_binary_tables, share=share)
    in_order = header.format == "ascii" or any(element.lists for element in [vertex, *before])
    if in_order:
        tables = _ascii_tables if header.format == "ascii" else _listed_tables
    names = [one.name for one in vertex.scalars]
    lower = {name.lower(): name for name in reversed(names)}
    axes = [lower[axis] for axis in "xyz"]

    def chunks() -> Iterator[StreamChunk]:
        done = 0
        for table in tables(path, header, vertex, before):
            points = np.stack([table[axis].astype(np.float64) for axis in axes], axis=1)
            columns = {
                name: np.ascontiguousarray(table[name]) for name in names if name not in axes
            }
            yield StreamChunk(points, columns, len(table))
            done += len(table)
            if in_order and done >= share * vertex.count:
                return

    return PlyStream(vertex.count, _ignored(vertex, others), find_colours(names) or (), chunks)


def has_faces(path: Path) -> bool:
    """Whether a file is a mesh by its header; False where that cannot be read."""
    try:
        with path.open("rb") as file:
            header = _read_header(path, file)
    except (OSError, ReadError):
        return False
    return any(element.name == "face" and element.count for element in header.elements)


def _ignored(vertex: _Element, others: list[_Element]) -> tuple[str, ...]:
    warnings = []
    if vertex.lists:
        names = ", ".join(one.name for one in vertex.lists)
        warnings.append(f"The vertices' lists ({names}) are left out.")
    if others:
        counts = " and ".join(f"{element.count:,} {element.name}" for element in others)
        warnings.append(f"Only the vertices are read; the file's {counts} elements are ignored.")
    return tuple(warnings)


def _read_header(path: Path, file: BinaryIO) -> _Header:
    head = file.read(_MAX_HEADER_BYTES)
    end = head.find(b"end_header")
    line_end = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or line_end < 0:
        raise ReadError(
            path,
            f"no PLY header ends within the first {len(head):,} bytes",
            f"the file is cut off or no PLY: {_AGAIN}",
        )
    file_format = ""
    elements: list[_Element] = []
    for number, raw in enumerate(head[:end].decode("latin-1").splitlines(), start=1):
        words = raw.split()
        if not words or words[0] in ("ply", "comment", "obj_info"):
            continue
        try:
            if words[0] == "format":
                file_format = words[1]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2])))
            elif words[1] == "list":
                count_code, code = (_PROPERTY[words[0]][word] for word in words[2:4])
                elements[-1].properties.append(_Property(words[4], code, count_code))
            else:
                elements[-1].properties.append(_Property(words[2], _PROPERTY[words[0]][words[1]]))
        except (IndexError, KeyError, ValueError) as error:
            raise ReadError(
                path, f"{raw.strip()!r} is no PLY header line", _AGAIN, f"line {number}"
            ) from error
    if file_format not in _ENDIAN:
        raise ReadError(
            path, f"format is {file_format!r}, expected one of {', '.join(_ENDIAN)}", _AGAIN
        )
    return _Header(file_format, elements, line_end + 1)


def _find_vertex(path: Path, header: _Header) -> tuple[_Element, list[_Element], list[_Element]]:
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        raise ReadError(
            path,
            f"there is no vertex element, only {', '.join(names) or 'nothing'}",
            "export points",
        )
    at = names.index("vertex")
    vertex, before = header.elements[at], header.elements[:at]
    if vertex.count <= 0:
        raise ReadError(path, f"the header says {vertex.count:,} vertices", _AGAIN)
    negative = next((element for element in before if element.count < 0), None)
    if negative is not None:
        raise ReadError(path, f"the header says {negative.count:,} {negative.name}", _AGAIN)
    others = [e for e in header.elements if e is not vertex and e.count > 0]
    return vertex, before, others


def _check_names(path: Path, vertex: _Element) -> None:
    names = [one.name for one in vertex.scalars]
    missing = [axis for axis in "xyz" if axis not in {name.lower() for name in names}]
    if missing:
        raise ReadError(
            path,
            f"the vertices have no {', '.join(missing)}; their properties are {', '.join(names)}",
            "export the survey with coordinates named x, y, z",
        )
    # Their middles lie beside the ground, colours are in f_dc: a grey, rough scene would come out.
    if {"f_dc_0", "scale_0", "rot_0"} <= set(names):
        raise ReadError(
            path,
            "these are Gaussian splats (f_dc_0, scale_0, rot_0), not points of a surface",
            "give the point cloud that they were trained from, or one that their program exports",
        )
    if len(set(names)) < len(names):
        raise ReadError(path, "two vertex properties have the same name", _AGAIN)


def _row_type(element: _Element, file_format: str) -> np.dtype[Any]:
    endian = _ENDIAN[file_format]
    return np.dtype([(one.name, endian + one.code) for one in element.scalars])


def _binary_tables(
    path: Path,
    header: _Header,
    vertex: _Element,
    before: list[_Element],
    share: float = 1.0,
) -> Iterator[AnyArray]:
    """Yield vertices of a binary file, a million at a time."""
    dtype = _row_type(vertex, header.format)
    start = header.length
    for element in before:
        start += element.count * _row_type(element, header.format).itemsize
    size = path.stat().st_size
    whole = max(size - start, 0) // dtype.itemsize
    if whole < vertex.count:
        raise ReadError(
            path,
            f"the file ends after {whole:,} of {vertex.count:,} vertices",
            "it is cut off: copy or export it again",
            f"byte {size:,}",
        )
    starts = np.arange(0, vertex.count, _CHUNK_POINTS)
    sizes = np.minimum(vertex.count - starts, _CHUNK_POINTS)
    for first in starts[spread_pieces(sizes, share)].tolist():
        want = min(_CHUNK_POINTS, vertex.count - first)
        # Not mapped: mapped pages count as this process's memory until something else needs it.
        table = np.fromfile(path, dtype=dtype, count=want, offset=start + first * dtype.itemsize)
        yield table.astype(dtype.newbyteorder("="), copy=False)


class _ListedRows:
    """Offsets of the rows, and of their runs of scalars, in a binary element with lists."""

    def __init__(self, path: Path, element: _Element, file_format: str) -> None:
        self._path, self._element = path, element
        endian = _ENDIAN[file_format]
        # Runs of scalars, with the list that follows each; the last run has none.
        self._runs: list[np.dtype[Any]] = []
        self._lists: list[tuple[struct.Struct, int]] = []
        run: list[tuple[str, str]] = []
        for one in element.properties:
            if one.count_code is None:
                run.append((one.name, endian + one.code))
                continue
            count = struct.Struct(endian + np.dtype(one.count_code).char)
            self._lists.append((count, np.dtype(one.code).itemsize))
            self._runs.append(np.dtype(run))
            run = []
        self._runs.append(np.dtype(run))

    def blocks(self, file: BinaryIO) -> Iterator[tuple[bytes, list[list[int]]]]:
        """Yield bytes, with the offsets of the runs of scalars of each row.

        At the end the file is positioned after the element's last row.
        """
        data, done = b"", 0
        while done < self._element.count:
            more = file.read(_LISTS_BYTES)
            data += more
            rows, end = self._find(data, self._element.count - done, done)
            if not rows and (not more or len(data) > _LISTS_BYTES):
                raise ReadError(
                    self._path,
                    f"the file ends after {done:,} of {self._element.count:,} "
                    f"{self._element.name} rows, or a list in the next is longer than "
                    f"{_LISTS_BYTES:,} bytes",
                    "it is cut off or damaged: copy or export it again",
                    f"byte {file.tell() - len(data):,}",
                )
            yield data, rows
            done += len(rows)
            data = data[end:]
        file.seek(-len(data), 1)

    def _find(self, data: bytes, want: int, done: int) -> tuple[list[list[int]], int]:
        """Find the complete rows, and the end of the last one."""
        steps = [
            (run.itemsize, count.unpack_from, count.size, item)
            for run, (count, item) in zip(self._runs, self._lists, strict=False)
        ]
        tail, size = self._runs[-1].itemsize, len(data)
        rows: list[list[int]] = []
        end = 0
        while len(rows) < want:
            at = end
            starts = [at]
            for before, unpack, width, item in steps:
                at += before
                if at + width > size:
                    return rows, end
                number = unpack(data, at)[0]
                if not 0 <= number <= size:  # also refuses floats, which cannot be a length
                    raise ReadError(
                        self._path,
                        f"a list has {number:,} values",
                        "it is damaged: copy or export it again",
                        f"{self._element.name} {done + len(rows):,}",
                    )
                at += width + int(number) * item
                starts.append(at)
            if at + tail > size:
                return rows, end
            rows.append(starts)
            end = at + tail
        return rows, end

    def table(self, data: bytes, rows: list[list[int]], dtype: np.dtype[Any]) -> AnyArray:
        """Return the scalars of the rows that were found."""
        values = np.frombuffer(data, np.uint8)
        starts = np.array(rows, np.int64)
        table = np.empty(len(rows), dtype)
        for column, run in enumerate(self._runs):
            if run.names:
                each = values[starts[:, column, None] + np.arange(run.itemsize)].view(run)[:, 0]
                for name in run.names:
                    table[name] = each[name]
        return table


def _listed_tables(
    path: Path, header: _Header, vertex: _Element, before: list[_Element]
) -> Iterator[AnyArray]:
    """Yield vertices of a binary file where they, or elements before them, have lists."""
    dtype = _row_type(vertex, header.format).newbyteorder("=")
    with path.open("rb") as file:
        file.seek(header.length)
        for element in before:
            for _ in _ListedRows(path, element, header.format).blocks(file):
                pass
        rows = _ListedRows(path, vertex, header.format)
        for data, found in rows.blocks(file):
            if found:
                yield rows.table(data, found, dtype)


def _ascii_tables(
    path: Path, header: _Header, vertex: _Element, before: list[_Element]
) -> Iterator[AnyArray]:
    """Yield vertices of a text, some at a time."""
    # (1) Refuse a header that promises more than the file can hold, before memory is taken for
    # it.
    dtype = _row_type(vertex, "ascii")
    columns = len(vertex.properties)  # a list has at least one word, its length
    size = path.stat().st_size
    if vertex.count * 2 * columns > size + 1:  # a digit and a blank for each value
        raise ReadError(
            path,
            f"the header says {vertex.count:,} vertices of {columns} values, the file has only "
            f"{size:,} bytes",
            "it is cut off: copy or export it again",
        )
    # (2) Skip what stands before the vertices, then read them chunk by chunk.
    with path.open("rb") as file:
        file.seek(header.length)
        for _ in range(sum(element.count for element in before)):
            file.readline()
        for first in range(0, vertex.count, _ASCII_CHUNK):
            want = min(_ASCII_CHUNK, vertex.count - first)
            values = _parse_lines(path, list(itertools.islice(file, want)), first, vertex)
            if len(values) < want:
                raise ReadError(
                    path,
                    f"the file ends after {first + len(values):,} of {vertex.count:,} vertices",
                    "it is cut off: copy or export it again",
                    f"vertex {first + len(values):,}",
                )
            table = np.zeros(want, dtype=dtype)
            for column, one in enumerate(vertex.scalars):
                table[one.name] = values[:, column]
            yield table


def _parse_lines(path: Path, lines: list[bytes], first: int, vertex: _Element) -> Float64:
    """Parse vertex lines; float64 holds every integer that PLY knows exactly."""
    columns = len(vertex.scalars)
    try:
        if vertex.lists:
            tokens = [word for line in lines for word in _scalar_words(line.split(), vertex)]
        else:
            tokens = b" ".join(lines).split()
        return np.array(tokens, dtype="S").astype(np.float64).reshape(len(lines), columns)
    except ValueError as error:
        raise _bad_line(path, lines, first, vertex, error) from error


def _scalar_words(words: list[bytes], vertex: _Element) -> list[bytes]:
    """Return the words of a row without its lists.

    Raises
    ------
    ValueError
        The row has fewer or more values than its lists' lengths say.
    """
    out = []
    at = 0
    for one in vertex.properties:
        if at >= len(words):
            raise ValueError
        if one.count_code is None:
            out.append(words[at])
            at += 1
        else:
            at += 1 + max(int(words[at]), 0)
    if at != len(words):
        raise ValueError
    return out


def _bad_line(
    path: Path, lines: list[bytes], first: int, vertex: _Element, cause: ValueError
) -> Exception:
    """Find the line that is no row of numbers."""
    columns = len(vertex.scalars)
    for number, line in enumerate(lines):
        words = line.split()
        try:
            if vertex.lists:
                words = _scalar_words(words, vertex)
            np.array(words, dtype="S").astype(np.float64)
            fine = len(words) == columns
        except ValueError:
            fine = False
        if not fine:
            text = line.decode("latin-1").strip()[:80]
            lists = f" and {len(vertex.lists)} lists" if vertex.lists else ""
            return ReadError(
                path,
                f"{text!r} is no row of {columns} numbers{lists}",
                "the file is cut off or damaged: copy or export it again",
                f"vertex {first + number:,}",
            )
    return cause
