"""Cross-sections: where the vertical plane over a line cuts the mesh, all of it.

Unlike a line of heights, a cut shows walls, overhangs and what lies below them.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.dxf import new_drawing, save_drawing
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.pieces import read_pieces
from terraport_pipeline.export.selection import SelectedScene, choose_segments
from terraport_pipeline.extent import Extent
from terraport_pipeline.geometry.mesh.plane_section import joined_lines, vertical_cut
from terraport_pipeline.progress import Progress

__all__ = ["SectionLine", "parse_line", "write_section"]

_COLUMNS: Final = {
    "east": "easting", "west": "westing", "north": "northing", "south": "southing",
    "up": "height", "down": "depth",
}  # fmt: skip
"""Column names of coordinates, by the direction in which they increase."""

_EXAMPLE: Final = '"641150,8594650 641250,8594750"'


@dataclass(frozen=True, slots=True)
class SectionLine:
    """A line on the ground, of two or more points."""

    points: tuple[tuple[float, float], ...]
    """Easting and northing in the survey's coordinates and unit."""

    @property
    def legs(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Its straight parts."""
        return list(zip(self.points, self.points[1:], strict=False))


@dataclass(frozen=True, slots=True, eq=False)
class _CutLine:
    """One line of the cut; N points."""

    distance: Float64
    """(N,) from the line's start along it, unit of the survey."""
    coordinates: Float64
    """(N, 3) easting, northing, height in the survey's unit."""


def parse_line(text: str) -> SectionLine:
    """Read a line such as ``"641150,8594650 641250,8594750"``.

    Raises
    ------
    OptionError
        It is not two or more different points.

    Examples
    --------
    >>> parse_line("0,0 3,4").points
    ((0.0, 0.0), (3.0, 4.0))
    """
    points: list[tuple[float, float]] = []
    for word in text.split():
        try:
            east, north = (float(number) for number in word.split(","))
        except ValueError:
            east = north = math.nan
        if not (math.isfinite(east) and math.isfinite(north)):
            raise OptionError(f"line {text!r}: {word!r}, expected E,N E,N ... such as {_EXAMPLE}")
        if points and points[-1] == (east, north):
            raise OptionError(f"line {text!r}: {word!r} twice, expected points that differ")
        points.append((east, north))
    if len(points) < 2:
        raise OptionError(f"line {text!r}; expected two points or more, such as {_EXAMPLE}")
    return SectionLine(tuple(points))


def write_section(
    path: Path,
    selected: SelectedScene,
    line: SectionLine,
    progress: Progress,
) -> dict[str, Any]:
    """Write a cross-section as DXF or CSV.

    Parameters
    ----------
    path : Path
        Ends with .dxf or .csv.
    selected : SelectedScene
    line : SectionLine
    progress : Progress
        A step of segments.

    Returns
    -------
    dict
        What to say of it.

    Raises
    ------
    OptionError
        The line meets no surface.
    """
    frame = selected.frame
    line = SectionLine(_pairs(frame.survey_to_plan(np.array(line.points))))
    lines = _cut(selected, line, progress)
    if not lines:
        raise OptionError(
            "the line meets no surface; expected one across the scene, in the coordinates and the "
            "unit of its survey (terraport inspect SCENE)"
        )
    if path.suffix.lower() == ".csv":
        _write_csv(path, lines, frame)
    else:
        _write_dxf(path, lines, line, frame)
    levels = np.concatenate([one.coordinates[:, 2] for one in lines]) * frame.height_sign
    low, high = float(levels.min()), float(levels.max())
    length = sum(math.dist(a, b) for a, b in line.legs)
    return {
        "length": f"{length:,.2f} {frame.unit_name}",
        "lines": len(lines),
        "heights": f"{low:.2f} to {high:.2f} {frame.height_unit_name}",
    }


def _cut(selected: SelectedScene, line: SectionLine, progress: Progress) -> list[_CutLine]:
    """Cut the scene leg by leg; memory is that of the cut and of one segment."""
    frame = selected.frame
    lines: list[_CutLine] = []
    passed = 0.0
    for start, end in line.legs:
        box = _box_of(start, end)
        segments = choose_segments(selected, box)
        progress.start("section", len(segments), "segments")
        x, z = frame.ground(np.array([start[0], end[0]]), np.array([start[1], end[1]]))
        ground_start, ground_end = (float(x[0]), float(z[0])), (float(x[1]), float(z[1]))
        cuts = []
        for piece in read_pieces(selected, segments):
            cuts.append(vertical_cut(piece.positions, piece.faces, ground_start, ground_end))
            progress.advance(1)
        joined = joined_lines(np.concatenate(cuts)) if cuts else []
        progress.done({"lines": len(joined)})
        length = math.dist(start, end)
        along = (np.array(end) - start) / length
        for one in joined:
            distance = one[:, 0] / frame.unit_m
            ground = np.array(start) + distance[:, None] * along
            heights = frame.heights(one[:, 1])
            lines.append(_CutLine(passed + distance, np.column_stack([ground, heights])))
        passed += length
    return lines


def _box_of(start: tuple[float, float], end: tuple[float, float]) -> Extent:
    """Return the ground that a leg may touch, at least a hair wide."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    return Extent(
        float(low[0]),
        float(low[1]),
        max(float(high[0]), float(np.nextafter(low[0], np.inf))),
        max(float(high[1]), float(np.nextafter(low[1], np.inf))),
    )


def _pairs(points: Float64) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in points)


def _write_csv(path: Path, lines: list[_CutLine], frame: SurveyFrame) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["line", "distance", *(_COLUMNS[axis] for axis in frame.units.axes)])
        for number, one in enumerate(lines, 1):
            rows = frame.plan_to_survey(one.coordinates)
            for distance, row in zip(one.distance, rows, strict=True):
                texts = (f"{value:.{frame.decimals}f}" for value in (distance, *row))
                writer.writerow([number, *texts])


def _write_dxf(path: Path, lines: list[_CutLine], line: SectionLine, frame: SurveyFrame) -> None:
    """Write the cut where it is, and as a profile beside it on a layer that is off."""
    drawing = new_drawing(frame)
    drawing.layers.add("SECTION", color=7)
    drawing.layers.add("SECTION_LINE", color=1)
    drawing.layers.add("PROFILE", color=7).off()
    space = drawing.modelspace()
    points = _pairs(frame.plan_to_survey(np.array(line.points)))
    space.add_lwpolyline(points, dxfattribs={"layer": "SECTION_LINE"})
    for one in lines:
        coordinates = frame.plan_to_survey(one.coordinates).tolist()
        space.add_polyline3d(coordinates, dxfattribs={"layer": "SECTION"})
        profile = np.column_stack([one.distance, one.coordinates[:, 2]])
        space.add_lwpolyline(profile.tolist(), dxfattribs={"layer": "PROFILE"})
    save_drawing(drawing, path)
