"""Heights and colours of a scene at the pixels of a grid, window by window.

A window holds the segments that touch it and no others; windows are cut until that is little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.from_above import SeenFromAbove
from terraport_pipeline.export.pieces import read_pieces
from terraport_pipeline.export.raster_grid import PixelGrid, Window
from terraport_pipeline.export.selection import SelectedScene, choose_segments
from terraport_pipeline.extent import Extent

__all__ = ["both_heights", "colour_windows", "height_windows"]

_MAX_WINDOW: Final = 4_000_000
"""Faces and pixels of a window together: about 1 GB with the tree that rays need."""

_BAND_RAYS: Final = 1 << 20
"""Rays at once: some 100 MB."""

COLOUR_PARTS: Final = 2
"""Colours are means of so many places along each side of a pixel: what is finer than a pixel does
not flicker."""


def height_windows(selected: SelectedScene, grid: PixelGrid) -> Iterator[tuple[Window, Float32]]:
    """Take the heights at the centres of pixels.

    Parameters
    ----------
    selected : SelectedScene
    grid : PixelGrid

    Yields
    ------
    window : Window
    heights : ndarray of shape (rows, columns), float32
        Of the highest surface, in the unit of the survey's heights; NaN where there is none.
    """
    for window in grid.windows(_weight(selected, grid), _MAX_WINDOW):
        yield window, _heights(selected, grid, window)


def both_heights(
    first: SelectedScene,
    second: SelectedScene,
    grid: PixelGrid,
    is_asked: Callable[[Extent], bool],
) -> Iterator[tuple[Window, Float32, Float32]]:
    """Take the heights of two scenes at the same pixels.

    Parameters
    ----------
    first, second : SelectedScene
        With frames in one CRS and unit.
    grid : PixelGrid
    is_asked : callable
        Whether the ground of a window is to be looked at; others are left out.

    Yields
    ------
    window : Window
    heights of first, heights of second : ndarray of shape (rows, columns), float32
        As of :func:`height_windows`.
    """
    weights = _weight(first, grid), _weight(second, grid)
    for window in grid.windows(lambda window: max(w(window) for w in weights), _MAX_WINDOW):
        if is_asked(grid.extent(window)):
            yield window, _heights(first, grid, window), _heights(second, grid, window)


def colour_windows(selected: SelectedScene, grid: PixelGrid) -> Iterator[tuple[Window, UInt8]]:
    """Take the colours of pixels; arguments as for :func:`height_windows`.

    Yields
    ------
    window : Window
    levels : ndarray of shape (4, rows, columns), uint8
        sRGB and opacity: 255 where at least half of the pixel has a surface, else all four are 0.
    """
    parts, frame = COLOUR_PARTS, selected.frame
    pixel_m = grid.step * frame.unit_m / parts
    for window in grid.windows(_weight(selected, grid), _MAX_WINDOW):
        seen = _seen(selected, grid, window, colours=True)
        levels = np.zeros((4, window.rows, window.columns), np.uint8)
        for rows in _bands(window, parts):
            band = _band(window, rows)
            x, z = _places(frame, grid, band, parts)
            colours, there = seen.colours(x, z, pixel_m)
            shape = (band.rows, parts, band.columns, parts)
            count = there.reshape(shape).sum(axis=(1, 3))
            total = (colours * there[:, None]).reshape(*shape, 3).sum(axis=(1, 3))
            opaque = 2 * count >= parts * parts
            mean = np.rint(total / np.maximum(count, 1.0)[..., None]).clip(0, 255)
            levels[:3, rows] = (
                np.where(opaque[..., None], mean, 0).astype(np.uint8).transpose(2, 0, 1)
            )
            levels[3, rows] = np.where(opaque, 255, 0)
        yield window, levels


def _heights(selected: SelectedScene, grid: PixelGrid, window: Window) -> Float32:
    seen, frame = _seen(selected, grid, window, colours=False), selected.frame
    heights = np.empty((window.rows, window.columns), np.float32)
    for rows in _bands(window, 1):
        x, z = _places(frame, grid, _band(window, rows), 1)
        heights[rows] = frame.heights(seen.heights(x, z)).reshape(-1, window.columns)
    return heights


def _seen(
    selected: SelectedScene, grid: PixelGrid, window: Window, *, colours: bool
) -> SeenFromAbove:
    segments = choose_segments(selected, grid.extent(window))
    # Faces stay whole: only places within the extent are looked at.
    return SeenFromAbove(read_pieces(selected, segments, cut=False), colours=colours)


def _weight(selected: SelectedScene, grid: PixelGrid) -> Callable[[Window], int]:
    """Give what counts the faces and pixels of a window."""
    faces = selected.scene.index.face_count.astype(np.int64)

    def weight(window: Window) -> int:
        segments = choose_segments(selected, grid.extent(window))
        return int(faces[segments].sum()) + window.rows * window.columns

    return weight


def _bands(window: Window, parts: int) -> Iterator[slice]:
    """Rows of a window in runs of few enough rays, counted from the window's first."""
    count = max(1, _BAND_RAYS // (window.columns * parts * parts))
    for first in range(0, window.rows, count):
        yield slice(first, min(first + count, window.rows))


def _band(window: Window, rows: slice) -> Window:
    return Window(window.row + rows.start, window.column, window.row + rows.stop, window.end_column)


def _places(
    frame: SurveyFrame, grid: PixelGrid, window: Window, parts: int
) -> tuple[Float64, Float64]:
    """X and z (metres, scene frame) of a window's places, row by row."""
    x, z = frame.ground(grid.eastings(window, parts), grid.northings(window, parts))
    places = np.broadcast_arrays(x[None, :], z[:, None])
    return places[0].ravel(), places[1].ravel()
