"""Units that a text states for its columns: in brackets, after the name, or in a title. PURE.

They are not used for conversion, only compared with the unit in which the coordinates would be
read; a text that contradicts it is refused. A header that says feet is not enough for a conversion:
these may be international or US survey feet.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from terraport_payload.types import Float64
from terraport_pipeline.errors import ReadError
from terraport_pipeline.survey_statement import METRES_PER_UNIT, SurveyStatement

__all__ = ["DEGREES", "check_units", "split_label", "unit_of_line", "unit_row"]

DEGREES: Final = "degrees"

_METRES: Final = {
    **METRES_PER_UNIT, "dm": 0.1, "km": 1000.0,
    "in": 0.0254, "yd": 0.9144, "mi": 1609.344,
}  # fmt: skip

_WORDS: Final = {
    "m": "m mtr meter meters metre metres metro metros metri mètre mètres metern",
    "ft": "ft feet foot fuß fuss pied pieds pie pies piedi ift ftint intft internationalfeet "
    "internationalfoot",
    "us-ft": "usft ftus usfeet usfoot footus feetus ussurveyfeet ussurveyfoot surveyfeet sft "
    "surveyfoot ussft ussurveyft surveyft",
    "mm": "mm millimeter millimeters millimetre millimetres",
    "cm": "cm centimeter centimeters centimetre centimetres",
    "dm": "dm decimeter decimetre",
    "km": "km kilometer kilometers kilometre kilometres",
    "in": "in inch inches",
    "yd": "yd yard yards",
    "mi": "mi mile miles",
    DEGREES: "deg degree degrees grad° ° rad radian radians dd",
}
_UNITS: Final = {word: unit for unit, words in _WORDS.items() for word in words.split()}
"""Unit by its spelling, in lower case and without punctuation."""

_BRACKETS: Final = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
_GAPS: Final = re.compile(r"[\s_,./:-]+")
_FEET: Final = re.compile(
    r"\b(?:(?:u\.?s\.?|international)[\s_-]*)?(?:survey[\s_-]*)?(?:feet|foot|ft|fuß|fuss|pieds|pies)\b"
    r"|\b(?:us[\s_-]?ft|ft[\s_-]?us)\b",
    re.IGNORECASE,
)
_UNIT_LINE: Final = re.compile(
    r"\b(?:units?|einheit(?:en)?|unités?|unidad(?:es)?)\b", re.IGNORECASE
)

_SAME: Final = 1e-5
"""Relative difference below which units are equal; the two kinds of feet (2e-6) are equal, too."""


def split_label(label: str) -> tuple[str, list[str], str | None]:
    """Split a column's name into the plain name, the texts in brackets, and the unit.

    Examples
    --------
    >>> split_label("Easting [US ft]")
    ('Easting', ['US ft'], 'us-ft')
    >>> split_label("y_m")
    ('y', [], 'm')
    >>> split_label("scan_angle")
    ('scan_angle', [], None)
    """
    groups = _BRACKETS.findall(label)
    name = _BRACKETS.sub(" ", label).strip(" _,")
    unit = next((u for u in map(_unit, groups) if u is not None), None)
    if not groups:
        words = _GAPS.split(name)
        for count in (3, 2, 1):  # US survey feet, US feet, feet
            unit = _unit("".join(words[-count:])) if len(words) > count else None
            if unit is not None:
                return " ".join(words[:-count]), groups, unit
    return name, groups, unit


def unit_row(cells: Sequence[str]) -> list[str] | None:
    """Return the units of a row between header and points; None if the row has no units."""
    texts = [cell.strip("()[]{}<> ") for cell in cells]
    units = [_unit(text) for text in texts]
    if sum(unit is not None for unit in units) < 2:
        return None
    known = all(unit or text in ("", "-") for unit, text in zip(units, texts, strict=True))
    return texts if known else None


def unit_of_line(line: str) -> str | None:
    """Find the unit in a title or comment: feet anywhere, other units only after "unit".

    Examples
    --------
    >>> unit_of_line("Coordinates in US Survey Feet"), unit_of_line("Units: mm")
    ('us-ft', 'mm')
    """
    match = _FEET.search(line)
    if match:
        return _unit(match[0]) or "ft"
    if not _UNIT_LINE.search(line):
        return None
    return next((u for u in map(_unit, re.findall(r"[^\W\d_]+", line)) if u), None)


def check_units(
    path: Path,
    stated: Mapping[str, tuple[str, str]],
    factors: Float64 | None,
    statement: SurveyStatement,
) -> None:
    """Refuse a text that states another unit than the one in which its coordinates are read.

    Parameters
    ----------
    path : pathlib.Path
        Name for the error.
    stated : mapping of str to (str, str)
        For ``"x"``, ``"y"``, ``"z"``: the words of the text, and the unit that they mean.
    factors : ndarray of shape (3,), float64, or None
        Metres per unit in which each axis will be read; None if all are 1.
    statement : SurveyStatement
        The user's statements, which override the text.

    Raises
    ------
    ReadError
        Names the option that states the unit.
    """
    for axis, (words, unit) in stated.items():
        upright = axis == "z"
        overruled = statement.height_units if upright else statement.units
        factor = 1.0 if factors is None else float(factors["xyz".index(axis)])
        if overruled is not None or abs(factor / _METRES[unit] - 1.0) < _SAME:
            continue
        option = "--height-units" if upright and _units_of(stated, "xy") != {unit} else "--units"
        if unit in ("ft", "us-ft"):
            advice = (
                f"add {option} us-ft (US survey feet, 1200/3937 m) or {option} ft (international, "
                f"0.3048 m); {option} m if it is wrong"
            )
        elif unit in METRES_PER_UNIT:
            advice = f"add {option} {unit}, or state the right coordinate system with --crs EPSG:n"
        else:
            advice = "convert the coordinates to metres and export the survey again"
        raise ReadError(
            path,
            f"it states {words!r} for {axis} ({_METRES[unit]:.9g} m), but {axis} would be read in "
            f"units of {factor:.9g} m",
            advice,
        )


def _units_of(stated: Mapping[str, tuple[str, str]], axes: str) -> set[str]:
    return {stated[axis][1] for axis in axes if axis in stated}


def _unit(text: str) -> str | None:
    """Return the unit that a word means, in any common spelling."""
    return _UNITS.get(re.sub(r"[^\w°]|[\d_]", "", text.lower()))
