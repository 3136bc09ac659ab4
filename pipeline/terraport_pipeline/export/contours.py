"""Contour lines, drawn from the heights at the pixels of a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import contourpy
import numpy as np
import shapely

from terraport_payload.types import Float32, Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.dxf import new_drawing, save_drawing
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.raster_grid import PixelGrid
from terraport_pipeline.export.sampling import height_windows
from terraport_pipeline.export.selection import SelectedScene
from terraport_pipeline.export.vector_file import write_shapes
from terraport_pipeline.progress import Progress

__all__ = ["write_contours"]

_MAX_PIXELS: Final = 100_000_000
"""Heights that are held at once: 400 MB, and half as much again for what draws the lines."""

_MAX_LEVELS: Final = 10_000
"""More lines than anybody reads: a unit mixed up."""

_INDEX_EVERY: Final = 5
"""Every fifth line is an index contour."""


@dataclass(frozen=True, slots=True, eq=False)
class _Contour:
    """One line at one height."""

    height: float
    is_index: bool
    points: Float64
    """(N, 2) plan coordinates; a closed line repeats its first point at the end."""


def write_contours(
    path: Path,
    selected: SelectedScene,
    grid: PixelGrid,
    interval: float,
    progress: Progress,
) -> dict[str, Any]:
    """Write contour lines as GeoPackage, GeoJSON or DXF.

    Parameters
    ----------
    path : Path
        Ends with .gpkg, .geojson or .dxf.
    selected : SelectedScene
    grid : PixelGrid
        Whose pixels' heights they are drawn from.
    interval : float
        Between lines, in the unit of the survey's heights; lines are at its multiples.
    progress : Progress

    Returns
    -------
    dict
        What to say of it.

    Raises
    ------
    OptionError
        Too many pixels or levels, or no line at all.
    """
    frame = selected.frame
    # (1) Heights of all pixels. Lines run across windows, so they are drawn at once.
    if grid.rows * grid.columns > _MAX_PIXELS:
        raise OptionError(
            f"contours from {grid.columns} x {grid.rows} heights, expected at most "
            f"{_MAX_PIXELS:,}; take a larger --step-m or a smaller --extent"
        )
    heights: Float32 = np.empty((grid.rows, grid.columns), np.float32)
    progress.start("heights", heights.size, "pixels")
    for window, some in height_windows(selected, grid):
        heights[window.row : window.end_row, window.column : window.end_column] = some
        progress.advance(some.size)
    progress.done({})
    # (2) Lines, level by level.
    lines = _lines(heights, grid, interval, progress)
    if not lines:
        raise OptionError(
            f"no contour at a multiple of {interval:g} {frame.height_unit_name}; expected a "
            "smaller --interval, or more ground"
        )
    write = _write_dxf if path.suffix.lower() == ".dxf" else _write_shapes
    write(path, lines, frame)
    return {
        "step": f"{grid.step:.6g} {frame.unit_name}",
        "interval": f"{interval:g} {frame.height_unit_name}",
        "lines": f"{len(lines):,}",
        "heights": " to ".join(
            f"{line.height * frame.height_sign:g}" for line in (lines[0], lines[-1])
        ),
    }


def _lines(
    heights: Float32, grid: PixelGrid, interval: float, progress: Progress
) -> list[_Contour]:
    there = np.isfinite(heights)
    if min(heights.shape) < 2 or not there.any():
        return []
    first = math.ceil(float(heights[there].min()) / interval)
    last = math.floor(float(heights[there].max()) / interval)
    if last - first > _MAX_LEVELS:
        raise OptionError(
            f"{last - first + 1:,} contour levels, expected at most {_MAX_LEVELS:,}; take a larger "
            "--interval"
        )
    drawn = contourpy.contour_generator(
        x=grid.eastings(grid.whole),
        y=grid.northings(grid.whole),
        z=np.ma.masked_invalid(heights),
        name="serial",
        line_type=contourpy.LineType.Separate,
    )
    progress.start("contours", max(0, last - first + 1), "levels")
    lines = []
    for number in range(first, last + 1):
        height = number * interval
        lines += [
            _Contour(round(height, 9), number % _INDEX_EVERY == 0, np.asarray(points))
            for points in drawn.lines(height)
        ]
        progress.advance(1)
    progress.done({"lines": len(lines)})
    return lines


def _write_dxf(path: Path, lines: list[_Contour], frame: SurveyFrame) -> None:
    drawing = new_drawing(frame)
    drawing.layers.add("CONTOURS", color=8)
    drawing.layers.add("CONTOURS_INDEX", color=7)
    space = drawing.modelspace()
    for line in lines:
        layer = "CONTOURS_INDEX" if line.is_index else "CONTOURS"
        closed = bool((line.points[0] == line.points[-1]).all())
        points = frame.plan_to_survey(line.points[:-1] if closed else line.points)
        attributes = {"layer": layer, "elevation": line.height * frame.height_sign}
        space.add_lwpolyline(points.tolist(), close=closed, dxfattribs=attributes)
    save_drawing(drawing, path)


def _write_shapes(path: Path, lines: list[_Contour], frame: SurveyFrame) -> None:
    properties: dict[str, list[Any]] = {
        "height": [float(line.height * frame.height_sign) for line in lines],
        "is_index": [bool(line.is_index) for line in lines],
    }
    shapes = [shapely.LineString(line.points) for line in lines]
    write_shapes(path, "contours", "LineString", shapes, properties, frame)
