"""The values that flow through a build: survey, cloud, mesh.

Two frames occur, and only two:

*CRS frame*
    Easting, northing, height (metres, float64) in the survey's own coordinate reference system.
    Only :class:`Survey` uses it.
*Scene frame*
    Metres, right-handed, **Y up** (glTF), float32 about a float64 ``origin`` (E0, N0, H0) in the
    CRS: ``x = E - E0``, ``y = H - H0``, ``z = -(N - N0)``. Everything after the clean stage uses
    it; nothing converts again until an engine adapter does.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, UInt8

__all__ = [
    "UP",
    "Cloud",
    "Crs",
    "Mesh",
    "Survey",
    "to_crs",
    "to_scene",
]


UP: Final = (0.0, 1.0, 0.0)
"""The scene frame's vertical, unit length."""


@dataclass(frozen=True, slots=True)
class Crs:
    """A coordinate reference system as the survey's file stated it."""

    name: str
    """Human name, for example ``"WGS 84 / UTM zone 18S"``."""
    wkt: str
    """Well-known text; empty when the file gave only a code."""
    epsg: int | None = None
    """EPSG code of the horizontal (or compound) system, where it is known."""


@dataclass(frozen=True, slots=True)
class Survey:
    """A coloured point cloud as read from file, nothing changed.

    All arrays have one row per point.
    """

    points: Float64
    """(N, 3) easting, northing, height in metres, CRS frame."""
    colours: UInt8 | None
    """(N, 3) sRGB, 0..255; None where the survey has no colour."""
    attributes: dict[str, npt.NDArray[np.generic]]
    """Every further per-point value by its name in the file, (N,) in the file's dtype."""
    crs: Crs | None
    format: str
    """Reader that produced it: ``las``, ``ply``, ``pcd``, ``e57``, ``ptx`` or ``xyz``."""
    warnings: tuple[str, ...] = ()
    """What the reader noticed and the user should know, whole sentences."""
    whole: tuple[str, ...] = ()
    """Attributes of whole numbers that are stored as floats, with NaN for points without a
    value."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """A cleaned, oriented point cloud in the scene frame."""

    points: Float32
    """(N, 3) metres, scene frame."""
    normals: Float32
    """(N, 3) unit, scene frame, pointing out of the ground."""
    colours: UInt8
    """(N, 3) sRGB; mid-grey everywhere when the survey had none."""
    attributes: dict[str, Float32]
    """(N,) by name; integers beyond 2^24 are refused or named in a warning by the clean stage."""
    origin: Float64
    """(3,) E0, N0, H0 in the CRS frame."""
    spacing_m: float
    """Typical distance between neighbouring samples along the surface."""
    has_colour: bool = True


@dataclass(frozen=True, slots=True)
class Mesh:
    """An indexed triangle mesh in the scene frame, one value of everything per vertex."""

    vertices: Float32
    """(V, 3) metres, scene frame."""
    faces: Int32
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    normals: Float32
    """(V, 3) unit."""
    colours: UInt8
    """(V, 3) sRGB."""
    attributes: dict[str, Float32] = field(default_factory=dict)
    """(V,) by name."""


def to_scene(points: Float64, origin: Float64) -> Float32:
    """Convert CRS coordinates to the scene frame.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Easting, northing, height in metres.
    origin : ndarray of shape (3,), float64
        E0, N0, H0.

    Returns
    -------
    ndarray of shape (N, 3), float32
        x east, y up, z south, metres about the origin. The subtraction is done in float64, so a
        UTM northing of 8e6 m loses nothing.

    Examples
    --------
    >>> origin = np.array([500000.0, 8000000.0, 100.0])
    >>> to_scene(np.array([[500010.0, 8000020.0, 130.0]]), origin).tolist()
    [[10.0, 30.0, -20.0]]
    """
    local = points - origin
    return np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1).astype(np.float32)


def to_crs(positions: AnyFloat, origin: Float64) -> Float64:
    """Convert scene positions back to the CRS frame; the inverse of :func:`to_scene`.

    Parameters
    ----------
    positions : ndarray of shape (N, 3)
        Metres, scene frame.
    origin : ndarray of shape (3,), float64
        E0, N0, H0.

    Returns
    -------
    ndarray of shape (N, 3), float64
        Easting, northing, height in metres.

    Examples
    --------
    >>> to_crs(np.array([[10.0, 30.0, -20.0]]), np.array([500000.0, 8000000.0, 100.0])).tolist()
    [[500010.0, 8000020.0, 130.0]]
    """
    local = np.asarray(positions, dtype=np.float64)
    return np.stack([local[:, 0], -local[:, 2], local[:, 1]], axis=1) + origin
