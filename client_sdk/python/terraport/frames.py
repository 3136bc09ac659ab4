"""Between the survey's coordinates and the scene's.

Scene frame: metres, right-handed, Y up, about the float64 ``origin`` (E0, N0, H0) of the manifest:
``x = E - E0``, ``y = H - H0``, ``z = -(N - N0)``, with E, N and H in metres. A survey in feet has
``survey_units`` in its manifest: metres in one of its units.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

__all__ = ["to_crs", "to_scene"]

Point = tuple[float, float, float]


def to_scene(
    easting_northing_height: Sequence[float],
    origin: Sequence[float],
    survey_units: Mapping[str, float] | None = None,
) -> Point:
    """Convert one point as the survey has it to the scene frame, in float64.

    Parameters
    ----------
    easting_northing_height : sequence of float
        In the survey's own units.
    origin : sequence of float
        The manifest's, metres.
    survey_units : mapping, optional
        The manifest's; None, as there: metres.

    Examples
    --------
    >>> to_scene((500010.0, 8000020.0, 130.0), (500000.0, 8000000.0, 100.0))
    (10.0, 30.0, -20.0)
    >>> to_scene((10.0, 0.0, 30.0), (0.0, 0.0, 0.0), {"horizontal_m": 0.3048, "height_m": 1.0})
    (3.048, 30.0, 0.0)
    """
    easting, northing, height = easting_northing_height
    horizontal_m, height_m = _metres(survey_units)
    return (
        easting * horizontal_m - origin[0],
        height * height_m - origin[2],
        origin[1] - northing * horizontal_m,
    )


def to_crs(
    position: Sequence[float],
    origin: Sequence[float],
    survey_units: Mapping[str, float] | None = None,
) -> Point:
    """Convert one scene position to easting, northing, height; the inverse of :func:`to_scene`.

    Examples
    --------
    >>> to_crs((10.0, 30.0, -20.0), (500000.0, 8000000.0, 100.0))
    (500010.0, 8000020.0, 130.0)
    """
    x, y, z = position
    horizontal_m, height_m = _metres(survey_units)
    return (
        (origin[0] + x) / horizontal_m,
        (origin[1] - z) / horizontal_m,
        (origin[2] + y) / height_m,
    )


def _metres(survey_units: Mapping[str, float] | None) -> tuple[float, float]:
    if survey_units is None:
        return 1.0, 1.0
    return survey_units["horizontal_m"], survey_units["height_m"]
