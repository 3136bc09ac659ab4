"""What the coordinates of a survey mean: metres, feet, degrees, or something nobody said.

The rules, in order; what a user states (:class:`.SurveyStatement`) overrules what files say:

1. A CRS in degrees (geographic) or Earth-centred (geocentric) *and* coordinates that fit: refused.
   A mesh in degrees is no shape, and in an Earth-centred frame up is not up.
2. Degrees or Earth-centred, but coordinates that cannot be that: the statement is wrong (it
   happens); the survey counts as one without CRS, with a warning.
3. A projected CRS. Feet are converted to metres: the CRS becomes the same projection with axes in
   metres, so that a scene coordinate still means a place. Heights follow their own unit where the
   CRS states one, else the horizontal one. Coordinates outside the CRS's area that lie in it with x
   and y swapped, or in the other unit, are refused; others outside it get a warning. So is a
   projection that draws lengths more than 1 % wrong there (Web Mercator).
4. No CRS and no unit: refused where the numbers look like degrees, or can hardly be metres (feet
   of a State Plane); large ones are taken as metres with a warning, small ones are a local frame.
"""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS, Proj, Transformer
from pyproj.exceptions import CRSError, ProjError

from terraport_payload.types import Float64
from terraport_pipeline.errors import ReadError
from terraport_pipeline.model import Crs
from terraport_pipeline.survey_statement import METRES_PER_UNIT, SurveyStatement

__all__ = ["conversion_line", "metre_factors"]

_EARTH_RADII_M: Final = (6.2e6, 6.5e6)
"""Distances from the Earth's centre at which a survey can lie."""

_DEGREES_ADVICE: Final = (
    "project it first, for example to its UTM zone (QGIS, PDAL filters.reprojection, las2las)"
)

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

_OTHER_UNITS: Final = ("us-ft", "m")
"""Units that a survey may be in, against its CRS; both kinds of feet lie in the same area."""


def metre_factors(
    path: Path,
    low: Float64,
    high: Float64,
    crs: Any | None,
    statement: SurveyStatement | None = None,
) -> tuple[Float64 | None, Crs | None, list[str]]:
    """Apply the rules above to a cloud of which only the box is known.

    Parameters
    ----------
    path : pathlib.Path
        Named in errors.
    low, high : ndarray of shape (3,), float64
        Corners of the cloud's box as the files have it.
    crs : pyproj.CRS or None
        As the files state it.
    statement : SurveyStatement, optional
        What the user states.

    Returns
    -------
    factors : ndarray of shape (3,), float64, or None
        What brings coordinates to metres; None where they are.
    crs : Crs or None
        In metres.
    warnings : list of str

    Raises
    ------
    ReadError
        By rules 1, 3 and 4.
    """
    statement = statement or SurveyStatement()
    warnings: list[str] = []
    # (1) What is stated by the user goes before what is stated by the files.
    if statement.system is not None:
        if crs is not None and crs != statement.system:
            warnings.append(
                f"The files state {crs.name}; the survey is taken to be in "
                f"{statement.system.name}, as --crs says."
            )
        crs = statement.system
    # (2) Degrees, or Earth-centred: refused where the numbers agree.
    if crs is not None and (crs.is_geographic or crs.is_geocentric):
        _refuse_angles(path, low, high, crs)
        kind = "degrees" if crs.is_geographic else "Earth-centred"
        warnings.append(_wrong_crs(crs, kind, low, high))
        crs = None
    # (3) The unit, by the user, else by the CRS, else metres where the numbers can be.
    of_crs = (1.0, 1.0, 1.0) if crs is None else _unit_factors(crs)
    if crs is None and statement.units is None:
        warnings += _refuse_doubts(path, low, high, says_more=bool(warnings))
    factors = _stated_factors(statement, of_crs)
    if crs is not None and factors[0] != of_crs[0]:
        warnings.append(
            f"{crs.name} has units of {of_crs[0]:.9g} m; coordinates are taken to be in units of "
            f"{factors[0]:.9g} m, as --units says."
        )
    area = [] if crs is None else _check_area(path, low, high, crs, factors, statement)
    # (4) The CRS with axes in metres.
    metric = None
    if crs is not None:
        is_metric = factors == of_crs == (1.0, 1.0, 1.0)
        metric = Crs(crs.name, crs.to_wkt(), crs.to_epsg()) if is_metric else _in_metres(crs)
    is_metres = factors == (1.0, 1.0, 1.0)
    return None if is_metres else np.array(factors), metric, [*warnings, *area]


def conversion_line(factors: Float64, crs: CRS | None, statement: SurveyStatement | None) -> str:
    """Say that coordinates were brought to metres, by which units, and who said so.

    Parameters
    ----------
    factors : ndarray of shape (3,), float64
        Of :func:`metre_factors`.
    crs : CRS, optional
        That the files state.
    statement : SurveyStatement, optional
        The user's.
    """
    if statement is not None and statement.system is not None:
        crs = statement.system
    units = f"horizontal unit {factors[0]:.9g} m, height unit {factors[2]:.9g} m"
    said_by = "as stated" if crs is None else crs.name
    return (
        f"The survey is not in metres ({said_by}: {units}); its coordinates were converted to "
        "metres."
    )


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
        raise ReadError(
            path,
            f"no coordinate reference system is stated, and coordinates about {x:,.0f}, {y:,.0f} "
            "are hardly metres: they look like feet",
            "add --crs EPSG:n (epsg.io finds it by place), or else --units us-ft, ft or m",
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


def _stated_factors(
    statement: SurveyStatement, of_crs: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Metres per unit of each axis, by the user before the CRS."""
    horizontal, _, upright = of_crs
    if statement.units is not None:
        horizontal = upright = METRES_PER_UNIT[statement.units]
    if statement.height_units is not None:
        upright = METRES_PER_UNIT[statement.height_units]
    return horizontal, horizontal, upright


def _check_area(
    path: Path,
    low: Float64,
    high: Float64,
    crs: CRS,
    factors: tuple[float, float, float],
    statement: SurveyStatement,
) -> list[str]:
    """Refuse what is in its CRS's area only with x and y swapped or in the other unit."""
    area = _Area.of(crs)
    if area is None:
        return []  # a local or engineering system, or one without an area
    unit = _unit_factors(crs)[0]
    x, y = (0.5 * (low + high))[:2] * (factors[0] / unit)  # in the CRS's own unit
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
    if area.holds(y, x):
        raise ReadError(
            path,
            f"its coordinates ({where}) lie outside the area of {crs.name}, and within it with x "
            "and y swapped: the scene would be a mirror image",
            "export it as easting, northing, height; of a text say --columns y,x,z",
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


class _Area:
    """The area on Earth that a CRS is made for, in its own coordinates."""

    def __init__(self, crs: CRS, box: tuple[float, float, float, float]) -> None:
        self._box = box
        self._to_degrees = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
        self._proj = Proj(crs)

    @classmethod
    def of(cls, crs: CRS) -> _Area | None:
        """Make it, where the CRS has one."""
        if crs.area_of_use is None or crs.geodetic_crs is None:
            return None
        try:
            return cls(crs, crs.area_of_use.bounds)
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


def _unit_factors(crs: CRS) -> tuple[float, float, float]:
    """Metres per unit of each axis."""
    axes = [axis for axis in crs.axis_info if axis.unit_conversion_factor > 0]
    level = [a.unit_conversion_factor for a in axes if a.direction not in ("up", "down")]
    upright = [a.unit_conversion_factor for a in axes if a.direction in ("up", "down")]
    horizontal = level[0] if level else 1.0
    return horizontal, horizontal, upright[0] if upright else horizontal


def _in_metres(crs: CRS) -> Crs:
    """Return the same CRS with every axis in metres; only a name where PROJ cannot say it."""
    name = f"{crs.name} (in metres)"
    description = copy.deepcopy(crs.to_json_dict())
    for component in [description, *description.get("components", [])]:
        component.pop("id", None)
        for axis in component.get("coordinate_system", {}).get("axis", []):
            axis["unit"] = "metre"
    description["name"] = name
    try:
        metric = CRS.from_json_dict(description)
        return Crs(name, metric.to_wkt(), None)
    except CRSError:
        return Crs(name, "", None)


def _wrong_crs(crs: CRS, kind: str, low: Float64, high: Float64) -> str:
    middle = ", ".join(f"{value:,.0f}" for value in 0.5 * (low + high))
    return (
        f"The file states a CRS in {kind} coordinates ({crs.name}), but its coordinates (about "
        f"{middle}) cannot be that; they are taken as metres without a CRS."
    )
