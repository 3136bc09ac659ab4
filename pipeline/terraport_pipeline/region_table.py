"""The table of regions that a user fills with labels: written from a scene's facts, read back.

CSV as spreadsheets write it: UTF-8 with or without byte order mark; comma, semicolon or tab. Two
columns count when it is read, ``stable_id`` and ``label``; all others are there so that a person
knows which region is which.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import LabelFileError
from terraport_store import RegionNames, label_fault

__all__ = ["MAX_LABEL_FILE_BYTES", "read_label_changes", "region_rows", "region_table_text"]

MAX_LABEL_FILE_BYTES: Final = 64 << 20
"""Largest file of labels that is read: 65,535 rows with every fact have 10 MB."""

_DELIMITERS: Final = ",;\t"
"""What spreadsheets write, by the country they are set to."""

_EXPORT: Final = "terraport label SCENE --export FILE writes a table that fits"


def region_rows(
    names: RegionNames, document: Mapping[str, Any], origin: Sequence[float]
) -> list[dict[str, Any]]:
    """Tabulate a scene's regions, largest area first.

    Parameters
    ----------
    names : RegionNames
        Stable ids and labels.
    document : mapping
        Contents of regions.json.
    origin : sequence of 3 floats
        E0, N0, H0 of the scene.

    Returns
    -------
    list of dict
        One row per region with ``stable_id`` (None if regions have none), ``label`` ("" for
        none), ``region``, and the following, None if missing in the file: ``plan_area_m2``,
        ``surface_area_m2``, ``above_toe_m3``, ``below_toe_m3``, ``toe_uncertainty_m3``,
        ``objects_m3``, ``overhang_m3``, ``faces``,
        ``east_m``, ``north_m``, ``height_m`` (of the centre, in the survey's coordinates),
        ``lowest_m``, ``highest_m``, ``mean_colour`` (``#rrggbb``), ``slope_deg``, ``roughness_m``.
        A scene that was built over another also has ``cut_m3``, ``fill_m3`` and
        ``change_uncertainty_m3``; a scene with trained classes ``class`` and ``confidence``.
        Regions of equal area are ordered by number.
    """
    rows = []
    was_renewed = isinstance(document.get("change"), Mapping)
    was_taught = any(
        isinstance(facts, Mapping) and "class" in facts for facts in document.get("regions", [])
    )
    for region, facts in enumerate(document.get("regions", [])):
        values: Mapping[str, Any] = facts if isinstance(facts, Mapping) else {}
        x, y, z = _numbers(values.get("centroid"))
        height, slope = values.get("height_m"), values.get("slope_deg")
        span: Mapping[str, Any] = height if isinstance(height, Mapping) else {}
        steep: Mapping[str, Any] = slope if isinstance(slope, Mapping) else {}
        rows.append(
            {
                "stable_id": names.stable_id(region),
                "label": names.label(region) or "",
                "region": region,
                "plan_area_m2": _number(values.get("plan_area_m2")),
                "surface_area_m2": _number(values.get("area_m2")),
                **_toe_volumes(values.get("volume")),
                "faces": _number(values.get("faces")),
                "east_m": _sum(origin[0], x, 1),
                "north_m": _sum(origin[1], z, -1),
                "height_m": _sum(origin[2], y, 1),
                "lowest_m": _sum(origin[2], _number(span.get("min")), 1),
                "highest_m": _sum(origin[2], _number(span.get("max")), 1),
                "mean_colour": _css(values.get("mean_colour")),
                "slope_deg": _number(steep.get("mean")),
                "roughness_m": _number(values.get("roughness_m")),
                **(_change_volumes(values.get("change")) if was_renewed else {}),
                **(
                    {
                        "class": _word(values.get("class")),
                        "confidence": _number(values.get("confidence")),
                    }
                    if was_taught
                    else {}
                ),
            }
        )
    rows.sort(key=lambda row: (-(_number(row["surface_area_m2"]) or 0.0), row["region"]))
    return rows


def region_table_text(rows: list[dict[str, Any]]) -> str:
    """Write rows of :func:`region_rows` as CSV; same rows, same text."""
    out = io.StringIO()
    columns = list(rows[0]) if rows else ["stable_id", "label"]
    writer = csv.DictWriter(out, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: "" if value is None else value for key, value in row.items()})
    return out.getvalue()


def read_label_changes(path: Path, names: RegionNames) -> dict[int, str | None]:
    """Read a table of labels.

    Parameters
    ----------
    path : Path
        CSV with the columns ``stable_id`` and ``label``, in any order, among any others.
    names : RegionNames
        Of the published version, with the users' labels.

    Returns
    -------
    dict of int to str or None
        What :func:`terraport_store.change_labels` takes. An empty label takes a label away; blanks
        around a label are left out. A row that repeats the label which the build itself gave is no
        change.

    Raises
    ------
    LabelFileError
        With the line: not UTF-8 or not CSV, a column missing, a number that is none or no region's,
        a number twice, a label that is too long or holds control characters.
    OSError
        The file cannot be read.
    """
    numbers = [] if names.stable_ids is None else names.stable_ids.tolist()
    region_of_id = {number: region for region, number in enumerate(numbers)}
    changes: dict[int, str | None] = {}
    first_line: dict[int, int] = {}
    for line, number_text, label in _rows(path):
        number = _stable_id(path, line, number_text, region_of_id)
        if number in changes:
            raise LabelFileError(
                path,
                line,
                f"stable id {number} a second time (first in line {first_line[number]})",
                "name every region once",
            )
        first_line[number] = line
        text = label.strip()
        fault = label_fault(text) if text else None
        if fault is not None:
            raise LabelFileError(path, line, fault, "shorten or retype it")
        given = (
            text and number not in names.labels and text == names.given.get(region_of_id[number])
        )
        if not given:
            changes[number] = text or None
    return changes


def _rows(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield (line, stable id, label) of every row that is not blank."""
    text = _text(path)
    first = text.partition("\n")[0]
    delimiter = max(_DELIMITERS, key=first.count)  # of equals the first
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    columns: tuple[int, int] | None = None
    width = 0
    try:
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if columns is None:
                columns, width = _columns(path, reader.line_num, row), len(row)
                continue
            if len(row) != width:
                raise LabelFileError(
                    path,
                    reader.line_num,
                    f"{len(row)} columns, expected {width} as in the first line",
                    "put a label with a comma in quotes",
                )
            yield reader.line_num, row[columns[0]], row[columns[1]]
    except csv.Error as error:
        raise LabelFileError(
            path, reader.line_num, f"no CSV ({error})", "close every quote, and quote every comma"
        ) from None
    if columns is None:
        raise LabelFileError(path, 1, "nothing in it, expected a header and rows", _EXPORT)


def _columns(path: Path, line: int, header: list[str]) -> tuple[int, int]:
    """Find the columns of stable id and label in a table's header."""
    names = [cell.strip().lower() for cell in header]
    for wanted in ("stable_id", "label"):
        if names.count(wanted) != 1:
            listed = ", ".join(repr(name) for name in names[:8])
            raise LabelFileError(
                path, line, f"columns {listed}, expected {wanted!r} among them once", _EXPORT
            )
    return names.index("stable_id"), names.index("label")


def _stable_id(path: Path, line: int, text: str, region_of_id: Mapping[int, int]) -> int:
    number = int(text) if re.fullmatch(r"\s*[0-9]{1,10}\s*", text, re.ASCII) else None
    if number is None or number not in region_of_id:
        last = max(region_of_id, default=0)
        raise LabelFileError(
            path,
            line,
            f"stable id {text.strip()!r}, expected one of the scene's {len(region_of_id)} "
            f"({min(region_of_id, default=0)} to {last})",
            _EXPORT,
        )
    return number


def _text(path: Path) -> str:
    with path.open("rb") as file:
        data = file.read(MAX_LABEL_FILE_BYTES + 1)
    if len(data) > MAX_LABEL_FILE_BYTES:
        raise LabelFileError(
            path, 1, f"more than {MAX_LABEL_FILE_BYTES} bytes, expected fewer", _EXPORT
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise LabelFileError(
            path,
            line,
            f"byte 0x{data[error.start]:02x} is not UTF-8",
            'save the table as "CSV UTF-8"',
        ) from None


def _toe_volumes(volume: object) -> dict[str, float | None]:
    """Return the volumes of a region at its toe; None if it has none."""
    values: Mapping[str, Any] = volume if isinstance(volume, Mapping) else {}
    return {
        "above_toe_m3": _number(values.get("above_m3")),
        "below_toe_m3": _number(values.get("below_m3")),
        "toe_uncertainty_m3": _number(values.get("uncertainty_m3")),
        "objects_m3": _number(values.get("objects_m3")),
        "overhang_m3": _number(values.get("overhang_m3")),
    }


def _change_volumes(change: object) -> dict[str, float | None]:
    """Return the volumes of cut and fill of a region; 0 if none of its ground moved."""
    values: Mapping[str, Any] = change if isinstance(change, Mapping) else {}
    return {
        "cut_m3": _number(values.get("cut_m3", 0.0)),
        "fill_m3": _number(values.get("fill_m3", 0.0)),
        "change_uncertainty_m3": _number(values.get("uncertainty_m3", 0.0)),
    }


def _word(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _css(colour: object) -> str | None:
    levels = _numbers(colour)
    if levels[0] is None:
        return None
    return "#" + "".join(f"{max(0, min(255, round(level or 0.0))):02x}" for level in levels)


def _numbers(value: object) -> tuple[float | None, float | None, float | None]:
    """Take three numbers, or three times None."""
    if isinstance(value, list) and len(value) == 3:
        first, second, third = (_number(one) for one in value)
        if first is not None and second is not None and third is not None:
            return first, second, third
    return None, None, None


def _number(value: object) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _sum(origin: float, value: float | None, sign: int) -> float | None:
    """Turn a coordinate of the scene into one of the survey, to the millimetre."""
    return None if value is None else round(origin + sign * value, 3)
