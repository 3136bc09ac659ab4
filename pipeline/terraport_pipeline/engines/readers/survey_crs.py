"""Interpretation of a survey's coordinates: directions and units of x, y and z.

The rules, in order; the user's statements (:class:`.SurveyStatement`) override those of files:

1. A CRS in degrees (geographic) or Earth-centred (geocentric) *and* coordinates that fit: refused.
   A mesh in degrees is distorted, and in an Earth-centred frame no axis points up.
2. Degrees or Earth-centred, but coordinates that do not fit: the statement is wrong (this occurs);
   the survey is treated as one without a CRS, with a warning.
3. A projected or local CRS. Coordinates are converted to easting, northing and height in metres:
   feet, and axes that point south, west or down. The scene's CRS becomes the same projection with
   such axes, so that scene coordinates can be converted back. Heights have their own unit if the
   CRS states one, else the horizontal unit. Coordinates outside the CRS's area are refused if they
   are inside it with x and y swapped, with their signs changed or in the other unit; otherwise they
   give a warning. So does a projection with a scale error above 1 % there (Web Mercator).
4. No CRS and no unit: refused if the numbers look like degrees, or can hardly be metres (feet of a
   State Plane); large ones are taken as metres with a warning, small ones are a local frame.
5. Units that one file states in contradictory ways, or that cannot be read: refused until the user
   states the right one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from pyproj import CRS, Proj, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError

from terraport_payload.types import Float64
from terraport_pipeline.crs_axes import (
    UnusableAxesError,
    code_of,
    epsg_of,
    height_axis,
    is_same_place,
    own_code,
    parts_of,
    plan_axes,
    with_axes,
)
from terraport_pipeline.errors import ReadError
from terraport_pipeline.model import Crs
from terraport_pipeline.survey_statement import METRES_PER_UNIT, SurveyStatement
from terraport_store.manifest import EAST_NORTH_UP, Axis, SurveyUnits

__all__ = ["UnitDoubt", "conversion_line", "interpret_coordinates"]

_EARTH_RADII_M: Final = (6.2e6, 6.5e6)
"""Distances from the Earth's centre at which a survey can lie."""

_DEGREES_ADVICE: Final = (
    "project it first, for example to its UTM zone (QGIS, PDAL filters.reprojection, las2las)"
)

_DEGREES: Final = "EPSG:4326"

_DEGREES_RATIO: Final = 100.0
"""Degrees are this many times taller than wide: a metre is 0.00001 degrees."""

_LOCAL: Final = 100_000.0
"""Numbers below it are a local frame's."""

_METRE_GRIDS: Final = (
    (100_000.0, 900_000.0, -10e6, 10e6),  # UTM, and most national grids
    (900_000.0, 1_300_000.0, 6.0e6, 7.2e6),  # France, Lambert-93
    (2_480_000.0, 2_840_000.0, 1.0e6, 1.4e6),  # Switzerland, LV95
    (900_000.0, 2_200_000.0, 4.7e6, 6.3e6),  # New Zealand, NZTM
    (700_000.0, 1_500_000.0, 1.3e6, 2.2e6),  # Korea
)
"""Boxes of eastings and northings that are metres wherever they are used."""

_ZONED: Final = (250_000.0, 750_000.0, 3.0e6, 7.0e6)
"""The same of grids whose eastings begin with the number of a zone: Gauss-Krueger, CGCS2000."""

_WORST_SCALE: Final = 0.01
"""A projection's lengths may differ so much from those on the ground: UTM's by 0.001."""

_BEYOND_DEGREES: Final = 5.0
"""A survey may lie so far north or south of its CRS's area."""

_AXIS_NAMES: Final = {
    "east": "easting", "west": "westing", "north": "northing", "south": "southing",
}  # fmt: skip

_OTHER_UNITS: Final = ("us-ft", "m")
"""Units that a survey may be in, against its CRS; both kinds of feet lie in the same area."""


@dataclass(frozen=True, slots=True)
class UnitDoubt:
    """A unit that a file states in two different ways, or that cannot be read."""

    is_height: bool
    """True for the unit of heights, False for that of x and y."""
    reason: str

    def is_settled(self, statement: SurveyStatement) -> bool:
        """Return whether the user's statement decides the unit."""
        if statement.units is not None or (self.is_height and statement.height_units is not None):
            return True
        system = statement.system
        return system is not None and not (self.is_height and height_axis(system) is None)


def interpret_coordinates(
    path: Path,
    low: Float64,
    high: Float64,
    crs: CRS | None,
    statement: SurveyStatement | None = None,
    doubts: Iterable[UnitDoubt] = (),
) -> tuple[SurveyUnits | None, Crs | None, list[str]]:
    """Apply the rules above to the bounding box of a cloud.

    Parameters
    ----------
    path : pathlib.Path
        Name for errors.
    low, high : ndarray of shape (3,), float64
        Corners of the cloud's bounding box in the files' coordinates.
    crs : pyproj.CRS or None
        CRS that the files state.
    statement : SurveyStatement, optional
        The user's statements.
    doubts : iterable of UnitDoubt
        Units that are unclear in the files.

    Returns
    -------
    units : SurveyUnits or None
        Conversion of coordinates to metres east, north and up; None if they are already.
    crs : Crs or None
        CRS of the converted coordinates.
    warnings : list of str

    Raises
    ------
    ReadError
        By rules 1, 3, 4 and 5.
    """
    statement = statement or SurveyStatement()
    warnings: list[str] = []
    for doubt in doubts:
        if not doubt.is_settled(statement):
            option = "--height-units" if doubt.is_height else "--units"
            raise ReadError(path, doubt.reason, f"say which is right: {option} m, ft or us-ft")
    # (1) What is stated by the user goes before what is stated by the files.
    if statement.system is not None:
        if crs is not None and crs != statement.system:
            _refuse_lost_heights(path, crs, statement)
            warnings.append(
                f"The files state {crs.name}; the survey is taken to be in "
                f"{statement.system.name}, as --crs says."
            )
        crs = statement.system
    # (2) Degrees, or Earth-centred: refused where the numbers agree.
    horizontal = None if crs is None else parts_of(crs)[0]
    height = None if crs is None else height_axis(crs)
    if horizontal is not None and (horizontal.is_geographic or horizontal.is_geocentric):
        _refuse_angles(path, low, high, horizontal)
        kind = "degrees" if horizontal.is_geographic else "Earth-centred"
        warnings.append(_wrong_crs(horizontal, kind, low, high))
        horizontal = None
    # (3) Directions and units: by the user, else by the CRS, else metres if the numbers allow it.
    if horizontal is None:
        crs = None
        if statement.units is None:
            _refuse_lone_height(path, height, statement)
            warnings += _refuse_doubts(path, low, high, says_more=bool(warnings))
    else:
        assert crs is not None
        crs, horizontal = _with_stated_axes(path, low, high, crs, horizontal, statement)
    of_crs = _units_of(path, horizontal, height)
    units = _stated_units(statement, of_crs)
    if crs is not None and units.horizontal_m != of_crs.horizontal_m:
        warnings.append(
            f"{crs.name} has units of {of_crs.horizontal_m:.9g} m; coordinates are taken to be in "
            f"units of {units.horizontal_m:.9g} m, as --units says."
        )
    if units.axes[2] == "down" and high[2] <= 0.0:
        warnings.append(
            f"The CRS has depths (positive down), but all z are negative ({low[2]:,.2f} to "
            f"{high[2]:,.2f}), so the ground would be above the datum. If z are heights, state a "
            "CRS with heights: --crs EPSG:n+m."
        )
    if horizontal is not None and crs is not None:
        warnings += _check_area(path, low, high, horizontal, units, statement)
        if horizontal.is_engineering and _lists_north_first(horizontal):
            warnings.append(
                f"{crs.name} lists the northing first; x is taken as the easting, as files have "
                "it. If the scene is a mirror image, swap x and y in the file."
            )
    is_plain = units == SurveyUnits(horizontal_m=1.0, height_m=1.0)
    # (4) The CRS of the scene; the survey's CRS is stored with the units.
    if crs is None or horizontal is None:
        return None if is_plain else units, None, warnings
    scene = Crs(crs.name, crs.to_wkt(), code_of(crs))
    if of_crs != SurveyUnits(horizontal_m=1.0, height_m=1.0):
        corners = np.array([low[:2], high[:2], [low[0], high[1]]])
        scene = _scene_crs(crs, of_crs, corners)
    if is_plain:
        return None, scene, warnings
    # The CRS describes the survey unless the user states another unit.
    says_heights = height is not None and units.height_m != of_crs.height_m
    if units.horizontal_m == of_crs.horizontal_m and not says_heights:
        units = units.model_copy(update={"crs_wkt": crs.to_wkt()})
    return units, scene, warnings


def conversion_line(units: SurveyUnits, crs: CRS | None, statement: SurveyStatement | None) -> str:
    """Describe how coordinates were converted: units, axes and the source of the statement.

    Parameters
    ----------
    units : SurveyUnits
        Result of :func:`interpret_coordinates`.
    crs : CRS, optional
        CRS that the files state.
    statement : SurveyStatement, optional
        The user's statements.
    """
    if statement is not None and statement.system is not None:
        crs = statement.system
    stated = f"horizontal unit {units.horizontal_m:.9g} m, height unit {units.height_m:.9g} m"
    if units.axes != EAST_NORTH_UP:
        stated += f"; x points {units.axes[0]}, y {units.axes[1]}, z {units.axes[2]}"
    said_by = "as stated" if crs is None else crs.name
    if units.axes == EAST_NORTH_UP:
        return (
            f"The survey is not in metres ({said_by}: {stated}); its coordinates were converted to "
            "metres."
        )
    return (
        f"The survey is not easting, northing and height in metres ({said_by}: {stated}); its "
        "coordinates were converted."
    )


def _refuse_lost_heights(path: Path, crs: CRS, statement: SurveyStatement) -> None:
    """Refuse a --crs without heights if the files state another height unit than it implies."""
    stated, system = height_axis(crs), statement.system
    if stated is None or system is None or height_axis(system) is not None:
        return
    horizontal, _ = parts_of(system)
    unit_m = 1.0 if horizontal is None else _units_of(path, horizontal, None).horizontal_m
    vertical = parts_of(crs)[1]
    name = crs.name if vertical is None else vertical.name
    advice = "add them to --crs, as in EPSG:26918+5703"
    if stated[0] == "down":
        raise ReadError(
            path,
            f"the files state depths ({name}), and --crs {statement.crs} does not say what z is",
            advice,
        )
    follows = statement.units is not None or statement.height_units is not None
    if not follows and abs(stated[1] - unit_m) > 1e-5 * unit_m:
        raise ReadError(
            path,
            f"the files state heights in units of {stated[1]:.9g} m ({name}), and --crs "
            f"{statement.crs} does not say what z is",
            f"{advice}, or add --height-units",
        )


def _refuse_lone_height(
    path: Path, height: tuple[Axis, float] | None, statement: SurveyStatement
) -> None:
    """Refuse heights in a stated unit other than metres if the unit of x and y is not stated."""
    if height is None or statement.height_units is not None or abs(height[1] - 1.0) < 1e-9:
        return
    raise ReadError(
        path,
        f"the file states heights in units of {height[1]:.9g} m, and no unit of x and y that fits",
        "add --units m, ft or us-ft, and --height-units, or --crs EPSG:n",
    )


def _with_stated_axes(
    path: Path,
    low: Float64,
    high: Float64,
    crs: CRS,
    horizontal: CRS,
    statement: SurveyStatement,
) -> tuple[CRS, CRS]:
    """Choose the axes if well-known text and the EPSG code in it have different ones.

    Well-known text older than 2015 often has the code of a CRS with axes to the south and west
    (EPSG:5513), but not its axes; the coordinates tell which axes are right.
    """
    code = own_code(horizontal)
    try:
        listed = None if code is None else CRS.from_epsg(code)
        if listed is None or plan_axes(listed)[0] == plan_axes(horizontal)[0]:
            return crs, horizontal
    except (CRSError, UnusableAxesError):
        return crs, horizontal
    fitting = []
    for candidate in (listed, horizontal):
        area = _Area.of(candidate, listed)
        units = _stated_units(statement, _units_of(path, candidate, None))
        if area is not None and area.holds(*_middle(low, high, candidate, units)):
            fitting.append(candidate)
    if len(fitting) != 1:
        axes = " and ".join(plan_axes(listed)[0])
        raise ReadError(
            path,
            f"it states {horizontal.name} as EPSG:{code}, whose axes point {axes}, without such "
            "axes, and the coordinates do not tell which is meant",
            f"say so: --crs EPSG:{code}, or the code of the same system with axes to the east and "
            "north",
        )
    [meant] = fitting
    vertical = parts_of(crs)[1]
    if meant is horizontal:
        return crs, horizontal
    whole = meant if vertical is None else CompoundCRS(crs.name, [meant, vertical])
    return whole, meant


def _units_of(path: Path, horizontal: CRS | None, height: tuple[Axis, float] | None) -> SurveyUnits:
    """Return directions and units of the CRS; metres east, north, up by default."""
    try:
        directions, unit_m = (
            (EAST_NORTH_UP[:2], 1.0) if horizontal is None else plan_axes(horizontal)
        )
    except UnusableAxesError as error:
        name = "" if horizontal is None else horizontal.name
        raise ReadError(
            path,
            f"its coordinate reference system ({name}) has {error}, expected one axis to the east "
            "or west, the other to the north or south, in one unit",
            "convert the survey, or state the right one with --crs EPSG:n",
        ) from None
    upright, height_m = ("up", unit_m) if height is None else height
    return SurveyUnits(
        horizontal_m=unit_m, height_m=height_m, axes=(directions[0], directions[1], upright)
    )


def _stated_units(statement: SurveyStatement, of_crs: SurveyUnits) -> SurveyUnits:
    """Return the user's units, else those of the CRS."""
    horizontal, upright = of_crs.horizontal_m, of_crs.height_m
    if statement.units is not None:
        horizontal = upright = METRES_PER_UNIT[statement.units]
    if statement.height_units is not None:
        upright = METRES_PER_UNIT[statement.height_units]
    return SurveyUnits(horizontal_m=horizontal, height_m=upright, axes=of_crs.axes)


def _lists_north_first(crs: CRS) -> bool:
    return [axis.direction for axis in crs.axis_info[:2]] == ["north", "east"]


def _scene_crs(crs: CRS, of_crs: SurveyUnits, corners: Float64) -> Crs:
    """Return the same CRS with axes east, north and up in metres.

    Only a name if PROJ cannot represent it, or transforms the corners differently.
    """
    changes = []
    if of_crs.axes[:2] != EAST_NORTH_UP[:2]:
        changes.append("east, north")
    if of_crs.axes[2] == "down":
        changes.append("up")
    if (of_crs.horizontal_m, of_crs.height_m) != (1.0, 1.0):
        changes.append("in metres")
    name = f"{crs.name} ({', '.join(changes)})"
    metric = with_axes(crs, EAST_NORTH_UP, 1.0, 1.0, name)
    if metric is None:
        return Crs(name, "", None)
    horizontal, flat = parts_of(crs)[0], parts_of(metric)[0]
    assert horizontal is not None
    assert flat is not None
    if not horizontal.is_engineering and not is_same_place(
        horizontal, flat, corners, of_crs.to_metres
    ):
        return Crs(name, "", None)
    code = epsg_of(metric)
    known = None if code is None else CRS.from_epsg(code)
    if known is not None and is_same_place(horizontal, known, corners, of_crs.to_metres):
        return Crs(known.name, known.to_wkt(), code)
    return Crs(name, metric.to_wkt(), None)


def _refuse_angles(path: Path, low: Float64, high: Float64, crs: CRS) -> None:
    """Refuse coordinates that are degrees or Earth-centred as their CRS says."""
    advice = f"{_DEGREES_ADVICE}, or state the right one with --crs EPSG:n"
    if crs.is_geographic and max(-low[:2].min(), high[:2].max()) <= 360.0:
        raise ReadError(path, f"its coordinates are degrees ({crs.name}), expected metres", advice)
    radius = float(np.linalg.norm(0.5 * (low + high)))
    if crs.is_geocentric and _EARTH_RADII_M[0] < radius < _EARTH_RADII_M[1]:
        raise ReadError(
            path,
            f"its coordinates are Earth-centred ({crs.name}), expected easting, northing, height",
            advice,
        )


def _refuse_doubts(path: Path, low: Float64, high: Float64, *, says_more: bool) -> list[str]:
    """Refuse coordinates without CRS and unit that are hardly metres; warn of large ones."""
    span = high - low
    x, y = (0.5 * (low + high))[:2]
    widest = np.sort(np.abs([low[:2], high[:2]]).max(axis=0))
    on_a_globe = bool((widest <= (90.0, 180.0)).all())  # whichever of them is the latitude
    if on_a_globe and span[2] >= _DEGREES_RATIO * max(float(span[:2].max()), 1e-12):
        raise ReadError(
            path,
            f"its coordinates look like degrees (x {low[0]:.4f} to {high[0]:.4f}, y {low[1]:.4f} "
            f"to {high[1]:.4f}, {span[2]:,.0f} high), expected metres",
            f"{_DEGREES_ADVICE}; where they are metres all the same, add --units m",
        )
    if max(abs(x), abs(y)) < _LOCAL:
        return []
    if not _can_be_metres(x, y):
        swapped = _can_be_metres(y, x)
        raise ReadError(
            path,
            f"no coordinate reference system is stated, and coordinates about {x:,.0f}, {y:,.0f} "
            "are hardly metres: they look like feet"
            + (", or like northing before easting" if swapped else ""),
            "add --crs EPSG:n (epsg.io finds it by place), or else --units us-ft, ft or m"
            + ("; of a text with northings first say --columns y,x,z,..." if swapped else ""),
        )
    if says_more:
        return []
    return [
        (
            "No coordinate reference system is stated: the coordinates are taken as metres. If "
            "they are feet, build with --units us-ft or ft; --crs EPSG:n says where on Earth they "
            "lie."
        )
    ]


def _can_be_metres(x: float, y: float) -> bool:
    """Whether a place is within a grid in metres that is in use somewhere."""
    if any(w <= x <= e and s <= y <= n for w, e, s, n in _METRE_GRIDS):
        return True
    w, e, s, n = _ZONED
    local_frame_in_x = abs(x) < _LOCAL and abs(y) <= 10e6
    return local_frame_in_x or (1e6 < x < 61e6 and w <= x % 1e6 <= e and s <= y <= n)


def _check_area(
    path: Path,
    low: Float64,
    high: Float64,
    crs: CRS,
    units: SurveyUnits,
    statement: SurveyStatement,
) -> list[str]:
    """Refuse coordinates that fit the CRS's area only swapped, negated or in another unit."""
    code = own_code(crs)
    area = _Area.of(crs, None if code is None else _known(code))
    if area is None:
        return []  # a local or engineering system, or one without an area
    unit = _units_of(path, crs, None).horizontal_m
    x, y = _middle(low, high, crs, units)
    where = f"about {x:,.0f}, {y:,.0f}"
    if area.holds(x, y):
        scale = area.scale(x, y)
        if abs(scale - 1.0) > _WORST_SCALE and statement.units is None:
            raise ReadError(
                path,
                f"lengths in its coordinate reference system ({crs.name}) are {scale:.3g} times "
                "those on the ground there, expected the same within 1 %",
                "reproject it, for example to its UTM zone (QGIS, PDAL filters.reprojection), or "
                "add --units m to build it as it is",
            )
        return []
    if units.axes[:2] != EAST_NORTH_UP[:2]:
        turned = SurveyUnits(horizontal_m=1.0, height_m=1.0, axes=units.axes)
        own_x, own_y = turned.from_metres(np.array([[x, y]]))[0].tolist()
        if area.holds(own_x, own_y):
            raise ReadError(
                path,
                f"its coordinates ({where}) are easting and northing, and the axes of {crs.name} "
                f"point {units.axes[0]} and {units.axes[1]}",
                f"state the same system with axes to the east and north: --crs {_turned(crs)}",
            )
    if area.holds(y, x):
        raise ReadError(
            path,
            f"its coordinates ({where}) lie outside the area of {crs.name}, and within it with x "
            "and y swapped: the scene would be a mirror image",
            f"export it as {_AXIS_NAMES[units.axes[0]]}, {_AXIS_NAMES[units.axes[1]]}, height; of "
            "a text say --columns y,x,z",
        )
    for names, turned_x, turned_y in (
        ("westing and southing", -x, -y),
        ("southing and westing", -y, -x),
    ):
        if area.holds(turned_x, turned_y):
            raise ReadError(
                path,
                f"its coordinates ({where}) are outside the area of {crs.name}; read as {names} "
                "they are inside: the scene would be rotated or mirrored",
                "export it as easting, northing, height, or state the CRS that counts so (as "
                "EPSG:5513 does, and not EPSG:5514)",
            )
    for name in _OTHER_UNITS:
        share = METRES_PER_UNIT[name] / unit
        if statement.units is None and abs(share - 1) > 0.1 and area.holds(x * share, y * share):
            raise ReadError(
                path,
                f"its coordinates ({where}) lie outside the area of {crs.name} in its own unit, "
                f"and within it in {name}",
                f"add --units {name}, or state the right one with --crs EPSG:n",
            )
    return [
        (
            f"The coordinates ({where}) lie outside the area that {crs.name} is made for: sizes "
            "are as they say, the place on Earth is not to be relied on. --crs EPSG:n states "
            "another."
        )
    ]


def _middle(low: Float64, high: Float64, crs: CRS, units: SurveyUnits) -> tuple[float, float]:
    """Return x and y of the centre of a bounding box in the CRS's unit."""
    share = units.horizontal_m / plan_axes(crs)[1]
    x, y = ((0.5 * (low + high))[:2] * share).tolist()
    return x, y


def _known(code: int) -> CRS | None:
    try:
        return CRS.from_epsg(code)
    except CRSError:
        return None


def _turned(crs: CRS) -> str:
    """Return the --crs value of the same CRS with axes to the east and north."""
    turned = with_axes(crs, EAST_NORTH_UP, None, None)
    if turned is None:
        return "EPSG:n"
    code = epsg_of(turned)
    return f"EPSG:{code}" if code is not None else f"'{turned.to_wkt()}'"


class _Area:
    """The area on Earth that a CRS is made for, in its own coordinates."""

    def __init__(self, crs: CRS, box: tuple[float, float, float, float]) -> None:
        self._box = box
        # Its angles may be grads, relative to Paris or Ferro.
        self._to_degrees = Transformer.from_crs(crs, _DEGREES, always_xy=True)
        self._proj = Proj(crs)

    @classmethod
    def of(cls, crs: CRS, known: CRS | None = None) -> _Area | None:
        """Return the area of use of the CRS, or of its EPSG definition."""
        use = crs.area_of_use or (None if known is None else known.area_of_use)
        if use is None or crs.geodetic_crs is None:
            return None
        try:
            return cls(crs, use.bounds)
        except (CRSError, ProjError):
            return None

    def holds(self, x: float, y: float) -> bool:
        """Whether a place is within, or beside it by up to half its width: zones are stretched."""
        longitude, latitude = self._to_degrees.transform(x, y)
        if not (math.isfinite(longitude) and math.isfinite(latitude)):
            return False
        west, south, east, north = self._box
        width = (east - west) % 360.0 or 360.0  # an area may cross the date line
        across = (longitude - west - width / 2 + 180.0) % 360.0 - 180.0
        beside = abs(across) <= width
        beyond = min((north - south) / 2, _BEYOND_DEGREES)
        return bool(beside and south - beyond <= latitude <= north + beyond)

    def scale(self, x: float, y: float) -> float:
        """Length in the CRS of a metre on the ground, as the mean of both directions."""
        longitude, latitude = self._to_degrees.transform(x, y)
        factors = self._proj.get_factors(longitude, latitude, errcheck=False)
        scale = math.sqrt(abs(float(factors.areal_scale)))
        return scale if math.isfinite(scale) and scale > 0 else 1.0


def _wrong_crs(crs: CRS, kind: str, low: Float64, high: Float64) -> str:
    middle = ", ".join(f"{value:,.0f}" for value in 0.5 * (low + high))
    return (
        f"The file states a CRS in {kind} coordinates ({crs.name}), but its coordinates (about "
        f"{middle}) cannot be that; they are taken as metres without a CRS."
    )
