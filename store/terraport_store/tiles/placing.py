"""Where on Earth a scene lies: from its CRS to Earth-centred metres (EPSG:4978), by PROJ.

Pure but for PROJ's own tables, which come with pyproj; nothing is fetched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64
from terraport_store.manifest import Manifest

__all__ = ["Placing", "place_scene"]

_EARTH_CENTRED: Final = "EPSG:4978"
_STEP_M: Final = 10.0
"""Half the length over which slopes are taken: float64 is exact to a nanometre there, and the
Earth's curve cancels out."""


@dataclass(frozen=True, slots=True)
class Placing:
    """How tile coordinates (east, north, up about the scene's origin, metres) become Earth's."""

    origin: tuple[float, float, float]
    """E0, N0, H0 in metres."""
    to_earth: object | None
    """PROJ's transformer; None: a local scene."""
    why_local: str = ""
    """What is said of a local one."""

    @property
    def is_local(self) -> bool:
        """Whether the scene has no place on Earth."""
        return self.to_earth is None

    def earth(self, tile_positions: AnyFloat) -> Float64:
        """Convert tile coordinates (N, 3) to Earth-centred ones, point by point.

        Those of a local scene are returned as they are.
        """
        points = np.asarray(tile_positions, dtype=np.float64)
        if self.to_earth is None:
            return points
        east, north, height = (points + np.array(self.origin)).T
        # By PROJ's own class, which has no types here: see place_scene.
        placed = self.to_earth.transform(east, north, height)  # type: ignore[attr-defined]
        return np.stack(placed, axis=1)

    def matrix_at(self, middle: AnyFloat) -> Float64:
        """Return the matrix (4, 4) that is right at one place, and nearly so around it.

        Departs from :meth:`earth` by the fall of the Earth, d^2 / 2R: 0.8 mm at 100 m.

        Parameters
        ----------
        middle : ndarray of shape (3,)
            Tile coordinates.
        """
        middle = np.asarray(middle, dtype=np.float64)
        steps = np.eye(3) * _STEP_M
        places = self.earth(np.concatenate([[middle], middle + steps, middle - steps]))
        matrix = np.eye(4)
        matrix[:3, :3] = (places[1:4] - places[4:7]).T / (2 * _STEP_M)
        matrix[:3, 3] = places[0] - matrix[:3, :3] @ middle
        return matrix


def place_scene(manifest: Manifest, *, height_shift_m: float = 0.0) -> Placing:
    """Find a scene's place on Earth.

    Heights of a CRS without vertical datum are taken as above the ellipsoid; where PROJ would need
    a grid of the geoid that it does not have, too.

    Parameters
    ----------
    manifest : Manifest
    height_shift_m : float, optional
        Added to every height: the geoid's, where the survey's are above sea level.

    Returns
    -------
    Placing
        A local one where the scene states no CRS, or one that PROJ cannot bring onto the Earth.

    Raises
    ------
    ModuleNotFoundError
        When pyproj is not installed.
    """
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError, ProjError

    east, north, height = manifest.origin
    origin = (east, north, height + height_shift_m)
    if manifest.crs is None:
        return Placing(origin, None, "the survey states no coordinate reference system")
    stated = f"{manifest.crs.name!r} cannot be brought onto the Earth"
    epsg = manifest.crs.epsg
    for text in (manifest.crs.wkt, None if epsg is None else f"EPSG:{epsg}"):
        if not text:
            continue
        try:
            crs = CRS.from_user_input(text)
            transformer = Transformer.from_crs(crs.to_3d(), _EARTH_CENTRED, always_xy=True)
            placing = Placing(origin, transformer)
            matrix = placing.matrix_at(np.zeros(3))
        except (CRSError, ProjError):
            continue
        if np.isfinite(matrix).all():
            return placing
    return Placing(origin, None, stated)
