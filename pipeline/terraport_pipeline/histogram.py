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

NICE: Final = (1.0, 2.0, 2.5, 5.0, 10.0)
"""Steps that people read easily."""


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar: values in [low, high)."""

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
        Finite, >= 0.

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
    array = np.asarray(values, dtype=np.float64)
    top = float(array.max())
    step = _nice_step(top / BARS) if top > 0 else 1.0
    place = np.floor_divide(array, step).astype(np.int64)
    count = np.bincount(place)
    tallest = int(count.max())
    bars = tuple(
        Bar(index * step, (index + 1) * step, int(n), int(n) / tallest)
        for index, n in enumerate(count)
    )
    return Histogram(bars, float(array.min()), float(np.median(array)), top)


def _nice_step(least: float) -> float:
    magnitude = 10.0 ** np.floor(np.log10(least))
    return float(next(nice * magnitude for nice in NICE if nice * magnitude >= least * (1 - 1e-9)))
