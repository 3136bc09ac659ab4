"""What a stated coordinate reference system means for a survey: metres, feet, degrees, or nonsense.

The rules, in order:

1. Degrees (geographic) or Earth-centred (geocentric) *and* coordinates that fit: refused. A mesh in
   degrees is no shape, and in an Earth-centred frame up is not up.
2. Degrees or Earth-centred, but coordinates that cannot be that: the statement is wrong (it
   happens); the survey counts as one without CRS, with a warning.
3. Feet: converted to metres. The CRS becomes the same projection with axes in metres, so that a
   scene coordinate still means a place. Heights follow their own unit where the CRS states one,
   else the horizontal one.
4. No CRS, but numbers that look like degrees: a warning.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_payload.types import Float64
from terraport_pipeline.errors import ReadError
from terraport_pipeline.model import Crs

__all__ = ["metre_factors", "to_metres"]

_EARTH_RADII_M: Final = (6.2e6, 6.5e6)
"""Distances from the Earth's centre at which a survey can lie."""

_DEGREES_ADVICE: Final = (
    "project it first, for example to its UTM zone (QGIS, PDAL filters.reprojection, las2las)"
)


def to_metres(
    path: Path, points: Float64, crs: Any | None
) -> tuple[Float64, Crs | None, list[str]]:
    """Apply the rules above.

    Parameters
    ----------
    path : pathlib.Path
        Named in errors.
    points : ndarray of shape (N, 3), float64
        Finite, in the unit of `crs`; not modified.
    crs : pyproj.CRS or None
        As the file states it.

    Returns
    -------
    points : ndarray of shape (N, 3), float64
        Metres.
    crs : Crs or None
        In metres.
    warnings : list of str

    Raises
    ------
    ReadError
        By rule 1.
    """
    factors, metre_crs, warnings = metre_factors(path, points.min(axis=0), points.max(axis=0), crs)
    return (points if factors is None else points * factors), metre_crs, warnings


def metre_factors(
    path: Path, low: Float64, high: Float64, crs: Any | None
) -> tuple[Float64 | None, Crs | None, list[str]]:
    """Apply the rules above to a cloud of which only the box is known.

    Parameters
    ----------
    path : pathlib.Path
        Named in errors.
    low, high : ndarray of shape (3,), float64
        Corners of the cloud's box in the unit of `crs`.
    crs : pyproj.CRS or None
        As the file states it.

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
        By rule 1.
    """
    # (1) Nothing stated, degrees, or Earth-centred: refused where the numbers agree, taken as
    # metres with a warning where they do not.
    if crs is None:
        return None, None, _suspect_degrees(low, high)
    if crs.is_geographic:
        if max(-low[:2].min(), high[:2].max()) <= 360.0:
            raise ReadError(
                path, f"its coordinates are degrees ({crs.name}), expected metres", _DEGREES_ADVICE
            )
        return None, None, [_wrong_crs(crs, "degrees", low, high)]
    if crs.is_geocentric:
        radius = float(np.linalg.norm(0.5 * (low + high)))
        if _EARTH_RADII_M[0] < radius < _EARTH_RADII_M[1]:
            raise ReadError(
                path,
                f"its coordinates are Earth-centred ({crs.name}), expected easting, northing, "
                "height",
                _DEGREES_ADVICE,
            )
        return None, None, [_wrong_crs(crs, "Earth-centred", low, high)]
    # (2) Projected: metres already, or to be scaled.
    factors = _unit_factors(crs)
    if factors == (1.0, 1.0, 1.0):
        return None, Crs(crs.name, crs.to_wkt(), crs.to_epsg()), []
    units = f"horizontal unit {factors[0]:.9g} m, height unit {factors[2]:.9g} m"
    warning = (
        f"The survey is not in metres ({crs.name}: {units}); its coordinates were converted to "
        "metres."
    )
    return np.array(factors), _in_metres(crs), [warning]


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


def _suspect_degrees(low: Float64, high: Float64) -> list[str]:
    """Warn of a cloud that is within a map in degrees and far taller than wide."""
    span = high - low
    inside = (np.abs([low[:2], high[:2]]).max(axis=0) <= (180.0, 90.0)).all()
    if not inside or span[2] < 100.0 * max(float(span[:2].max()), 1e-12):
        return []
    return [
        (
            f"The coordinates look like degrees (east {low[0]:.4f} to {high[0]:.4f}, north "
            f"{low[1]:.4f} to {high[1]:.4f}) but are taken as metres; if so, {_DEGREES_ADVICE}."
        )
    ]
