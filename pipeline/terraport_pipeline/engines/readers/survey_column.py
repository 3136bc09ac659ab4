"""What is known of a column of a survey while it is read in parts: its type, its range.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray

__all__ = ["SurveyColumn", "without_extremes"]

_EXTREME: Final = 1e30
"""Values of at least this mean no data: the largest float, or 1e30 itself."""

_VOID_CODES: Final = frozenset((-9999.0, -32767.0, -32768.0, -99999.0, -999999.0))
"""Minimum values of a column that usually mean no data, even if the file does not state it."""


def without_extremes(values: AnyArray) -> tuple[AnyArray, int]:
    """Replace the float extremes of a column, which mean no data, by NaN, and count them."""
    if values.dtype.kind != "f":
        return values, 0
    extreme = np.isfinite(values) & (np.abs(values) >= _EXTREME)
    count = int(extreme.sum())
    return (np.where(extreme, values.dtype.type(np.nan), values) if count else values), count


@dataclass(slots=True)
class SurveyColumn:
    """What is known of a column after all parts of a file, or of all files."""

    dtype: np.dtype[Any]
    unset: tuple[int, ...] = ()
    """Values that say nothing where every point has the same one of them."""
    narrow: bool = False
    """Whole numbers get an integer type."""
    low: float = np.inf
    high: float = -np.inf
    first: Any = None
    constant: bool = True
    whole: bool = True
    """Finite whole numbers only."""
    extremes: int = 0
    """Number of values that meant no data: float extremes."""
    voids: int = 0
    """Number of values that may mean no data, though unstated: a common code below all others."""

    def look(self, values: AnyArray) -> None:
        """Take further values into account."""
        if not len(values):
            return
        if self.first is None:
            self.first = values.flat[0]
        self.constant = self.constant and bool((values == self.first).all())
        if values.dtype.kind == "f":
            finite = values[np.isfinite(values)]
            self.whole = self.whole and len(finite) == values.size
            self.whole = self.whole and bool((finite == np.rint(finite)).all())
        else:
            finite = values
        if finite.size:
            low = float(finite.min())
            if low in _VOID_CODES:
                self.voids += int((finite == low).sum())
            self.low = min(self.low, low)
            self.high = max(self.high, float(finite.max()))

    def join(self, other: SurveyColumn) -> None:
        """Take the column of another file into account."""
        self.dtype = np.result_type(self.dtype, other.dtype)
        self.unset = tuple(value for value in self.unset if value in other.unset)
        self.narrow = self.narrow and other.narrow
        self.low, self.high = min(self.low, other.low), max(self.high, other.high)
        self.whole = self.whole and other.whole
        self.voids += other.voids
        self.extremes += other.extremes
        self.constant = self.constant and other.constant and bool(self.first == other.first)

    @property
    def says_nothing(self) -> bool:
        """Whether the format fills the column with a default, and nobody changed it."""
        return self.constant and self.first in self.unset

    @property
    def void_code(self) -> float | None:
        """Return the minimum if it is a common code for no data and not the only value."""
        return self.low if self.low in _VOID_CODES and self.low < self.high else None

    @property
    def narrowed(self) -> np.dtype[Any]:
        """Type that it is stored in."""
        if self.narrow and self.dtype.kind == "f" and self.whole and self.first is not None:
            for code in (np.uint8, np.uint16, np.int32):
                if np.iinfo(code).min <= self.low and self.high <= np.iinfo(code).max:
                    return np.dtype(code)
        return self.dtype.newbyteorder("=")
