"""Layout of a text with points: delimiter, decimal sign, header, and meaning of the columns.

Delimiter (comma, semicolon, tab or blanks), decimal comma and a header are detected from the start
of the file; columns that the user states override a header. The rows begin with the first line that
has as many values as most lines, at least three of them numbers. The line above is the header if it
names as many columns; it may be a comment (``#`` or ``//``, as CloudCompare writes it), and a row
of units may follow it. Lines above the header are titles. A line with a single whole number is a
number of points (PTS: one before each scan).
"""

from __future__ import annotations

import codecs
import csv
import re
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from terraport_pipeline.engines.readers.clean_text import text_encoding
from terraport_pipeline.engines.readers.text_columns import (
    colour_depth,
    degree_columns,
    first_column_names_points,
    header_readings,
    name_bare_columns,
    name_header_columns,
)
from terraport_pipeline.engines.readers.text_units import (
    DEGREES,
    split_label,
    unit_of_line,
    unit_row,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.survey_statement import LEFT_OUT

__all__ = ["NULLS", "Layout", "find_layout", "is_table"]

_SAMPLE_BYTES: Final = 1 << 16
_SAMPLE_ROWS: Final = 200

_AXES: Final = ("x", "y", "z")

NULLS: Final = ("", "nan", "NaN", "NAN", "null", "NULL", "-", "*", "inf", "-inf")
"""What stands where a value is missing."""


_COUNT: Final = re.compile(r"[0-9]+")

_DECIMAL_COMMA: Final = re.compile(r"^[-+]?\d+,\d+$")

_MOST_READINGS: Final = 3
"""Maximum number of readings that an error shows."""


@dataclass(frozen=True, slots=True)
class _Form:
    """How a text is a table, whatever its columns mean."""

    encoding: str
    delimiter: str
    """One character; a blank stands for any run of blanks and tabs."""
    decimal: str
    skip_lines: int
    """Lines before the first row, comments not counted."""
    header: list[str] | None
    titles: list[str]
    """Lines above the header."""
    notes: list[str]
    """Titles and comments, which may state a unit."""
    counted: int | None
    """Number of points that the line before the first row states; None without one."""
    cells: list[list[str]]
    """The first rows."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a text is a table, and what its columns are called."""

    encoding: str
    """UTF-8 (also for ASCII-compatible encodings), or UTF-16 with its byte order."""
    delimiter: str
    """One character; a blank stands for any run of blanks and tabs."""
    decimal: str
    skip_lines: int
    """Lines before the first row, comments not counted."""
    names: list[str]
    bare: bool
    """The file has no header, and nobody stated its columns."""
    counted: int | None = None
    """Number of points stated before the first row; more such lines may follow (PTS)."""
    colour_top: int | None = None
    """Maximum of the colour depth found in the first rows of a file without header."""
    units: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Units that the text states for x, y and z: its words, and the unit."""
    titles: tuple[str, ...] = ()
    """Title lines above the table."""


def is_table(path: Path) -> bool:
    """Whether a text begins as a table of points does."""
    try:
        form = _find_form(path)
    except (OSError, ReadError):
        return False
    if form.header is None:
        # Numbers below a title may also be a list of control points below their CRS.
        return len(form.cells[0]) >= len(_AXES) and not form.titles
    return set(_AXES) <= set(name_header_columns(form.header))


def find_layout(path: Path, columns: tuple[str, ...] | None = None) -> Layout:
    """Detect the layout of a text and its columns: as stated, by the header, or by rules.

    Raises
    ------
    ReadError
        When the text is no table of numbers, x, y or z is missing, columns are degrees, or two
        readings of the columns fit; the error then has the ``--columns`` of each.
    """
    form = _find_form(path)
    top = None
    if columns is not None:
        names = _name_stated(path, form, columns)
    elif form.header is not None:
        names = _name_by_header(path, form.header)
    else:
        names, top = _name_bare(path, form)
    is_bare = columns is None and form.header is None
    return Layout(
        form.encoding,
        form.delimiter,
        form.decimal,
        form.skip_lines,
        names,
        is_bare,
        form.counted,
        top,
        _units(path, form, names),
        tuple(form.titles),
    )


def _find_form(path: Path) -> _Form:
    # (1) The first lines as text, with comments separated.
    with path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    encoding = text_encoding(path, head)
    text = _decoded(head, encoding)
    if "\r" in text and "\n" not in text:
        raise ReadError(
            path,
            "its lines end with CR alone, expected LF or CR LF",
            "save it with the line ends of Unix or Windows",
        )
    found = text.split("\n")
    if len(head) == _SAMPLE_BYTES:
        found = found[:-1]  # the last line may be cut off
    every = [line for raw in found if (line := raw.strip())]
    lines = [line for line in every if not _is_comment(line)]
    # (2) Delimiter by majority of the lines; a decimal comma only where it does not separate. The
    # rows begin with the first line that is like most of those that can be rows.
    last = [line for line in lines if not _COUNT.fullmatch(line)][-_SAMPLE_ROWS:]
    if not last:
        raise ReadError(path, "there is not one row of numbers", "export the survey again")
    delimiter = _find_delimiter(last)
    split = [_split(line, delimiter) for line in lines]
    tail = [cell for cells in split[-_SAMPLE_ROWS:] for cell in cells]
    decimal = "," if any(_DECIMAL_COMMA.search(cell) for cell in tail) else "."
    can_be = [cells for cells in split if _is_row(cells, decimal)]
    if not can_be:
        raise ReadError(
            path,
            f"{lines[0][:60]!r} is not followed by rows of numbers",
            "expected one point per line: x y z, then colours or other values",
        )
    width = Counter(map(len, can_be)).most_common(1)[0][0]
    can_be = [cells for cells in can_be if len(cells) == width]
    numeric = [
        2 * sum(_is_number(row[column], decimal) for row in can_be) > len(can_be)
        for column in range(width)
    ]
    first = next(
        number
        for number, cells in enumerate(split)
        if cells in can_be
        and all(_is_number(c, decimal) for c, n in zip(cells, numeric, strict=True) if n)
    )
    rows = [cells for cells in split[first:] if len(cells) > 1][:_SAMPLE_ROWS]
    _refuse_comma_twice(path, rows, delimiter)
    # (3) Lines above the rows: titles, a header, units, the number of points.
    counts = [int(line) for line in lines[:first] if _COUNT.fullmatch(line)]
    titles = [line for line in lines[:first] if not _COUNT.fullmatch(line)]
    comments = [line for line in every[: every.index(lines[first])] if _is_comment(line)]
    header = _take_header(path, titles, rows, width, delimiter)
    if header is None and not titles:
        header = _header_in_comment(comments, width, delimiter)
    return _Form(
        encoding,
        delimiter,
        decimal,
        first,
        header,
        titles,
        [*titles, *comments],
        counts[-1] if counts else None,
        rows,
    )


def _take_header(
    path: Path, titles: list[str], rows: list[list[str]], width: int, delimiter: str
) -> list[str] | None:
    """Remove the header and the row of units from the lines above the rows, and return them."""
    if not titles:
        return None
    titles[-1] = titles[-1].lstrip("%!;* \t")  # comment signs of other programs
    units = unit_row(_split_names(titles[-1], width, delimiter) or [])
    header = _split_names(titles[-2 if units and len(titles) > 1 else -1], width, delimiter)
    if header is None:
        names = _split(titles[-1], delimiter)
        if len(names) == width - 1 and not any(row[-1] for row in rows):
            header = [*names, ""]  # each row ends with a delimiter
        elif len(set(_AXES) & set(name_header_columns(names))) > 1:
            raise ReadError(
                path,
                f"the header has {len(names)} columns ({titles[-1][:60]}), expected {width} as in "
                f"the rows ({' '.join(rows[0])[:60]})",
                "export the survey again, or state all columns with --columns",
            )
        else:
            return None
    titles.pop()
    if units and titles:
        titles.pop()
        header = [
            name if unit in ("", "-") else f"{name} [{unit}]"
            for name, unit in zip(header, units, strict=True)
        ]
    return header


def _header_in_comment(comments: list[str], width: int, delimiter: str) -> list[str] | None:
    """Find the comment that names the columns: the last comment, or one that names x, y and z."""
    for number, line in enumerate(reversed(comments)):
        names = _split_names(line.lstrip("#/ \t"), width, delimiter)
        if names is None or _is_number(names[0], "."):
            continue
        if number == 0 or set(_AXES) <= set(name_header_columns(names)):
            return names
    return None


def _split_names(line: str, width: int, delimiter: str) -> list[str] | None:
    """Split a header by the delimiter that gives as many names as the rows have columns."""
    for separator in (delimiter, ",", ";", "\t", " "):
        names = _split(line, separator)
        if len(names) == width:
            return names
    names = re.sub(r"\s+(?=[(\[{<])", "", line).split()  # a blank before a unit
    return names if len(names) == width else None


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


def _name_by_header(path: Path, header: list[str]) -> list[str]:
    angles = degree_columns(header)
    if angles:
        raise _in_degrees(path, f"the columns {', '.join(angles)} are degrees")
    readings = header_readings(header)
    missing = [axis for axis in _AXES if axis not in readings[0]]
    if missing:
        raise ReadError(
            path,
            f"there is no column {', '.join(missing)}; the columns are {', '.join(readings[0])}",
            "name the coordinates x, y, z (or easting, northing, height), or state all columns "
            "with --columns",
        )
    if len(readings) > 1:
        raise _which(path, f"its header ({', '.join(header)[:80]})", readings)
    return readings[0]


def _which(path: Path, what: str, readings: Sequence[Sequence[str]]) -> ReadError:
    """Raise the error that asks which of several readings is right."""
    lines = [
        "--columns " + shlex.quote(",".join(name.replace(",", "_") for name in reading))
        for reading in readings[:_MOST_READINGS]
    ]
    return ReadError(
        path,
        f"{what} is ambiguous: it can be read in {len(readings)} ways",
        f"add {' or '.join(lines)}",
    )


def _units(path: Path, form: _Form, names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Find the units that the text states for x, y and z, by axis: words, unit."""
    units: dict[str, tuple[str, str]] = {}
    if form.header is not None:
        for name, label in zip(names, form.header, strict=True):
            unit = split_label(label)[2]
            if name in _AXES and unit is not None:
                units[name] = (label, unit)
    if not units:
        line, unit = next(((t, u) for t in form.notes if (u := unit_of_line(t))), ("", None))
        if unit is not None:
            units = dict.fromkeys(_AXES, (line[:60], unit))
    angle = next((words for words, unit in units.values() if unit == DEGREES), None)
    if angle is not None:
        raise _in_degrees(path, f"it states {angle!r}")
    return units


def _in_degrees(path: Path, what: str) -> ReadError:
    return ReadError(
        path, f"{what}, expected metres", "project the survey first, for example to its UTM zone"
    )


def _first_row(form: _Form) -> str:
    return " ".join(form.cells[0])[:60]


def _name_bare(path: Path, form: _Form) -> tuple[list[str], int | None]:
    """Name the columns by their values, and return the maximum of the colour depth."""
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
    readings = name_bare_columns(sample, intensity_first=path.suffix.lower() == ".pts")
    if len(readings) > 1:
        raise _which(path, f"it has no header, and a row ({_first_row(form)})", readings)
    names = readings[0]
    if "red" not in names:
        return names, None
    red = names.index("red")
    return names, colour_depth(float(sample[:, red : red + 3].max()))


def _refuse_comma_twice(path: Path, rows: list[list[str]], delimiter: str) -> None:
    """Refuse commas as both delimiter and decimal sign: 12,07,3,50 has two numbers, or four."""
    cells = [cell for row in rows for cell in row]
    whole = all(re.fullmatch(r"-?\d*", cell) for cell in cells)
    if delimiter == "," and whole and any(re.match(r"-?0\d", cell) for cell in cells):
        raise ReadError(
            path,
            f"commas stand between its values and within them ({','.join(rows[0])[:60]})",
            "export it with decimal points, or with semicolons between the values",
        )


def _decoded(head: bytes, encoding: str) -> str:
    """Decode the beginning of a text as UTF-8, else as Windows-1252."""
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(head)  # the last one may be cut
    except UnicodeDecodeError:
        text = head.decode("cp1252", errors="replace")
    return text.removeprefix("\ufeff")


def _is_comment(line: str) -> bool:
    return line.startswith(("#", "//"))


def _find_delimiter(rows: list[str]) -> str:
    delimiter = Counter(map(_delimiter_of, rows)).most_common(1)[0][0]
    if delimiter != "\t":
        return delimiter
    # Single tabs, or runs of tabs and blanks? Runs would give a column without values.
    tabs = Counter(row.count("\t") for row in rows).most_common(1)[0][0]
    split = [row.split("\t") for row in rows if row.count("\t") == tabs]
    is_run = any(all(not cell.strip() for cell in column) for column in zip(*split, strict=True))
    return " " if is_run else "\t"


def _delimiter_of(row: str) -> str:
    for delimiter in (";", "\t"):
        if row.count(delimiter) >= 2:
            return delimiter
    # A comma between every two values, or a decimal comma within blanks?
    if row.count(",") >= 2 and not re.search(r"\d[ \t]+-?\d", row):
        return ","
    return " "


def _split(row: str, delimiter: str) -> list[str]:
    if '"' not in row:
        cells = row.split() if delimiter == " " else row.split(delimiter)
    else:
        if delimiter == " ":
            row = re.sub(r"[ \t]+", " ", row)
        cells = next(csv.reader([row], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def _is_row(cells: list[str], decimal: str) -> bool:
    """Return whether a line can be a point: three values are numbers, one of which may be missing.

    Names and codes may be text; in a table with fewer columns all values must be numbers.
    """
    good = [cell for cell in cells if _is_number(cell, decimal)]
    there = sum(cell not in NULLS for cell in good)
    return len(cells) > 1 and len(good) >= min(len(_AXES), len(cells)) and there >= 2


def _is_number(cell: str, decimal: str) -> bool:
    if cell in NULLS:
        return True
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True
