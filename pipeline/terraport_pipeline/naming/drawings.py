"""What people have drawn of a site: outlines and lines of a GIS or CAD file, in the scene's frame.

GDAL reads the files (pyogrio): GeoJSON, Shapefile, GeoPackage, DXF, and whatever else it knows.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyogrio
import pyogrio.raw
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from terraport_payload.types import Float64
from terraport_pipeline.errors import OptionError, PlanError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_store.labels import label_fault

__all__ = ["MAX_CORNERS", "MAX_FEATURES", "Drawing", "Drawings", "read_drawings"]

MAX_FEATURES: Final = 65_535
"""Features of a file: as many as a scene can have regions."""

MAX_CORNERS: Final = 20_000_000
"""Corners of all of them: 320 MB."""

_NAME_FIELDS: Final = ("name", "label", "layer")
"""Where a name is looked for, in this order, whatever the case."""

_WIDTH_FIELD: Final = "width_m"

_LISTED: Final = 8

_DEGREES: Final = (180.0, 90.0)

_FARTHEST_M: Final = 1e8
"""Farther from the scene's origin nothing of the Earth is, however wrong its CRS."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """One feature of a file."""

    number: int
    """In the file, from 1."""
    name: str | None
    shape: Any
    """shapely geometry in x and z of the scene, metres: outlines are polygons; lines stay lines."""
    width_m: float | None = None
    """Of a line or point, where its property ``width_m`` says one."""


@dataclass(frozen=True, slots=True)
class Drawings:
    """Features of a file that can be used, and what was left out."""

    path: Path
    drawings: tuple[Drawing, ...]
    name_field: str | None
    """Where names came from; None where no such field is there."""
    skipped: tuple[str, ...]
    """What was left out and why: sentences."""


def read_drawings(
    path: Path,
    frame: SurveyFrame,
    *,
    crs: str | None = None,
    layer: str | None = None,
    name_field: str | None = None,
    points: bool = False,
) -> Drawings:
    """Read a file and bring it into the scene's frame.

    Parameters
    ----------
    path : Path
    frame : SurveyFrame
        Coordinates of the scene's survey.
    crs : str, optional
        What the file's coordinates are in, where it says nothing or something wrong: anything that
        PROJ reads (``EPSG:32614``).
    layer : str, optional
        Of a file with several.
    name_field : str, optional
        The property that names a feature; None: the first of name, label, layer that is there.
    points : bool
        Keep points too.

    Returns
    -------
    Drawings
        Polygons made valid; closed lines are outlines. Heights are left out. Where the scene has no
        CRS the coordinates are taken as they are.

    Raises
    ------
    PlanError
        The file cannot be read, has no such layer or field, states no CRS where the scene has one,
        or holds more than the limits.
    """
    # (1) The file as GDAL reads it.
    chosen = _layer(path, layer)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Non closed ring")  # closed below
            meta, _, geometry, columns = pyogrio.raw.read(
                path, layer=chosen, force_2d=True, max_features=MAX_FEATURES + 1
            )
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, ValueError) as error:
        raise PlanError(path, f"GDAL cannot read it ({error})", "save it anew as GeoJSON") from None
    if geometry is None or len(geometry) == 0:
        raise PlanError(path, "no feature in it, expected outlines", "choose another layer or file")
    if len(geometry) > MAX_FEATURES:
        raise PlanError(path, f"more than {MAX_FEATURES:,} features", "leave out what is smallest")
    # Rings that do not close, as hand-written GeoJSON has them, are closed; what is beyond that
    # (two corners) counts as without geometry.
    shapes = shapely.from_wkb(geometry, on_invalid="fix")
    if shapely.get_num_coordinates(shapes).sum() > MAX_CORNERS:
        raise PlanError(
            path, f"more than {MAX_CORNERS:,} corners", "simplify the outlines, or split the file"
        )
    # (2) Names.
    fields = [str(field) for field in meta["fields"]]
    field = _name_field(path, fields, name_field)
    values = None if field is None else columns[fields.index(field)]
    widths = columns[fields.index(_WIDTH_FIELD)] if _WIDTH_FIELD in fields else None
    # (3) Into the scene's frame.
    stated = _crs(path, meta.get("crs"), crs, frame, shapes)
    convert = _conversion(path, stated, frame)
    drawings, empty, left = [], 0, 0
    for number, shape in enumerate(shapes, 1):
        if shape is None or shape.is_empty:
            empty += 1
            continue
        in_scene = shapely.transform(shape, convert)
        if not np.abs(shapely.get_coordinates(in_scene)).max() <= _FARTHEST_M:
            raise PlanError(
                path,
                f"feature {number} has a corner that is no number, or more than "
                f"{_FARTHEST_M:,.0f} m from the scene",
                "take it out, or check --crs",
            )
        moved = in_scene if points and _is_points(shape) else _outlined(in_scene)
        if moved is None:
            left += 1
            continue
        text = None if values is None else _name(path, number, values[number - 1])
        width_m = None if widths is None else _width(widths[number - 1])
        drawings.append(Drawing(number, text, moved, width_m))
    skipped = []
    if empty:
        skipped.append(f"{empty} features without geometry")
    if left:
        skipped.append(f"{left} points and texts")
    if not drawings:
        raise PlanError(
            path, f"{left} points and no outline, expected polygons", "choose another layer"
        )
    return Drawings(path, tuple(drawings), field, tuple(skipped))


def _layer(path: Path, wanted: str | None) -> str:
    if not path.exists():
        raise PlanError(path, "no such file", "check the name")
    try:
        layers = [str(name) for name, _ in pyogrio.list_layers(path)]
    except pyogrio.errors.DataSourceError as error:
        what = str(error).splitlines()[0]
        raise PlanError(
            path,
            f"GDAL cannot read it ({what})",
            "expected GeoJSON, Shapefile, GeoPackage or DXF; of a Shapefile .shx and .dbf "
            "belong beside it",
        ) from None
    if wanted is None and len(layers) == 1:
        return layers[0]
    listed = ", ".join(repr(name) for name in layers[:_LISTED])
    if wanted is None:
        raise PlanError(path, f"layers {listed}", "choose one with --layer")
    if wanted not in layers:
        raise PlanError(path, f"layers {listed}, expected {wanted!r} among them", "see --layer")
    return wanted


def _name_field(path: Path, fields: Sequence[str], wanted: str | None) -> str | None:
    lower = [field.lower() for field in fields]
    if wanted is not None:
        if wanted.lower() in lower:
            return fields[lower.index(wanted.lower())]
        listed = ", ".join(repr(field) for field in fields[:_LISTED]) or "none"
        raise PlanError(
            path, f"properties {listed}, expected {wanted!r} among them", "see --name-field"
        )
    return next((fields[lower.index(name)] for name in _NAME_FIELDS if name in lower), None)


def _name(path: Path, number: int, value: object) -> str | None:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return None
    text = _text(value).strip()
    if not text:
        return None
    fault = label_fault(text)
    if fault is not None:
        raise PlanError(path, f"feature {number}: {fault}", "shorten or retype it")
    return text


def _text(value: object) -> str:
    """Name as people read it: 8 of a column of numbers that are 8.0, and lists by commas."""
    if isinstance(value, float | np.floating):
        return f"{value:.15g}"
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(_text(one) for one in value)
    return str(value)


def _width(value: object) -> float | None:
    """Width of a stroke; None where it says none that can be."""
    if not isinstance(value, float | int | np.number):
        return None
    width_m = float(value)
    return width_m if np.isfinite(width_m) and width_m > 0 else None


def _crs(
    path: Path, in_file: str | None, asked: str | None, frame: SurveyFrame, shapes: Any
) -> CRS | None:
    """Decide what the file's coordinates are in; None where the scene has no CRS either."""
    if asked is not None:
        try:
            return CRS.from_user_input(asked)
        except CRSError as error:
            raise OptionError(f"--crs {asked}: {error}; expected one like EPSG:32614") from None
    if frame.crs is None:
        return None
    if not in_file:
        raise PlanError(
            path,
            "it does not say which coordinate reference system it is in",
            f"add --crs EPSG:...; the scene is in {frame.crs.name}",
        )
    stated = CRS.from_user_input(in_file)
    if stated.is_geographic:
        low_x, low_y, high_x, high_y = shapely.total_bounds(shapes).tolist()
        across, along = max(-low_x, high_x), max(-low_y, high_y)
        if across > _DEGREES[0] * 2 or along > _DEGREES[1]:
            raise PlanError(
                path,
                f"coordinates up to {across:,.1f}, {along:,.1f} in degrees, which a GeoJSON "
                'without the member "crs" is in',
                f"add --crs EPSG:...; the scene is in {frame.crs.name}",
            )
    return stated


def _conversion(path: Path, stated: CRS | None, frame: SurveyFrame) -> Any:
    """Make what brings (N, 2) coordinates of the file to x and z of the scene."""
    transformer = None
    if stated is not None and frame.crs is not None:
        transformer = Transformer.from_crs(stated, frame.crs, always_xy=True)

    def convert(coordinates: Float64) -> Float64:
        east, north = coordinates.T
        if transformer is not None:
            try:
                east, north = transformer.transform(east, north, errcheck=True)
            except ProjError as error:
                raise PlanError(
                    path, f"its coordinates do not convert ({error})", "check --crs"
                ) from None
        plan = frame.survey_to_plan(np.stack([east, north], axis=1))
        return np.stack(frame.ground(*plan.T), axis=1)

    return convert


def _is_points(shape: Any) -> bool:
    return shape.geom_type in ("Point", "MultiPoint")


def _outlined(shape: Any) -> Any | None:
    """Take outlines as polygons and open lines as lines; None of points alone."""
    areas: list[Any] = []
    lines: list[Any] = []
    for part in shapely.get_parts(shape):
        kind = part.geom_type
        if kind == "GeometryCollection":
            inner = _outlined(part)
            if inner is not None:
                (areas if shapely.get_dimensions(inner) == 2 else lines).append(inner)
        elif kind == "Polygon":
            areas.append(part)
        elif kind in ("LineString", "LinearRing"):
            is_outline = part.is_closed and shapely.get_num_coordinates(part) > 3
            (areas if is_outline else lines).append(
                shapely.Polygon(part.coords) if is_outline else part
            )
    if areas:
        valid = [shapely.make_valid(area) for area in areas]
        return shapely.union_all(
            [part for area in valid for part in shapely.get_parts(area) if part.area > 0]
        )
    return shapely.union_all(lines) if lines else None
