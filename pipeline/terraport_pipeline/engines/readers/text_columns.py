"""Meaning of the columns of a text survey. PURE.

With a header, names decide (any case, several languages; see :data:`ALIASES`); other columns keep
their names. A single letter is used only if no column has a word with the same meaning.

Without a header, the first three columns are x (east), y (north), z (up), and of the rest:

1. three neighbouring columns of unit vectors are ``nx``, ``ny``, ``nz``.
2. three neighbouring columns that hold whole numbers 0..255, or 0..65,535 in each of them, are red,
   green, blue. In ``.pts`` files, which have intensity first, the 5th to 7th are tried first.
3. a single column, or the one before or after the colours, is ``intensity``; unless it is
   constant, has whole numbers as small as classes, or numbers above 65,535.
4. all other columns are ``column_4``, ``column_5``, ... by their position in the file, from 1.

If two readings fit (intensity 0..255 before or after the colours; numbers 0..1, or numbers as small
as classes, that may be colours or not), both are returned, and the caller asks the user.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.readers.text_units import DEGREES, split_label
from terraport_pipeline.survey_statement import LEFT_OUT

__all__ = [
    "ALIASES",
    "colour_depth",
    "degree_columns",
    "first_column_names_points",
    "header_readings",
    "name_bare_columns",
    "name_header_columns",
]

ALIASES: Final[dict[str, str]] = {
    "x": "x east easting eastings coordx xcoord xcoordinate coordinatex utmx utme utmeast "
    "utmeasting xutm pointx posx positionx rechtswert rechts ostwert ost ostkoordinate östlich "
    "est este coordenadax coordinatax",
    "y": "y north northing northings coordy ycoord ycoordinate coordinatey utmy utmn utmnorth "
    "utmnorthing yutm pointy posy positiony hochwert hoch nordwert nord nordkoordinate nördlich "
    "norte coordenaday coordinatay",
    "z": "z height heights ht hgt elevation elev altitude rl reducedlevel coordz zcoord "
    "zcoordinate coordinatez utmz zutm pointz posz positionz orthoheight ellipsoidalheight höhe "
    "hoehe geländehöhe cota quota altura elevación elevacion elevazione coordenadaz hauteur "
    "hoogte höjd",
    "red": "red diffusered colorr colourr rf rot rouge rojo rosso vermelho rood",
    "green": "green diffusegreen colorg colourg gf grün gruen vert verde groen",
    "blue": "blue diffuseblue colorb colourb bf blau bleu azul blu blauw",
}
"""Column names that mean a coordinate or a colour: lower case, only letters."""

_SHORT: Final = {"x": "e", "y": "n", "z": "h alt", "red": "r", "green": "g", "blue": "b"}
"""Names that have the meaning only if no other column has it."""

_MEANINGS: Final = {word: key for key, words in ALIASES.items() for word in words.split()}
_SHORT_MEANINGS: Final = {word: key for key, words in _SHORT.items() for word in words.split()}

_DOWNWARDS: Final = re.compile(r"depth|down|tiefe|profond|profund", re.IGNORECASE)
"""Names of columns whose values increase downwards, which are not heights."""

_AXES: Final = ("x", "y", "z")
_COLOURS: Final = ("red", "green", "blue")

_ANGLES: Final = ("lon", "longitude", "long", "lat", "latitude")
"""Column names that mean an angle."""

_MOST_DECIMALS: Final = 0.5
"""Share of measured coordinates that are not whole: of centimetres 0.99."""

_UNIT_TOLERANCE: Final = 0.02
"""Normals are written with three or more digits."""

_MOST_INTENSITY: Final = 65_535

_DARK: Final = 31
"""A column of whole numbers up to this may be a class or a return number as well as a colour: LAS
has 32 classes."""


def name_header_columns(header: Sequence[str]) -> list[str]:
    """Translate a header: aliases become x, y, z, red, green, blue; other names stay.

    If several columns have one meaning, the one named x, y or z is used, else the first; the others
    keep their names. Colours are translated only if all three exist: a ``g`` without ``r`` and
    ``b`` is not green.

    Examples
    --------
    >>> name_header_columns(["Northing", "Easting [m]", "Height", "R", "G", "B", "class"])
    ['y', 'x', 'z', 'red', 'green', 'blue', 'class']
    >>> name_header_columns(["N", "X", "Y", "Z"])
    ['N', 'x', 'y', 'z']
    """
    return _named(header, {key: columns[0] for key, columns in _candidates(header).items()})


def header_readings(header: Sequence[str]) -> list[list[str]]:
    """Return all readings of a header that fit equally well; only one if it is unambiguous.

    It is ambiguous if it names two complete sets of coordinates, or one coordinate twice. Columns
    that belong to the other reading are :data:`LEFT_OUT`.

    Examples
    --------
    >>> header_readings(["X", "Y", "Z", "Easting", "Northing"])
    [['x', 'y', 'z', '-', '-'], ['-', '-', 'z', 'x', 'y']]
    """
    found = _candidates(header)
    first = {key: columns[0] for key, columns in found.items()}
    names = _named(header, first)
    axes = [axis for axis in _AXES if axis in found]
    several = [axis for axis in axes if len(found[axis]) > 1]
    spelled = all(axis in first and _key(header[first[axis]]) == axis for axis in _AXES)
    if not several or (spelled and not {"x", "y"} <= set(several)):
        return [names]
    second = {key: columns[-1] for key, columns in found.items()}
    readings = []
    for reading, other in ((first, second), (second, first)):
        names = _named(header, reading)
        for axis in several:
            names[other[axis]] = LEFT_OUT
        readings.append(names)
    return readings


def degree_columns(header: Sequence[str]) -> list[str]:
    """Return the columns whose names or units indicate a position in degrees."""
    names = name_header_columns(header)
    by_unit = [
        label
        for label, name in zip(header, names, strict=True)
        if name in ("x", "y") and split_label(_bare(label))[2] == DEGREES
    ]
    if by_unit or {"x", "y"} <= set(names):
        return by_unit
    return [label for label in map(_bare, header) if _key(label) in _ANGLES]


def _candidates(header: Sequence[str]) -> dict[str, list[int]]:
    """Find the candidate columns of each meaning, the most likely first."""
    found: dict[str, list[int]] = {}
    for meanings in (_MEANINGS, _SHORT_MEANINGS):
        of_these: dict[str, list[int]] = {}
        for column, label in enumerate(header):
            # The text in brackets is more specific: "X (North)" is a northing.
            _, groups, _ = split_label(_bare(label))
            keys = [_key(group) for group in groups] + [_key(label)]
            meaning = next((meanings[key] for key in keys if key in meanings), None)
            if meaning is not None and not _DOWNWARDS.search(label):
                of_these.setdefault(meaning, []).append(column)
        is_set = {"x", "y"} <= set(of_these)  # E, N next to X, Y: coordinates as well
        for meaning, columns in of_these.items():
            if meaning not in found or (is_set and meaning in _AXES):
                found.setdefault(meaning, []).extend(columns)
    for meaning, columns in found.items():
        columns.sort(key=lambda column: _key(header[column]) != meaning)
    if not set(_COLOURS) <= set(found):
        found = {key: columns for key, columns in found.items() if key not in _COLOURS}
    return found


def _named(header: Sequence[str], meanings: dict[str, int]) -> list[str]:
    by_column = {column: key for key, column in meanings.items()}
    names = [by_column.get(column, _bare(label)) for column, label in enumerate(header)]
    used = set(by_column.values())
    for column, name in enumerate(names):
        if column not in by_column:
            if not name or name in used:
                names[column] = f"column_{column + 1}"
            used.add(names[column])
    return names


def _bare(label: str) -> str:
    return label.strip().strip("\"'").lstrip("/#").strip()


def _key(label: str) -> str:
    """Normalise a column's name to the form used in :data:`ALIASES`."""
    name, _, _ = split_label(_bare(label))
    return re.sub(r"[\W_]", "", name.lower())


def name_bare_columns(sample: Float64, *, intensity_first: bool) -> list[list[str]]:
    """Name the columns of a file without a header, by the rules above.

    Parameters
    ----------
    sample : ndarray of shape (K, C), float64
        The first rows; C >= 3.
    intensity_first : bool
        The file is a ``.pts``.

    Returns
    -------
    list of list of str
        All readings that fit; only one if it is unambiguous.

    Examples
    --------
    >>> rows = np.array([[1.5, 2.5, 3.5, 200, 180, 90], [1.6, 2.6, 3.6, 201, 181, 90]])
    >>> name_bare_columns(rows, intensity_first=False)
    [['x', 'y', 'z', 'red', 'green', 'blue']]
    """
    count = sample.shape[1]
    starts = range(3, count - 2)
    normal = next((s for s in starts if _are_unit(sample[:, s : s + 3])), None)
    taken = set() if normal is None else {normal, normal + 1, normal + 2}
    fits = {
        start: clear
        for start in starts
        if not taken & {start, start + 1, start + 2}
        and (clear := _colour_fit(sample[:, start : start + 3])) is not None
    }
    clear_fits: list[int | None] = [start for start, clear in fits.items() if clear]
    if intensity_first and 4 in fits:
        colours: list[int | None] = [4]
    else:
        colours = clear_fits or [*fits, None]
    return [_bare_names(sample, start, normal) for start in colours]


def colour_depth(highest: float) -> int:
    """Return the maximum of the smallest colour depth that a value fits.

    Examples
    --------
    >>> colour_depth(0.9), colour_depth(254.0), colour_depth(300.0)
    (1, 255, 65535)
    """
    return next(top for top in (1, 255, 65_535) if highest <= top or top == 65_535)


def _bare_names(sample: Float64, colour: int | None, normal: int | None) -> list[str]:
    count = sample.shape[1]
    names = ["x", "y", "z"] + [f"column_{index + 1}" for index in range(3, count)]
    if normal is not None:
        names[normal : normal + 3] = ["nx", "ny", "nz"]
    if colour is not None:
        names[colour : colour + 3] = ["red", "green", "blue"]
    beside = 3 if colour != 3 else 6
    single = colour is not None or count == 4
    if beside < count and names[beside].startswith("column_") and single:
        values = sample[:, beside]
        is_code = (values == np.rint(values)).all() and np.abs(values).max() <= _DARK
        is_time = np.abs(values).max() > _MOST_INTENSITY
        if not (is_code or is_time) and (np.ptp(values) > 0 or len(values) == 1):
            names[beside] = "intensity"
    return names


def first_column_names_points(sample: Float64) -> str | None:
    """Return why the first column of a file without a header is a point name and not x.

    It is a name if it is not a number, or if it is a different whole number in each row while the
    coordinates have decimals. The x of a raster may be whole, too, but repeats in each raster row.

    Parameters
    ----------
    sample : ndarray of shape (K, C), float64
        The first rows; NaN where a cell is no number.

    Examples
    --------
    >>> rows = np.array([[101, 594.25, 412.5, 12.1], [102, 593.5, 411.75, 12.2]])
    >>> first_column_names_points(rows)
    'counts the points'
    """
    first = sample[:, 0]
    if np.isnan(first).all():
        return "is text"
    if sample.shape[1] < 4 or len(sample) < 2 or not np.isfinite(sample[:, :4]).all():
        return None
    counts = (first == np.rint(first)).all() and len(np.unique(first)) == len(first)
    decimals = (sample[:, 1:3] != np.rint(sample[:, 1:3])).mean(axis=0)
    return "counts the points" if counts and decimals.min() >= _MOST_DECIMALS else None


def _colour_fit(triple: Float64) -> bool | None:
    """Return whether three columns are clearly colours; None if they cannot be."""
    if not np.isfinite(triple).all() or triple.min() < 0 or np.ptp(triple) == 0:
        return None
    highest = triple.max(axis=0)
    if not (triple == np.rint(triple)).all():
        return False if triple.max() <= 1 else None  # floats: colours or any other fractions
    top = colour_depth(float(triple.max()))
    if triple.max() > top or (top > 255 and highest.min() <= 255):
        return None
    # A channel with only its minimum and maximum next to varying ones: alpha, or an empty column.
    constant = np.ptp(triple, axis=0) == 0
    empty = constant & np.isin(highest, (0, 255, 65_535))
    return bool(highest.min() > _DARK and (constant.all() or not empty.any()))


def _are_unit(triple: Float64) -> bool:
    if not np.isfinite(triple).all():
        return False
    return bool((np.abs(np.linalg.norm(triple, axis=1) - 1.0) < _UNIT_TOLERANCE).all())
