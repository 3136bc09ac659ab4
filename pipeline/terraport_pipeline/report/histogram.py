"""Histograms for the report's inline charts.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["Bar", "Histogram", "histogram"]

BARS: Final = 24
"""Narrow enough to see two humps, wide enough to touch on a phone."""

NICE: Final = (1, 2, 5, 10)
"""Steps that people read easily."""


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar of a histogram: how many values lie in [low, high)."""

    low: float
    high: float
    count: int
    share: float
    """Height relative to the tallest bar, 0..1."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Bars over round steps, with the usual summary."""

    bars: tuple[Bar, ...]
    minimum: float
    median: float
    maximum: float


def histogram(values: npt.NDArray[np.number]) -> Histogram | None:
    """Count values in round steps.

    Parameters
    ----------
    values : ndarray of shape (N,)
        Whole numbers >= 0, such as counts.

    Returns
    -------
    Histogram or None
        At most 25 bars from 0 on, the last one with its upper end included; None without values.

    Examples
    --------
    >>> shown = histogram(np.array([1, 2, 2, 48]))
    >>> [(bar.low, bar.count) for bar in shown.bars if bar.count]
    [(0.0, 1), (2.0, 2), (48.0, 1)]
    """
    if len(values) == 0:
        return None
    array = np.asarray(values).astype(np.int64)
    top = int(array.max())
    step = _nice_step(top)
    count = np.bincount(array // step)
    tallest = int(count.max())
    bars = tuple(
        Bar(float(index * step), float((index + 1) * step), int(n), int(n) / tallest)
        for index, n in enumerate(count)
    )
    return Histogram(bars, float(array.min()), float(np.median(array)), float(top))


def _nice_step(top: int) -> int:
    """Smallest of 1, 2, 5, 10, 20, ... that needs at most 24 steps to reach the top."""
    magnitude = 1
    while True:
        for nice in NICE:
            if nice * magnitude * BARS >= top:
                return nice * magnitude
        magnitude *= 10
