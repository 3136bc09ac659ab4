"""The coordinates that exports are written in: those of the survey, in its own unit and axes.

A scene is in metres east, north and up. If the survey is not, the manifest states its units, axes
and CRS (``survey_units``), and exports are converted back to them. If that CRS is not known (the
user stated another unit than the CRS's), exports stay in the CRS of the scene.

There are two kinds of coordinates. *Plan* coordinates are easting, northing and height in the
survey's units, whatever its axes: grids, sections and outlines are computed in them. *Survey*
coordinates also have the survey's axes (those of EPSG:2053 point west and south): they are used in
files and on the command line. If the axes point east, north and up, both are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64
from terraport_pipeline.extent import Extent
from terraport_pipeline.model import to_crs
from terraport_pipeline.survey_statement import METRES_PER_UNIT
from terraport_store import EAST_NORTH_UP, Manifest, SurveyUnits
from terraport_store.manifest import CrsInfo

if TYPE_CHECKING:
    import shapely
    from pyproj import CRS

__all__ = ["SurveyFrame", "survey_frame"]

_METRES: Final = SurveyUnits(horizontal_m=1.0, height_m=1.0)


@dataclass(frozen=True, slots=True)
class SurveyFrame:
    """How scene positions become coordinates of the survey."""

    origin: tuple[float, float, float]
    """E0, N0, H0 in metres."""
    crs: CRS | None
    """None where the survey states none, or one that PROJ does not read."""
    units: SurveyUnits = _METRES

    @property
    def unit_m(self) -> float:
        """Metres per unit of easting and northing."""
        return self.units.horizontal_m

    @property
    def height_unit_m(self) -> float:
        """Metres per unit of height."""
        return self.units.height_m

    @property
    def unit_name(self) -> str:
        """Name of the horizontal unit."""
        return _unit_name(self.unit_m)

    @property
    def height_unit_name(self) -> str:
        """Name of the height unit."""
        return _unit_name(self.height_unit_m)

    @property
    def decimals(self) -> int:
        """Decimals that a text needs for a tenth of a millimetre, at least four."""
        longest_m = max(self.unit_m, self.height_unit_m, 1.0)
        return 4 + math.ceil(math.log10(longest_m))

    @property
    def is_turned(self) -> bool:
        """True if the survey's axes are not east, north and up."""
        return self.units.axes != EAST_NORTH_UP

    @property
    def height_sign(self) -> float:
        """-1 if the survey has depths, else 1."""
        return -1.0 if self.units.axes[2] == "down" else 1.0

    @property
    def shift(self) -> tuple[float, float, float]:
        """What to add to small survey coordinates: whole units near the scene's origin."""
        x, y, z = np.round(self.units.from_metres(np.array([self.origin]))[0]).tolist()
        return x, y, z

    def to_survey(self, positions: AnyFloat) -> Float64:
        """Convert scene positions (N, 3) to survey coordinates."""
        return self.units.from_metres(to_crs(positions, np.array(self.origin)))

    def to_plan(self, positions: AnyFloat) -> Float64:
        """Convert scene positions (N, 3) to easting, northing and height in the survey's units."""
        return self._plan_units.from_metres(to_crs(positions, np.array(self.origin)))

    def directions_to_survey(self, directions: AnyFloat) -> Float64:
        """Convert directions (N, 3) of the scene frame to the survey's axes, with equal lengths."""
        turned = SurveyUnits(horizontal_m=1.0, height_m=1.0, axes=self.units.axes)
        return turned.from_metres(to_crs(directions, np.zeros(3)))

    def plan_to_survey(self, plan: AnyFloat) -> Float64:
        """Convert plan coordinates, (N, 2) or (N, 3), to survey coordinates."""
        if not self.is_turned:
            return np.asarray(plan, np.float64)
        return self.units.from_metres(self._plan_units.to_metres(plan))

    def survey_to_plan(self, coordinates: AnyFloat) -> Float64:
        """Convert survey coordinates, (N, 2) or (N, 3), to plan coordinates."""
        if not self.is_turned:
            return np.asarray(coordinates, np.float64)
        return self._plan_units.from_metres(self.units.to_metres(coordinates))

    def shape_to_survey(self, shape: shapely.Geometry) -> shapely.Geometry:
        """Convert a shape in plan coordinates to survey coordinates."""
        import shapely  # terraport list needs neither this nor PROJ

        return shapely.transform(shape, self.plan_to_survey) if self.is_turned else shape

    def extent_to_plan(self, extent: Extent) -> Extent:
        """Convert an extent in survey coordinates to plan coordinates."""
        return _extent_of(self.survey_to_plan(_ends_of(extent)))

    def extent_to_survey(self, extent: Extent) -> Extent:
        """Convert an extent in plan coordinates to survey coordinates."""
        return _extent_of(self.plan_to_survey(_ends_of(extent)))

    def ground(self, east: AnyFloat, north: AnyFloat) -> tuple[Float64, Float64]:
        """Convert plan eastings and northings to x and z of the scene, metres, float64."""
        x = np.asarray(east, np.float64) * self.unit_m - self.origin[0]
        z = self.origin[1] - np.asarray(north, np.float64) * self.unit_m
        return x, z

    def heights(self, y: AnyFloat) -> Float64:
        """Convert y of the scene to plan heights."""
        return (np.asarray(y, np.float64) + self.origin[2]) / self.height_unit_m

    def in_metres(self, manifest: Manifest) -> SurveyFrame:
        """Return the frame for formats with metres and an upward axis only (glTF)."""
        return self if self.units == _METRES else SurveyFrame(self.origin, _stated(manifest.crs))

    @property
    def _plan_units(self) -> SurveyUnits:
        return SurveyUnits(horizontal_m=self.unit_m, height_m=self.height_unit_m)


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
    own = _read_crs(units.crs_wkt) if units.crs_wkt else None
    if own is None and stated is not None:
        return SurveyFrame(manifest.origin, stated)
    return SurveyFrame(manifest.origin, own, units)


def _ends_of(extent: Extent) -> Float64:
    return np.array([(extent.xmin, extent.ymin), (extent.xmax, extent.ymax)])


def _extent_of(ends: Float64) -> Extent:
    low, high = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
    return Extent(low[0], low[1], high[0], high[1])


def _stated(info: CrsInfo | None) -> CRS | None:
    if info is None:
        return None
    texts = (info.wkt, None if info.epsg is None else f"EPSG:{info.epsg}")
    return next((crs for text in texts if text and (crs := _read_crs(text))), None)


def _read_crs(text: str) -> CRS | None:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(text)
    except CRSError:
        return None


def _unit_name(metres: float) -> str:
    for name, size in METRES_PER_UNIT.items():
        if abs(metres - size) < 1e-9:
            return name
    return f"{metres:.9g} m"
