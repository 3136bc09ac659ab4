"""Which column of a text survey means what. PURE.

With a header, names decide (any case; see :data:`ALIASES`); other columns keep their names.

Without one, the first three columns are x (east), y (north), z (up), and of the rest:

1. three neighbouring columns, the 4th to 6th or the 5th to 7th, that hold whole numbers 0..255 in
   every sampled row and are not all equal are red, green, blue. In ``.pts`` files (intensity
   first) the 5th to 7th are tried first, elsewhere the 4th to 6th.
2. three neighbouring columns of unit vectors are ``nx``, ``ny``, ``nz``.
3. a single column, or the one before or after the colours, is ``intensity``.
4. everything else is ``column_4``, ``column_5``, ... by its place in the file, from 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from terraport_payload.types import Float64

__all__ = [
    "ALIASES",
    "DEGREES",
    "first_column_names_points",
    "name_bare_columns",
    "name_header_columns",
]

ALIASES: Final[dict[str, tuple[str, ...]]] = {
    "x": ("x", "e", "east", "easting", "coord_x", "utm_x", "x_m", "rechtswert", "este"),
    "y": ("y", "n", "north", "northing", "coord_y", "utm_y", "y_m", "hochwert", "norte"),
    "z": (
        "z", "h", "height", "elevation", "elev", "altitude", "alt", "coord_z", "z_m", "höhe",
        "hoehe", "cota", "quota",
    ),
    "red": ("red", "r"),
    "green": ("green", "g"),
    "blue": ("blue", "b"),
}  # fmt: skip
"""Column names that mean a coordinate or a colour, lower case."""

_COLOURS: Final = ("red", "green", "blue")

DEGREES: Final = ("lon", "longitude", "long", "lat", "latitude")
"""Column names that mean an angle."""

_MOST_DECIMALS: Final = 0.5
"""Share of measured coordinates that are not whole: of centimetres 0.99."""

_UNIT_TOLERANCE: Final = 0.02
"""Normals are written with three or more digits."""


def name_header_columns(header: Sequence[str]) -> list[str]:
    """Translate a header: aliases become x, y, z, red, green, blue; other names stay.

    The first column that matches wins; a later one of the same meaning keeps its own name. Colours
    are translated only where all three are there: a lone ``g`` is no green.

    Examples
    --------
    >>> name_header_columns(["Northing", "Easting", "Height", "R", "G", "B", "class"])
    ['y', 'x', 'z', 'red', 'green', 'blue', 'class']
    """
    labels = [raw.strip().strip('"').lstrip("/#").strip() for raw in header]
    lower = {label.lower() for label in labels}
    aliases = dict(ALIASES)
    if not all(lower.intersection(ALIASES[colour]) for colour in _COLOURS):
        aliases = {key: also for key, also in ALIASES.items() if key not in _COLOURS}
    names: list[str] = []
    for label in labels:
        meaning = next((key for key, also in aliases.items() if label.lower() in also), label)
        names.append(meaning if meaning and meaning not in names else label)
    return [
        name if name and name not in names[:index] else f"column_{index + 1}"
        for index, name in enumerate(names)
    ]


def name_bare_columns(sample: Float64, *, intensity_first: bool) -> list[str]:
    """Name the columns of a file without a header, by the rules above.

    Parameters
    ----------
    sample : ndarray of shape (K, C), float64
        The first rows; C >= 3.
    intensity_first : bool
        The file is a ``.pts``.

    Examples
    --------
    >>> rows = np.array([[1.5, 2.5, 3.5, 200, 180, 90], [1.6, 2.6, 3.6, 201, 181, 90]])
    >>> name_bare_columns(rows, intensity_first=False)
    ['x', 'y', 'z', 'red', 'green', 'blue']
    """
    count = sample.shape[1]
    names = ["x", "y", "z"] + [f"column_{index + 1}" for index in range(3, count)]
    starts = [4, 3] if intensity_first else [3, 4]
    colour = next((s for s in starts if s + 3 <= count and _are_colours(sample[:, s : s + 3])), -1)
    if colour >= 0:
        names[colour : colour + 3] = ["red", "green", "blue"]
    for start in range(3, count - 2):
        triple = sample[:, start : start + 3]
        if all(name.startswith("column_") for name in names[start : start + 3]) and _are_unit(
            triple
        ):
            names[start : start + 3] = ["nx", "ny", "nz"]
            break
    beside = 3 if colour != 3 else 6
    if beside < count and names[beside].startswith("column_") and (colour >= 0 or count == 4):
        names[beside] = "intensity"
    return names


def first_column_names_points(sample: Float64) -> str | None:
    """Say why the first column of a file without a header names points instead of being x.

    It does where it is no number, or where, beside coordinates with decimals, it is whole and
    rises from row to row. A raster's x also does that, but its y is the same in a whole row.

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
    counts = (first == np.rint(first)).all() and (np.diff(first) > 0).all()
    decimals = (sample[:, 1:3] != np.rint(sample[:, 1:3])).mean(axis=0)
    return "counts the points" if counts and decimals.min() >= _MOST_DECIMALS else None


def _are_colours(triple: Float64) -> bool:
    whole = np.isfinite(triple).all() and (triple == np.rint(triple)).all()
    return bool(
        whole
        and triple.min() >= 0
        and triple.max() <= np.iinfo(np.uint8).max
        and np.ptp(triple) > 0
    )


def _are_unit(triple: Float64) -> bool:
    if not np.isfinite(triple).all():
        return False
    return bool((np.abs(np.linalg.norm(triple, axis=1) - 1.0) < _UNIT_TOLERANCE).all())
