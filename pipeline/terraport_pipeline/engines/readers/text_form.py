"""How a text is a table of points: delimiter, decimal sign, header, and what its columns are.

Delimiter (comma, semicolon, tab or blanks), decimal comma (with semicolons, tabs or blanks) and a
header are detected from the start of the file; columns that the user states go before a header.
Lines that begin with ``#`` or ``//`` are comments; one directly above the first row that names as
many columns as the row has is the header (CloudCompare writes it so). A first line with a single
whole number is a point count (PTS).
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.readers.text_columns import (
    DEGREES,
    first_column_names_points,
    name_bare_columns,
    name_header_columns,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.survey_statement import LEFT_OUT

__all__ = ["NULLS", "Layout", "find_layout", "is_table"]

_SAMPLE_BYTES: Final = 1 << 16
_SAMPLE_ROWS: Final = 200

_AXES: Final = ("x", "y", "z")

NULLS: Final = ("", "nan", "NaN", "NAN", "null", "NULL", "-", "*", "inf", "-inf")
"""What stands where a value is missing."""


@dataclass(frozen=True, slots=True)
class _Form:
    """How a text is a table, whatever its columns mean."""

    delimiter: str
    """One character; a blank stands for any run of blanks and tabs."""
    decimal: str
    skip_lines: int
    """Lines before the first row, comments not counted."""
    header: list[str] | None
    cells: list[list[str]]
    """The first rows."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a text is a table, and what its columns are called."""

    delimiter: str
    """One character; a blank stands for any run of blanks and tabs."""
    decimal: str
    skip_lines: int
    """Lines before the first row, comments not counted."""
    names: list[str]
    bare: bool
    """The file has no header, and nobody stated its columns."""


def is_table(path: Path) -> bool:
    """Whether a text begins as a table of points does."""
    try:
        form = _find_form(path)
    except (OSError, ReadError):
        return False
    if form.header is None:
        return len(form.cells[0]) >= len(_AXES)
    return set(_AXES) <= set(name_header_columns(form.header))


def find_layout(path: Path, columns: tuple[str, ...] | None = None) -> Layout:
    """Find how the text is a table, and what its columns are: as stated, by header, by rule.

    Raises
    ------
    ReadError
        When the text is no table of numbers, x, y or z is missing, or columns are degrees.
    """
    form = _find_form(path)
    if columns is not None:
        names = _name_stated(path, form, columns)
    elif form.header is not None:
        _refuse_degrees(path, form.header)
        names = name_header_columns(form.header)
        missing = [axis for axis in _AXES if axis not in names]
        if missing:
            raise ReadError(
                path,
                f"there is no column {', '.join(missing)}; the columns are {', '.join(names)}",
                "name the coordinates x, y, z (or easting, northing, height), or state all columns "
                "with --columns",
            )
    else:
        names = _name_bare(path, form)
    is_bare = columns is None and form.header is None
    return Layout(form.delimiter, form.decimal, form.skip_lines, names, is_bare)


def _find_form(path: Path) -> _Form:
    # (1) The first lines, as text.
    with path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    if b"\x00" in head:
        raise ReadError(
            path,
            "this is no text: it has zero bytes",
            "check the file's kind; terraport reads LAS, LAZ, PLY, PCD, E57 and text",
            f"byte {head.index(0):,}",
        )
    lines = head.decode("utf-8-sig", errors="replace").splitlines()
    if len(head) == _SAMPLE_BYTES:
        lines = lines[:-1]  # the last one may be cut
    # (2) Rows, and the comment above them, which may name the columns.
    above = ""
    rows: list[str] = []
    for line in lines:
        bare = line.strip()
        if not bare:
            continue
        if bare.startswith(("#", "//")):
            above = above if rows else bare
            continue
        rows.append(bare)
        if len(rows) > _SAMPLE_ROWS:
            break
    # (3) PTS: the first row may be the number of points.
    skip = 0
    if len(rows) > 1 and re.fullmatch(r"[0-9]+", rows[0]):
        skip, rows = 1, rows[1:]
    if not rows:
        raise ReadError(path, "there is not one row of numbers", "export the survey again")
    # (4) Delimiter by majority of the rows; a decimal comma only where it does not separate.
    delimiter, _ = Counter(map(_find_delimiter, rows)).most_common(1)[0]
    cells = [_split(row, delimiter) for row in rows]
    comma = delimiter != "," and any(re.search(r"\d,\d", cell) for cell in cells[-1])
    decimal = "," if comma else "."
    # (5) A header, in the first row or in the comment. A row with three numbers is a point, though
    # its name or code is text.
    header: list[str] | None = None
    if sum(_is_number(cell, decimal) for cell in cells[0]) < min(len(_AXES), len(cells[0])):
        header, skip, cells = cells[0], skip + 1, cells[1:]
    elif above:
        named = _split(above.lstrip("#/ \t"), delimiter)
        header = named if len(named) == len(cells[0]) and not _is_number(named[0], ".") else None
    if not cells or not any(_is_number(cell, decimal) for cell in cells[0]):
        raise ReadError(
            path,
            f"{rows[0][:60]!r} is not followed by rows of numbers",
            "expected one point per line: x y z, then colours or other values",
        )
    return _Form(delimiter, decimal, skip, header, cells)


def _name_stated(path: Path, form: _Form, columns: tuple[str, ...]) -> list[str]:
    """Take the names that the user states; those left out get names that nothing else has."""
    width = len(form.cells[0])
    stated = ",".join(columns)
    if width != len(columns):
        raise ReadError(
            path,
            f"its rows have {width} columns ({_first_row(form)}), and {len(columns)} are stated "
            f"({stated})",
            f"name every column; {LEFT_OUT} leaves one out",
        )
    kept = iter(name_header_columns([name for name in columns if name != LEFT_OUT]))
    names = [
        f"{LEFT_OUT}{number}" if name == LEFT_OUT else next(kept)
        for number, name in enumerate(columns, 1)
    ]
    missing = [axis for axis in _AXES if axis not in names]
    if missing:
        raise ReadError(
            path,
            f"no column {', '.join(missing)} is stated ({stated})",
            "name x, y, z (or easting, northing, height) among them",
        )
    return names


def _first_row(form: _Form) -> str:
    return " ".join(form.cells[0])[:60]


def _name_bare(path: Path, form: _Form) -> list[str]:
    cells, decimal = form.cells, form.decimal
    width = len(cells[0])
    if width < 3:
        raise ReadError(
            path,
            f"the rows have {width} columns, expected x, y, z at least",
            "export the survey with three coordinates",
        )
    numbers = [
        [float(cell.replace(decimal, ".")) if _is_number(cell, decimal) else np.nan for cell in row]
        for row in cells
        if len(row) == width
    ]
    sample = np.array(numbers, dtype=np.float64)
    named = first_column_names_points(sample)
    if named is not None:
        rest = ",".join(f"c{column}" for column in range(5, width + 1))
        example = f"{LEFT_OUT},y,x,z{',' * bool(rest)}{rest}"
        raise ReadError(
            path,
            f"the first of its {width} columns {named}, expected x, y, z ({_first_row(form)})",
            f"say what the columns are, as in --columns {example} ({LEFT_OUT} leaves one out; "
            "northing y, easting x); or --columns x,y,z,... where the first is x",
        )
    pts = path.suffix.lower() == ".pts"
    return name_bare_columns(sample, intensity_first=pts)


def _refuse_degrees(path: Path, header: list[str]) -> None:
    labels = [name.strip().strip('"').lower() for name in header]
    angles = [name for name in labels if name in DEGREES]
    if angles and not {"x", "y"} <= set(name_header_columns(header)):
        raise ReadError(
            path,
            f"the columns {', '.join(angles)} are degrees, expected metres",
            "project the survey first, for example to its UTM zone",
            "line 1",
        )


def _find_delimiter(row: str) -> str:
    for delimiter in (";", "\t"):
        if row.count(delimiter) >= 2:
            return " " if delimiter == "\t" and "," not in row else delimiter
    # A comma between every two values, or a decimal comma within blanks?
    if row.count(",") >= 2 and not re.search(r"\d[ \t]+-?\d", row):
        return ","
    return " "


def _split(row: str, delimiter: str) -> list[str]:
    return row.split() if delimiter == " " else [cell.strip() for cell in row.split(delimiter)]


def _is_number(cell: str, decimal: str) -> bool:
    if cell in NULLS:
        return True
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True
