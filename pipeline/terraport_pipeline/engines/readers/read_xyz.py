"""XYZ, CSV, TXT, ASC and PTS by pyarrow's CSV reader (``terraport[text]``).

How the text is a table is found by :mod:`terraport_pipeline.engines.readers.text_form`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import compute, csv

from terraport_pipeline.engines.readers.clean_text import CleanText
from terraport_pipeline.engines.readers.survey_chunk import StreamChunk
from terraport_pipeline.engines.readers.text_form import NULLS, Layout, find_layout
from terraport_pipeline.errors import ReadError
from terraport_pipeline.survey_statement import LEFT_OUT

__all__ = ["XyzStream", "stream_xyz"]

_BLOCK_BYTES: Final = 1 << 22
"""Text that is normalised and parsed at once."""

_COLOURS: Final = ("red", "green", "blue")
_AXES: Final = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class XyzStream:
    """An open text of points that yields them chunk by chunk."""

    size: int
    """Bytes of the file."""
    warnings: tuple[str, ...]
    colours: tuple[str, ...]
    chunks: Callable[[], Iterator[StreamChunk]]
    """Makes the iterator; once."""
    units: Mapping[str, tuple[str, str]]
    """Units that the text states for x, y and z: its words, and the unit."""


def stream_xyz(
    path: Path, *, columns: tuple[str, ...] | None = None, sampled: bool = False
) -> XyzStream:
    """Read a text in parts; a first pass finds the columns' types.

    Parameters
    ----------
    path : pathlib.Path
        Its suffix matters in one case: ``.pts`` has intensity before colour.
    columns : tuple of str, optional
        Names of all columns, in order; they override a header.
    sampled : bool
        True if the file is a part of a text, which may have fewer points than stated.

    Raises
    ------
    ReadError
        When the text is no table of numbers, x, y or z is missing, columns are degrees or can be
        read in several ways, or a line is damaged; names the line where it can.
    """
    layout = find_layout(path, columns)
    types, rows, counted = _find_types(path, layout)
    wanted_names = [name for name in layout.names if not name.startswith(LEFT_OUT)]
    names = [n for n in wanted_names if types[n] in (pa.int64(), pa.float64())]
    text = [n for n in wanted_names if types[n] == pa.string()]
    warnings = []
    if text:
        warnings.append(_left_out(text))
    if layout.bare:
        warnings.append(_bare(layout))
    if layout.titles:
        warnings.append(_titles(layout.titles))
    if layout.counted is not None and layout.counted + counted != rows and not sampled:
        warnings.append(
            f"The file states {layout.counted + counted:,} points but has {rows:,}: it may be "
            "truncated."
        )
    has_colour = all(name in names for name in _COLOURS)

    def chunks() -> Iterator[StreamChunk]:
        for batch, read, _ in _batches(path, layout, types):
            columns = {name: batch.column(name).to_numpy(zero_copy_only=False) for name in names}
            points = np.stack([columns.pop(axis) for axis in "xyz"], axis=1)
            yield StreamChunk(points, columns, read)

    size, colours = path.stat().st_size, _COLOURS if has_colour else ()
    return XyzStream(size, tuple(warnings), colours, chunks, layout.units)


def _find_types(path: Path, layout: Layout) -> tuple[dict[str, pa.DataType], int, int]:
    """Find the narrowest type of each column, the number of rows, and the sum of point counts."""
    types = {axis: pa.float64() for axis in "xyz"}
    while True:
        seen: dict[str, pa.DataType] = {}
        nulls: set[str] = set()
        count = counted = 0
        try:
            for batch, _, counts in _batches(path, layout, types):
                counted = counts
                _check_colours(path, layout, batch)
                seen = {name: batch.schema.field(name).type for name in layout.names}
                nulls |= {n for n in layout.names if batch.column(n).null_count}
                count += batch.num_rows
        except pa.ArrowInvalid as error:
            # A later row does not fit what the first block looked like: wider, and again.
            match = re.search(r"column #(\d+)", str(error))
            name = layout.names[int(match[1])] if match else ""
            if not match or "conversion error" not in str(error) or name in _AXES:
                raise _no_table(path, layout, error) from error
            former = types.get(name)
            types[name] = pa.string() if former == pa.float64() else pa.float64()
            continue
        if count == 0:
            raise ReadError(path, "there is not one row of numbers", "export the survey again")
        for name, kind in seen.items():
            whole = pa.types.is_integer(kind)
            if whole or pa.types.is_floating(kind):
                # A gap in whole numbers makes them floats.
                types[name] = pa.int64() if whole and name not in nulls else pa.float64()
            else:
                types[name] = pa.null() if pa.types.is_null(kind) else pa.string()
        return types, count, counted


def _check_colours(path: Path, layout: Layout, batch: Any) -> None:
    """Refuse columns that look like colours only in the first rows of a file without header."""
    if layout.colour_top is None:
        return
    for name in _COLOURS:
        span = compute.min_max(batch.column(name)).as_py()
        low, high = span["min"], span["max"]
        if isinstance(low, int | float) and (low < 0 or high > layout.colour_top):
            first = layout.names.index("red") + 1
            raise ReadError(
                path,
                f"columns {first} to {first + 2} are 0 to {layout.colour_top} as colours in the "
                f"first rows, and {low:g} to {high:g} in later ones",
                f"say what the columns are with --columns {','.join(layout.names)}, or with other "
                "names where they are no colours",
            )


def _batches(
    path: Path, layout: Layout, types: dict[str, pa.DataType]
) -> Iterator[tuple[Any, int, int]]:
    """Yield (record batch, bytes of the file read since the last one, points counted so far)."""
    read = 0

    def count(size: int) -> None:
        nonlocal read
        read += size

    with path.open("rb") as file:
        source = CleanText(
            file,
            encoding=layout.encoding,
            delimiter=layout.delimiter,
            skip_lines=layout.skip_lines,
            counted=layout.counted is not None,
            advance=count,
        )
        try:
            reader = csv.open_csv(pa.PythonFile(source, mode="r"), *_csv_options(layout, types))
        except pa.ArrowInvalid as error:
            if "Empty CSV" in str(error):
                return
            raise
        given = 0
        for batch in reader:
            so_far = read  # pyarrow reads ahead in a thread of its own, also while we are away
            yield batch, so_far - given, source.counts
            given = so_far


def _csv_options(layout: Layout, types: dict[str, pa.DataType]) -> tuple[Any, Any, Any]:
    return (
        # One thread: only then does pyarrow know the line of an error.
        csv.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, column_names=layout.names),
        csv.ParseOptions(delimiter=layout.delimiter),
        csv.ConvertOptions(
            column_types=types,
            null_values=list(NULLS),
            decimal_point=layout.decimal,
            strings_can_be_null=True,
            check_utf8=False,  # text columns are ignored, so their encoding does not matter
        ),
    )


def _no_table(path: Path, layout: Layout, error: pa.ArrowInvalid) -> ReadError:
    reason = " ".join(str(error).split())[:200]
    row = re.search(r"Row #(\d+)", reason)
    location = None
    if row is not None:
        others = "comments" if layout.counted is None else "comments and counts"
        location = f"line {int(row[1]) + layout.skip_lines:,} ({others} not counted)"
    return ReadError(
        path,
        f"the text is no table of {len(layout.names)} columns ({reason})",
        "repair the line or export the survey again",
        location,
    )


def _left_out(text: list[str]) -> str:
    return f"The columns {', '.join(text)} hold text and were left out."


def _titles(titles: tuple[str, ...]) -> str:
    shown = "; ".join(repr(line[:40]) for line in titles[:3])
    more = f" and {len(titles) - 3:,} more" if len(titles) > 3 else ""
    return f"What is above the table was left out: {shown}{more}."


def _bare(layout: Layout) -> str:
    return f"The file has no header; its columns were taken as {', '.join(layout.names)}."
