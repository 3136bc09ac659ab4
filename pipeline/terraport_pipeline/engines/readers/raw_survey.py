"""What every reader yields, and the rules for it: colour names and depth, precision, thinning.

PURE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int64, UInt8

__all__ = [
    "StreamChunk",
    "apply_depth",
    "choose_depth",
    "find_colours",
    "tell_precision",
    "thinning_rows",
]

Depth = Literal["unit", "eight", "sixteen"]
"""How colour values become 0..255: from 0..1, from 0..255, or from 0..65,535."""

_COLOUR_NAMES: Final = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
"""Field names that mean colour, compared in lower case."""

_WORST_STEP_M: Final = 0.001
"""Coordinates stored in coarser steps than this are worth a warning."""

_MAX_EIGHT_BIT: Final = 255


@dataclass(frozen=True, slots=True, eq=False)
class StreamChunk:
    """Some points of a survey that is read in parts."""

    points: Float64
    """(n, 3) in the file's unit and axis order east, north, up; n may be 0."""
    columns: dict[str, AnyArray]
    """Everything else by name, colours too, (n,) or (n, k), in the file's dtype."""
    read: int
    """What this part adds to the progress: points of the file, or bytes of a text."""


def thinning_rows(count: int, max_points: int | None) -> Int64 | None:
    """Choose which of `count` points to keep.

    The points are cut into `max_points` runs of (nearly) equal length, and one point of each run is
    taken by a fixed random stream: evenly spread like every n-th point, but without the stripes
    that a regular step makes in scan lines. The same numbers give the same choice.

    Parameters
    ----------
    count : int
        Points in the file.
    max_points : int or None
        Points to keep at most, >= 1; None keeps all.

    Returns
    -------
    ndarray of shape (max_points,), int64, or None
        Ascending, without repetition; None when all are kept.

    Examples
    --------
    >>> rows = thinning_rows(1000, 4)
    >>> [int(row) // 250 for row in rows]
    [0, 1, 2, 3]
    """
    if max_points is None or count <= max_points:
        return None
    edges = np.arange(max_points + 1, dtype=np.int64) * count // max_points
    draw = np.random.default_rng(0).random(max_points)
    rows: Int64 = edges[:-1] + (draw * np.diff(edges)).astype(np.int64)
    return rows


def choose_depth(
    low: float, high: float, dtype: np.dtype[Any], *, where: str
) -> tuple[Depth | None, tuple[str, ...]]:
    """Choose by a survey's lowest and highest colour value how its colours become 0..255.

    The rules: floats within 0..1 are scaled by 255; whole numbers within 0..255 are taken as they
    are; larger ones up to 65,535 lose their low byte (which is right both for files that multiply
    by 256 and for those that multiply by 257); black everywhere means "no colour"; anything else
    is no colour either.

    Parameters
    ----------
    low, high : float
        Of all finite values.
    dtype : numpy.dtype
        That the file has them in.
    where : str
        Names the fields in warnings, for example ``"red, green, blue"``.

    Returns
    -------
    rule : {"unit", "eight", "sixteen"} or None
        For :func:`apply_depth`; None when they are no colours.
    warnings : tuple of str
    """
    if low < 0.0 or high > np.iinfo(np.uint16).max:
        warning = f"The fields {where} hold values from {low:g} to {high:g}, which are no colours."
        return None, (warning,)
    if high == 0.0:
        return None, (f"The fields {where} are 0 in every point.",)
    if dtype.kind == "f" and high <= 1.0:
        return "unit", ()
    return ("eight" if high <= _MAX_EIGHT_BIT else "sixteen"), ()


def apply_depth(colours: AnyArray, rule: Depth) -> UInt8:
    """Bring finite colours to 0..255 by the rule that the whole survey asks for."""
    if rule == "unit":
        unit: UInt8 = np.rint(colours * _MAX_EIGHT_BIT).astype(np.uint8)
        return unit
    if rule == "eight":
        return colours.astype(np.uint8)
    return (colours.astype(np.uint16) >> 8).astype(np.uint8)


def tell_precision(single: Bool, top: Float64) -> tuple[str, ...]:
    """Warn where coordinates went through 32-bit floats that are too coarse for them.

    Parameters
    ----------
    single : ndarray of shape (3,), bool
        Every value of the axis, as stored, is a 32-bit float.
    top : ndarray of shape (3,), float64
        Largest absolute value of each axis.

    Returns
    -------
    tuple of str
        One sentence, or nothing. An axis counts when its largest value's neighbour among 32-bit
        floats is more than 1 mm away.
    """
    steps = np.where(single, np.spacing(top.astype(np.float32)), 0.0).astype(np.float64)
    axis = int(steps.argmax())
    if steps[axis] <= _WORST_STEP_M:
        return ()
    warning = (
        f"Coordinates near {top[axis]:,.0f} m were stored as 32-bit floats: they move in steps of "
        f"{steps[axis]:g} m, and detail below that is lost. Export the survey with 64-bit "
        "coordinates or with a local offset."
    )
    return (warning,)


def find_colours(names: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the three names, as spelt in `names`, that hold red, green and blue."""
    lower = {name.lower(): name for name in reversed(names)}
    for triple in _COLOUR_NAMES:
        if all(name in lower for name in triple):
            return lower[triple[0]], lower[triple[1]], lower[triple[2]]
    return None
