"""What every reader returns, and the three rules that they share: thinning, colour depth, names.

PURE.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from terraport_pipeline.model import Float64, UInt8

__all__ = [
    "COLOUR_NAMES",
    "Advance",
    "RawSurvey",
    "check_precision",
    "find_colours",
    "thinning_rows",
    "to_eight_bits",
]

Advance = Callable[[int, int], None]
"""Told (points read since last time, points in the file); a reader calls it about once a chunk."""

COLOUR_NAMES: Final = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
"""Field names that mean colour, compared in lower case."""

_WORST_STEP_M: Final = 0.001
"""Coordinates stored in coarser steps than this are worth a warning."""

_MAX_EIGHT_BIT: Final = 255


@dataclass(frozen=True, slots=True)
class RawSurvey:
    """Points as one reader found them, before anything is dropped or converted."""

    points: Float64
    """(N, 3) in the file's unit and axis order east, north, up."""
    colours: UInt8 | None
    """(N, 3) sRGB."""
    attributes: dict[str, npt.NDArray[Any]]
    """(N,) each, in the file's dtype."""
    crs: Any | None
    """pyproj.CRS as the file states it."""
    warnings: tuple[str, ...] = ()
    """Whole sentences."""


def thinning_rows(count: int, max_points: int | None) -> npt.NDArray[np.int64] | None:
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
    rows: npt.NDArray[np.int64] = edges[:-1] + (draw * np.diff(edges)).astype(np.int64)
    return rows


def to_eight_bits(colours: npt.NDArray[Any], *, where: str) -> tuple[UInt8 | None, tuple[str, ...]]:
    """Bring colours to 0..255.

    The rules: floats within 0..1 are scaled by 255; whole numbers within 0..255 are taken as they
    are; larger ones up to 65,535 lose their low byte (which is right both for files that multiply
    by 256 and for those that multiply by 257); black everywhere means "no colour"; anything else
    is no colour either.

    Parameters
    ----------
    colours : ndarray of shape (N, 3)
        Any numeric dtype; not modified.
    where : str
        Names the fields in warnings, for example ``"red, green, blue"``.

    Returns
    -------
    colours : ndarray of shape (N, 3), uint8, or None
    warnings : tuple of str
    """
    if len(colours) == 0:
        return None, ()
    finite = np.isfinite(colours).all(axis=1) if colours.dtype.kind == "f" else None
    if finite is not None and not finite.all():
        # A point without a valid colour keeps its place and turns black.
        colours = np.where(finite[:, None], colours, colours.dtype.type(0))
    low, high = float(colours.min()), float(colours.max())
    if low < 0.0 or high > np.iinfo(np.uint16).max:
        told = f"The fields {where} hold values from {low:g} to {high:g}, which are no colours."
        return None, (told,)
    if high == 0.0:
        return None, (f"The fields {where} are 0 in every point.",)
    if colours.dtype.kind == "f" and high <= 1.0:
        return np.rint(colours * _MAX_EIGHT_BIT).astype(np.uint8), ()
    if high <= _MAX_EIGHT_BIT:
        return colours.astype(np.uint8), ()
    return (colours.astype(np.uint16) >> 8).astype(np.uint8), ()


def check_precision(points: Float64) -> tuple[str, ...]:
    """Warn where coordinates went through 32-bit floats that are too coarse for them.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Finite, as stored (before any pose or offset is added).

    Returns
    -------
    tuple of str
        One sentence, or nothing. An axis counts when each of its values is a 32-bit float and the
        largest one's neighbour is more than 1 mm away.
    """
    worst, largest = 0.0, 0.0
    for axis in range(3):
        single = points[:, axis].astype(np.float32)
        if len(single) and (single == points[:, axis]).all():
            top = np.abs(single).max()
            step = float(np.spacing(top))
            if step > worst:
                worst, largest = step, float(top)
    if worst <= _WORST_STEP_M:
        return ()
    told = (
        f"Coordinates near {largest:,.0f} m were stored as 32-bit floats: they move in steps of "
        f"{worst:g} m, and detail below that is lost. Export the survey with 64-bit coordinates or "
        "with a local offset."
    )
    return (told,)


def find_colours(names: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the three names, as spelt in `names`, that hold red, green and blue."""
    lower = {name.lower(): name for name in reversed(names)}
    for triple in COLOUR_NAMES:
        if all(name in lower for name in triple):
            return lower[triple[0]], lower[triple[1]], lower[triple[2]]
    return None
