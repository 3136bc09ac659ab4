"""The coordinates that exports are written in: those of the survey, in its own unit.

A survey in feet is built in metres (:mod:`terraport_pipeline.engines.readers.survey_crs`), and the
manifest then has the same projection with axes in metres, called "... (in metres)", and the length
of the survey's units. What is handed on goes back to the survey's own units, and its own CRS where
PROJ knows it by that name in these units; else it stays in metres, in the CRS that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from terraport_payload.types import AnyFloat, Float64
from terraport_pipeline.model import to_crs
from terraport_store import Manifest
from terraport_store.manifest import CrsInfo, SurveyUnits

__all__ = ["SurveyFrame", "survey_frame"]

_METRIC: Final = " (in metres)"
"""What the reader puts behind the name of a CRS whose axes it turned into metres."""

_SAME_UNIT: Final = 1e-9
"""Share by which two lengths of a unit may differ: feet of two kinds differ by two millionths."""


@dataclass(frozen=True, slots=True)
class SurveyFrame:
    """How scene positions become coordinates of the survey."""

    origin: tuple[float, float, float]
    """E0, N0, H0 in metres."""
    crs: CRS | None
    """None where the survey states none, or one that PROJ does not read."""
    unit_m: float = 1.0
    """Metres in a unit of easting and northing."""
    height_unit_m: float = 1.0
    """Metres in a unit of height."""

    @property
    def units_m(self) -> Float64:
        """(3,) metres in a unit of easting, northing and height."""
        return np.array([self.unit_m, self.unit_m, self.height_unit_m])

    @property
    def unit_name(self) -> str:
        """Name of the horizontal unit."""
        return _unit_name(self.unit_m)

    @property
    def height_unit_name(self) -> str:
        """Name of the height unit."""
        return _unit_name(self.height_unit_m)

    @property
    def shift(self) -> tuple[float, float, float]:
        """What to add to small coordinates: whole units near the scene's origin."""
        east, north, height = np.round(np.array(self.origin) / self.units_m).tolist()
        return east, north, height

    def to_survey(self, positions: AnyFloat) -> Float64:
        """Convert scene positions (N, 3) to coordinates of the survey, in its unit."""
        metres = to_crs(positions, np.array(self.origin))
        return metres if self.unit_m == self.height_unit_m == 1.0 else metres / self.units_m

    def ground(self, east: AnyFloat, north: AnyFloat) -> tuple[Float64, Float64]:
        """Convert eastings and northings to x and z of the scene, metres, float64."""
        x = np.asarray(east, np.float64) * self.unit_m - self.origin[0]
        z = self.origin[1] - np.asarray(north, np.float64) * self.unit_m
        return x, z

    def heights(self, y: AnyFloat) -> Float64:
        """Convert y of the scene to heights of the survey."""
        return (np.asarray(y, np.float64) + self.origin[2]) / self.height_unit_m

    def in_metres(self, manifest: Manifest) -> SurveyFrame:
        """Return the frame of formats that know metres alone (glTF)."""
        if self.unit_m == self.height_unit_m == 1.0:
            return self
        return SurveyFrame(self.origin, _stated(manifest.crs))


def survey_frame(manifest: Manifest) -> SurveyFrame:
    """Take the survey's frame from a manifest.

    Parameters
    ----------
    manifest : Manifest

    Returns
    -------
    SurveyFrame
    """
    stated, units = _stated(manifest.crs), manifest.survey_units
    if units is None:
        return SurveyFrame(manifest.origin, stated)
    own = None
    if stated is not None and manifest.crs is not None:
        own = _own_crs(manifest.crs.name, units)
        if own is None:
            return SurveyFrame(manifest.origin, stated)
    return SurveyFrame(manifest.origin, own, units.horizontal_m, units.height_m)


def _own_crs(name: str, units: SurveyUnits) -> CRS | None:
    """Find the CRS whose metric form a scene states; None where PROJ has none in these units."""
    try:
        own = CRS.from_user_input(name.removesuffix(_METRIC))
    except CRSError:  # a name of the file's own
        return None
    for axis in own.axis_info:
        is_height = axis.direction in ("up", "down")
        unit_m = units.height_m if is_height else units.horizontal_m
        if abs(axis.unit_conversion_factor - unit_m) > _SAME_UNIT * unit_m:
            return None
    return own


def _stated(info: CrsInfo | None) -> CRS | None:
    if info is None:
        return None
    for text in (info.wkt, None if info.epsg is None else f"EPSG:{info.epsg}"):
        if text:
            try:
                return CRS.from_user_input(text)
            except CRSError:
                continue
    return None


def _unit_name(metres: float) -> str:
    for name, size in (("m", 1.0), ("ft", 0.3048), ("us-ft", 1200 / 3937)):
        if abs(metres - size) < 1e-9:
            return name
    return f"{metres:.9g} m"
