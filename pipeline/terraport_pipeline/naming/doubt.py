"""Where what was taught is unsure: a picture of it, or places for the next strokes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from terraport_payload.types import Float32
from terraport_pipeline.errors import OptionError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.output import writing_beside
from terraport_pipeline.export.vector_file import write_shapes
from terraport_pipeline.naming.teacher import Answer, Teacher

__all__ = ["DOUBT_ENDINGS", "NextPlace", "next_places", "write_doubt"]

DOUBT_ENDINGS: Final = (".tif", ".tiff", ".geojson", ".gpkg")

_PLACES: Final = 20
"""Places for a next stroke that are named."""

_APART_CELLS: Final = 24.0
"""Squares between two of them: a stroke mends what is around it."""

_NONE: Final = -1.0


def write_doubt(
    path: Path, teacher: Teacher, answer: Answer, frame: SurveyFrame, *, force: bool
) -> int:
    """Write where a model is unsure.

    Parameters
    ----------
    path : Path
        ``.tif``: 0 (sure) to 1 (two names are equally likely) by squares, -1 without ground.
        ``.geojson`` or ``.gpkg``: points where a stroke pays most, with the two likeliest names.
    teacher : Teacher
    answer : Answer
    frame : SurveyFrame
    force : bool
        Overwrite what is there.

    Returns
    -------
    int
        Places, or squares with ground.
    """
    if path.suffix.lower() not in DOUBT_ENDINGS:
        raise OptionError(f"{path.name}: expected a name that ends with {', '.join(DOUBT_ENDINGS)}")
    with writing_beside(path, force=force) as folder:
        if path.suffix.lower().startswith(".tif"):
            return _write_picture(folder / path.name, teacher, answer, frame)
        return _write_places(folder / path.name, teacher, answer, frame)


def _doubt_image(teacher: Teacher, answer: Answer) -> Float32:
    """Doubt by squares; of two units of one the greater; -1 without ground."""
    units = teacher.units
    flat = np.full(units.rows * units.columns, _NONE, np.float32)
    np.maximum.at(flat, units.square, answer.unsure.astype(np.float32))
    return flat.reshape(units.rows, units.columns)


def _write_picture(path: Path, teacher: Teacher, answer: Answer, frame: SurveyFrame) -> int:
    import rasterio

    from terraport_pipeline.export.geotiff import raster_transform

    units = teacher.units
    image = _doubt_image(teacher, answer)
    x, z = units.corner_m
    # Rows run south with z, as those of a GeoTIFF do.
    west, north, _ = frame.to_plan(np.array([[x, 0.0, z]]))[0].tolist()
    step = units.cell_m / frame.unit_m
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=units.columns,
        height=units.rows,
        count=1,
        dtype="float32",
        nodata=_NONE,
        crs=None if frame.crs is None else frame.crs.to_wkt(),
        transform=raster_transform(frame, west, north, step),
        compress="deflate",
    ) as file:
        file.write(image, 1)
    return int((image >= 0).sum())


def _write_places(path: Path, teacher: Teacher, answer: Answer, frame: SurveyFrame) -> int:
    chosen = next_places(teacher, answer)
    plan = np.array([place.position_m for place in chosen]).reshape(-1, 2)
    places = frame.to_plan(np.insert(plan, 1, 0.0, axis=1))[:, :2]
    columns: dict[str, Any] = {
        "doubt": [round(place.doubt, 3) for place in chosen],
        "likeliest": [place.likeliest for place in chosen],
        "or": [place.other for place in chosen],
    }
    write_shapes(path, "next strokes", "Point", shapely.points(places), columns, frame)
    return len(chosen)


@dataclass(frozen=True, slots=True)
class NextPlace:
    """Where a stroke pays."""

    position_m: tuple[float, float]
    """x and z, scene frame."""
    doubt: float
    """0 sure, 1 two names equally likely."""
    likeliest: str
    other: str
    """The next likely name."""


def next_places(teacher: Teacher, answer: Answer) -> list[NextPlace]:
    """Choose where the next strokes pay most, best first; at most 20."""
    units, doubt = teacher.units, answer.unsure
    # Doubt counts by how much of it is around: one odd square is not worth a stroke.
    around = _around(teacher, doubt)
    plan = units.middles()
    apart = _APART_CELLS * units.cell_m
    chosen: list[int] = []
    for unit in np.argsort(-around, kind="stable").tolist():
        if len(chosen) == _PLACES or around[unit] <= 0.0:
            break
        if all(np.hypot(*(plan[unit] - plan[other])) >= apart for other in chosen):
            chosen.append(unit)
    rank = np.argsort(-answer.votes[chosen], axis=1, kind="stable")
    second = min(1, rank.shape[1] - 1)
    return [
        NextPlace(
            (float(plan[unit, 0]), float(plan[unit, 1])),
            float(doubt[unit]),
            answer.names[rank[row, 0]],
            answer.names[rank[row, second]],
        )
        for row, unit in enumerate(chosen)
    ]


def _around(teacher: Teacher, doubt: Any) -> Any:
    """Mean doubt of a unit and what touches it."""
    one, other = teacher.patches.pairs.T
    count = teacher.units.count
    total = doubt + np.bincount(one, doubt[other], count) + np.bincount(other, doubt[one], count)
    return total / (1.0 + np.bincount(one, minlength=count) + np.bincount(other, minlength=count))
