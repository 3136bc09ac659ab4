"""The pixels of an orthophoto or a height model: their size, where they are, and in which windows.

Pixel centres lie at odd multiples of half a step from the CRS's zero, whatever is exported: two
exports at one step have pixels at the same places, and go together without resampling.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.extent import Extent

__all__ = ["BLOCK", "PixelGrid", "Window", "make_grid"]

BLOCK: Final = 512
"""Side of a GeoTIFF's tiles; windows end between them."""

MAX_SIDE: Final = 1_000_000
"""Pixels along a side: a square of it has a terabyte."""

_MIN_WINDOW: Final = 64
"""Pixels along a side below which a window is not cut any more, however many faces it has."""


@dataclass(frozen=True, slots=True)
class Window:
    """Rows and columns of a grid, the last ones not included."""

    row: int
    column: int
    end_row: int
    end_column: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.end_row - self.row

    @property
    def columns(self) -> int:
        """Number of columns."""
        return self.end_column - self.column


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Square pixels along the axes of the CRS; row 0 is the northernmost."""

    west: float
    """Easting of the left edge, unit of the CRS."""
    north: float
    """Northing of the upper edge."""
    step: float
    """Side of a pixel, unit of the CRS."""
    rows: int
    columns: int

    @property
    def whole(self) -> Window:
        """All of it."""
        return Window(0, 0, self.rows, self.columns)

    def eastings(self, window: Window, parts: int = 1) -> Float64:
        """Eastings of the centres of a window's columns, each in so many equal parts."""
        index = np.arange(window.columns * parts) + 0.5
        return self.west + (window.column + index / parts) * self.step

    def northings(self, window: Window, parts: int = 1) -> Float64:
        """Northings of the centres of a window's rows, each in so many equal parts."""
        index = np.arange(window.rows * parts) + 0.5
        return self.north - (window.row + index / parts) * self.step

    def extent(self, window: Window) -> Extent:
        """Return the ground of a window."""
        return Extent(
            self.west + window.column * self.step,
            self.north - window.end_row * self.step,
            self.west + window.end_column * self.step,
            self.north - window.row * self.step,
        )

    def windows(self, weight: Callable[[Window], int], max_weight: int) -> Iterator[Window]:
        """Cut the grid into windows.

        Parameters
        ----------
        weight : callable
            What is needed at once for a window.
        max_weight : int
            Windows above it are cut in two, down to 64 pixels a side.

        Yields
        ------
        Window
            Together all of the grid, none twice; neighbours one after the other.
        """
        waiting = [self.whole]
        while waiting:
            window = waiting.pop()
            longest = max(window.rows, window.columns)
            if longest <= _MIN_WINDOW or weight(window) <= max_weight:
                yield window
                continue
            unit = BLOCK if longest > BLOCK else _MIN_WINDOW
            half = max(unit, round(longest / 2 / unit) * unit)
            if window.rows >= window.columns:
                middle = window.row + half
                first = Window(window.row, window.column, middle, window.end_column)
                second = Window(middle, window.column, window.end_row, window.end_column)
            else:
                middle = window.column + half
                first = Window(window.row, window.column, window.end_row, middle)
                second = Window(window.row, middle, window.end_row, window.end_column)
            waiting += [second, first]


def make_grid(extent: Extent, step: float) -> PixelGrid:
    """Lay pixels over the ground: all whose centres are within an extent.

    Parameters
    ----------
    extent : Extent
        Unit of the CRS.
    step : float
        Side of a pixel, the same unit.

    Raises
    ------
    OptionError
        There are too many, or none.

    Examples
    --------
    >>> grid = make_grid(Extent(10.0, 20.0, 12.0, 21.0), 0.5)
    >>> grid.west, grid.north, grid.rows, grid.columns
    (10.0, 21.0, 2, 4)
    """
    # A pixel's number counts from the CRS's zero. The slack keeps pixels whose centre is on the
    # extent's edge but for rounding.
    slack = 1e-6
    first = math.ceil(extent.xmin / step - 0.5 - slack)
    last = math.floor(extent.xmax / step - 0.5 + slack)
    bottom = math.ceil(extent.ymin / step - 0.5 - slack)
    top = math.floor(extent.ymax / step - 0.5 + slack)
    columns, rows = last - first + 1, top - bottom + 1
    if columns < 1 or rows < 1:
        raise OptionError(
            f"step {step:.6g}: no pixel of that size has its centre on the ground that is exported "
            f"({extent}); expected a smaller --step-m"
        )
    if max(columns, rows) > MAX_SIDE:
        raise OptionError(
            f"step {step:.6g}: {columns} x {rows} pixels, expected at most {MAX_SIDE} a side; take "
            "a larger --step-m or a smaller --extent"
        )
    # 6411397 * 0.1 is 641139.7000000001: the digits behind the nanometre are noise.
    return PixelGrid(round(first * step, 9), round((top + 1) * step, 9), step, rows, columns)
