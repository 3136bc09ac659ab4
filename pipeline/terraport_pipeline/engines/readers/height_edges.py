"""Lowest and highest heights of a survey, with their numbers of points.

PURE.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from terraport_payload.types import Float64

__all__ = ["MAX_HEIGHT", "HeightEdges"]

MAX_HEIGHT: Final = 1e7
"""Heights of at least this mean "no data" (float extremes): Everest is 8.8e6 millimetres high."""

_VALUES: Final = 4
"""Distinct heights kept at each end: surveys use one or two values for "no data"."""


@dataclass(slots=True)
class HeightEdges:
    """Distinct heights at both ends of a survey, each with its number of points."""

    lowest: dict[float, int] = field(default_factory=dict)
    """Number of points by height, ascending."""
    highest: dict[float, int] = field(default_factory=dict)
    """Number of points by height, descending."""

    def look(self, heights: Float64) -> None:
        """Update with the heights of more points."""
        self.lowest = _merged(self.lowest, _ends(heights, descending=False), descending=False)
        self.highest = _merged(self.highest, _ends(heights, descending=True), descending=True)

    def count(self, heights: Iterable[float]) -> int:
        """Count the points that have one of the given heights at the ends."""
        ends = {**self.highest, **self.lowest}
        return sum(ends.get(height, 0) for height in heights)

    @classmethod
    def joined(cls, every: Iterable[HeightEdges]) -> HeightEdges:
        """Merge the heights of several files."""
        edges = cls()
        for other in every:
            edges.lowest = _merged(edges.lowest, other.lowest, descending=False)
            edges.highest = _merged(edges.highest, other.highest, descending=True)
        return edges


def _ends(heights: Float64, *, descending: bool) -> dict[float, int]:
    counts: dict[float, int] = {}
    while len(heights) and len(counts) < _VALUES:
        end = heights.max() if descending else heights.min()
        others = heights[heights != end]
        counts[float(end)] = len(heights) - len(others)
        heights = others
    return counts


def _merged(
    first: dict[float, int], second: dict[float, int], *, descending: bool
) -> dict[float, int]:
    """Add up counts. Exact: an overall extreme is among the extremes of each part that has it."""
    values = sorted({*first, *second}, reverse=descending)[:_VALUES]
    return {value: first.get(value, 0) + second.get(value, 0) for value in values}
