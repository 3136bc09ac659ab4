"""Between the survey's coordinates and the scene's.

Scene frame: metres, right-handed, Y up, about the float64 ``origin`` (E0, N0, H0) of the manifest:
``x = E - E0``, ``y = H - H0``, ``z = -(N - N0)``.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["to_crs", "to_scene"]

Point = tuple[float, float, float]


def to_scene(easting_northing_height: Sequence[float], origin: Sequence[float]) -> Point:
    """Convert one point of the CRS to the scene frame, in float64.

    Examples
    --------
    >>> to_scene((500010.0, 8000020.0, 130.0), (500000.0, 8000000.0, 100.0))
    (10.0, 30.0, -20.0)
    """
    easting, northing, height = easting_northing_height
    return easting - origin[0], height - origin[2], origin[1] - northing


def to_crs(position: Sequence[float], origin: Sequence[float]) -> Point:
    """Convert one scene position to easting, northing, height; the inverse of :func:`to_scene`.

    Examples
    --------
    >>> to_crs((10.0, 30.0, -20.0), (500000.0, 8000000.0, 100.0))
    (500010.0, 8000020.0, 130.0)
    """
    x, y, z = position
    return origin[0] + x, origin[1] - z, origin[2] + y
