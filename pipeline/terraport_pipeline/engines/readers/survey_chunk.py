"""What every reader yields: some points of a survey; and when their coordinates are too coarse.

PURE.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64

__all__ = ["StreamChunk", "tell_precision"]

_WORST_STEP_M: Final = 0.001
"""Coordinates stored in coarser steps than this are worth a warning."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamChunk:
    """Some points of a survey that is read in parts."""

    points: Float64
    """(n, 3) in the file's unit and axis order east, north, up; n may be 0."""
    columns: dict[str, AnyArray]
    """Everything else by name, colours too, (n,) or (n, k), in the file's dtype."""
    read: int
    """What this part adds to the progress: points of the file, or bytes of a text."""
    noise: Bool | None = None
    """(n,) points that the file itself calls no part of the survey; None where it says nothing."""
    scan: int = 0
    """Number of the scan that all its points belong to; 0 if the file has no scans."""


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
