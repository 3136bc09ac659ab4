"""Conversion between the survey's coordinates and the scene frame.

Scene frame: metres, right-handed, Y up, about the float64 ``origin`` (E0, N0, H0) of the manifest:
``x = E - E0``, ``y = H - H0``, ``z = -(N - N0)``, with E, N and H in metres. A survey that is not
in metres east, north and up has ``survey_units`` in its manifest: metres in one of its units, and
the directions of its x, y and z.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from terraport_payload import SegmentMesh
from terraport_payload.types import AnyArray, Float64

__all__ = ["crs_positions", "to_crs", "to_scene"]

Point = tuple[float, float, float]
Points = Float64

_AXES: Final = ("east", "north", "up")
_COLUMN: Final = {"east": 0, "west": 0, "north": 1, "south": 1, "up": 2, "down": 2}
_BACKWARDS: Final = frozenset({"west", "south", "down"})


def to_scene(
    coordinates: Sequence[float] | AnyArray,
    origin: Sequence[float],
    survey_units: Mapping[str, Any] | None = None,
) -> Any:
    """Convert coordinates of the survey to the scene frame, in float64.

    Parameters
    ----------
    coordinates : sequence of 3 numbers, or ndarray of shape (N, 3)
        x, y, z (mostly easting, northing, height) in the survey's own units and along its own axes.
    origin : sequence of float
        ``origin`` of the manifest, metres.
    survey_units : mapping, optional
        ``survey_units`` of the manifest; None means metres east, north and up.

    Returns
    -------
    tuple of 3 floats, or ndarray of shape (N, 3), float64

    Examples
    --------
    >>> to_scene((500010.0, 8000020.0, 130.0), (500000.0, 8000000.0, 100.0))
    (10.0, 30.0, -20.0)
    >>> to_scene((10.0, 0.0, 30.0), (0.0, 0.0, 0.0), {"horizontal_m": 0.3048, "height_m": 1.0})
    (3.048, 30.0, 0.0)
    """
    given, is_one = _rows(coordinates)
    metres = np.empty_like(given)
    for column, (target, unit_m) in enumerate(_axes(survey_units)):
        metres[:, target] = given[:, column] * unit_m
    east, north, height = (metres - np.asarray(origin, np.float64)).T
    return _result(np.stack([east, height, -north], axis=1), is_one)


def to_crs(
    position: Sequence[float] | AnyArray,
    origin: Sequence[float],
    survey_units: Mapping[str, Any] | None = None,
) -> Any:
    """Convert scene positions to coordinates of the survey, in float64.

    The inverse of :func:`to_scene`, with the same parameters: one position, or (N, 3) of any type.

    Examples
    --------
    >>> to_crs((10.0, 30.0, -20.0), (500000.0, 8000000.0, 100.0))
    (500010.0, 8000020.0, 130.0)
    >>> to_crs(np.float32([[10.0, 30.0, -20.5]]), (500000.0, 8000000.0, 100.0)).tolist()
    [[500010.0, 8000020.5, 130.0]]
    """
    given, is_one = _rows(position)
    x, y, z = given.T
    metres = np.stack([x, -z, y], axis=1) + np.asarray(origin, np.float64)
    result = np.empty_like(metres)
    for column, (target, unit_m) in enumerate(_axes(survey_units)):
        result[:, column] = metres[:, target] / unit_m
    return _result(result, is_one)


def crs_positions(mesh: SegmentMesh, manifest: Mapping[str, Any]) -> Points:
    """Return the vertices of a mesh as coordinates of the survey.

    Parameters
    ----------
    mesh : SegmentMesh
        ``segment.arrays()``, or the ``mesh`` of the base.
    manifest : mapping
        ``await session.manifest()``.

    Returns
    -------
    ndarray of shape (V, 3), float64
        In the survey's own units, along its own axes (mostly easting, northing, height).
    """
    positions: Points = to_crs(mesh.positions, manifest["origin"], manifest.get("survey_units"))
    return positions


def _rows(values: Sequence[float] | AnyArray) -> tuple[Points, bool]:
    """Return values as (N, 3) float64, and True if they are a single position."""
    given = np.asarray(values, np.float64)
    if given.ndim not in (1, 2) or given.shape[-1] != 3:
        raise ValueError(f"got positions of shape {given.shape}, expected (3,) or (N, 3)")
    return np.atleast_2d(given), given.ndim == 1


def _result(values: Points, is_one: bool) -> Point | Points:
    if not is_one:
        return values
    x, y, z = (values[0] + 0.0).tolist()  # + 0.0: no -0.0
    return x, y, z


def _axes(survey_units: Mapping[str, Any] | None) -> list[tuple[int, float]]:
    """Return the column (easting, northing, height) and metres per unit of the survey's x, y, z."""
    units = survey_units or {"horizontal_m": 1.0, "height_m": 1.0}
    lengths = (units["horizontal_m"], units["horizontal_m"], units["height_m"])
    axes = units.get("axes") or _AXES
    return [
        (_COLUMN[axis], -unit_m if axis in _BACKWARDS else unit_m)
        for axis, unit_m in zip(axes, lengths, strict=True)
    ]
