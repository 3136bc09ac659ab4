"""Bring cameras from their file's world to the scene, and check that they look at the cloud there.

A file rarely says surely what its coordinates mean. Each frame that its reader offers is tried;
where samples of the cloud are given, that one is taken whose photos show most of them. When no
frame lets the photos see the cloud, nothing is guessed: the error says what was tried and where
cameras and cloud lie.

A projected CRS is no rigid image of the ground (UTM shrinks it by up to 0.04 %, and its north
turns); a pose is turned by the rotation nearest to the conversion at its centre, which leaves at
most 0.04 % of the distance to the middle of the picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from terraport_payload.types import Float64
from terraport_pipeline.engines.camera_files.raw_cameras import Frame, RawCameras
from terraport_pipeline.errors import PhotoError
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.view_cover import cover_points
from terraport_pipeline.model import Crs, to_crs

__all__ = ["CRS_TO_SCENE", "LEAST_SEEN", "Placed", "place_cameras"]

CRS_TO_SCENE: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes east, north, up to the scene's east, up, south."""

LEAST_SEEN: Final = 0.01
"""Share of the cloud's samples that the photos must show, else they look elsewhere."""

_FEW_SEEN: Final = 0.5
"""Below this share a warning is due."""

_MAX_SAMPLES: Final = 4000
"""Points that are projected: the share is then known within 2 %."""

_PIXELS_ACROSS: Final = 100.0
"""A photo sees a cloud only if its pixels are finer than this part of the cloud: from far enough
away every camera sees everything."""

_Turned = tuple[Float64, Float64]


@dataclass(frozen=True, slots=True)
class Placed:
    """Views in the scene frame, and how their file's frame was understood."""

    views: tuple[View, ...]
    frame: Frame
    """How the file's coordinates were understood."""
    seen: float | None
    """Share of the cloud's samples that lie in at least one photo; None without samples."""
    warnings: tuple[str, ...]


def place_cameras(
    raw: RawCameras,
    *,
    origin: Float64,
    crs: Crs | None,
    offset: tuple[float, float, float] | None = None,
    samples: Float64 | None = None,
) -> Placed:
    """Convert to the scene frame.

    Parameters
    ----------
    raw : RawCameras
    origin : ndarray of shape (3,), float64
        E0, N0, H0 of the scene.
    crs : Crs or None
        The survey's.
    offset : tuple of float, optional
        What the user says is to be added to the file's coordinates; then nothing else is tried.
    samples : ndarray of shape (N, 3), optional
        Points of the cloud, metres, scene frame. Without them the first frame that can be
        converted is taken, unchecked.

    Raises
    ------
    PhotoError
        When no frame lets the photos see the cloud.
    """
    frames = raw.frames
    if offset is not None:
        frames = (Frame("offset", "--camera-offset", offset=offset),)
    if samples is not None and len(samples) > _MAX_SAMPLES:
        samples = samples[np.linspace(0, len(samples) - 1, _MAX_SAMPLES).astype(np.int64)]
    tried: list[str] = []
    best: tuple[float, Frame, tuple[View, ...], int] | None = None
    for rank, frame in enumerate(frames):
        views = _convert(raw, frame, origin, crs, tried)
        if views is None:
            continue
        if samples is None or not len(samples):
            return Placed(views, frame, None, _height_warning(frame, crs))
        seen = _share_seen(views, samples)
        middle = np.median([view.position for view in views], axis=0)
        tried.append(f"as {frame}: around {_tell(middle, origin)}, {seen:.1%} seen")
        # an earlier frame keeps its rank unless another shows clearly more
        if best is None or seen > 1.05 * best[0] + 0.001:
            best = (seen, frame, views, rank)
    if best is None or best[0] < LEAST_SEEN:
        raise _blind(raw, tried, origin, samples)
    seen, frame, views, _ = best
    warnings = _height_warning(frame, crs)
    if seen < _FEW_SEEN:
        warning = (
            f"Only {seen:.0%} of the cloud lies in any photo (cameras taken as {frame}); the rest "
            "keeps the colour of its points."
        )
        warnings = (*warnings, warning)
    return Placed(views, frame, seen, warnings)


def _share_seen(views: tuple[View, ...], samples: Float64) -> float:
    size_m = float(np.linalg.norm(np.ptp(samples, axis=0)))
    photos, _, _ = cover_points(views, samples, coarsest_m=max(size_m, 1e-3) / _PIXELS_ACROSS)
    return float((photos > 0).mean())


def _blind(
    raw: RawCameras, tried: list[str], origin: Float64, samples: Float64 | None
) -> PhotoError:
    where = ""
    if samples is not None and len(samples):
        where = f"; the cloud lies around {_tell(np.median(samples, axis=0), origin)}"
    advice = f". {raw.format}: {raw.advice}" if raw.advice else ""
    return PhotoError(
        f"the {len(raw.cameras):,} photos do not look at the cloud. Tried: {'; '.join(tried)}"
        f"{where}. If the cameras' coordinates lack an offset, say it with "
        "--camera-offset E,N,H; if they are of another place or coordinate system, export them in "
        f"the survey's{advice}"
    )


def _tell(position: Float64, origin: Float64) -> str:
    east, north, up = to_crs(position[None], origin)[0]
    return f"E {east:,.1f}, N {north:,.1f}, H {up:,.1f} m"


def _convert(
    raw: RawCameras, frame: Frame, origin: Float64, crs: Crs | None, tried: list[str]
) -> tuple[View, ...] | None:
    centres = np.stack([camera.centre for camera in raw.cameras])
    try:
        placed, turns = _to_crs_frame(frame, centres, crs)
    except (CRSError, ProjError, _NotPossibleError) as error:
        tried.append(f"as {frame}: {' '.join(str(error).split())[:160]}")
        return None
    to_view = turns.transpose(0, 2, 1) @ CRS_TO_SCENE.T
    positions = (placed - origin) @ CRS_TO_SCENE.T
    return tuple(
        View(camera.name, camera.lens, _orthonormal(camera.rotation @ turn), position)
        for camera, turn, position in zip(raw.cameras, to_view, positions, strict=True)
    )


class _NotPossibleError(ValueError):
    """A frame that cannot be converted for this survey."""


def _to_crs_frame(frame: Frame, centres: Float64, crs: Crs | None) -> _Turned:
    """Convert centres (N, 3); give with them the rotations (N, 3, 3) of world to CRS axes."""
    if frame.kind == "offset":
        still = np.broadcast_to(np.eye(3), (len(centres), 3, 3))
        return centres + np.array(frame.offset), still
    if crs is None:
        raise _NotPossibleError("the survey states no coordinate reference system")
    target = CRS.from_wkt(crs.wkt) if crs.wkt else CRS.from_user_input(crs.epsg or crs.name)
    if frame.kind == "enu":
        assert frame.geodetic is not None  # readers give both
        datum = CRS.from_epsg(4979)
        turn, centre = _topocentric(frame.geodetic)
        return _through(lambda points: points @ turn.T + centre, datum, target, centres)
    source = CRS.from_user_input(frame.crs)
    if frame.kind == "geocentric":
        datum = source.geodetic_crs or source
        return _through(lambda points: points, datum, target, centres)
    convert = Transformer.from_crs(source, target, always_xy=True)
    steps = _degrees_a_metre(source, centres) if frame.kind == "geographic" else None
    return _linearised(
        lambda points: np.stack(convert.transform(*points.T), axis=1), centres, steps
    )


def _through(
    to_geocentric: Callable[[Float64], Float64], datum: CRS, target: CRS, centres: Float64
) -> _Turned:
    """Convert by way of Earth-centred coordinates on `datum`."""
    ellipsoid = datum.ellipsoid
    if ellipsoid is None:
        raise _NotPossibleError(f"{datum.name} has no ellipsoid")
    shape = f"+a={ellipsoid.semi_major_metre!r} +b={ellipsoid.semi_minor_metre!r}"
    to_degrees = Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=cart {shape} "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    convert = Transformer.from_crs(datum.to_3d(), target, always_xy=True)

    def whole(points: Float64) -> Float64:
        x, y, z = to_geocentric(points).T
        return np.stack(convert.transform(*to_degrees.transform(x, y, z)), axis=1)

    return _linearised(whole, centres)


def _degrees_a_metre(crs: CRS, centres: Float64) -> Float64:
    """Return steps of a metre east, north and up, (3, N, 3), of centres in degrees and metres."""
    ellipsoid = crs.ellipsoid
    if ellipsoid is None:
        raise _NotPossibleError(f"{crs.name} has no ellipsoid")
    if (np.abs(centres[:, 1]) > 89.0).any() or (np.abs(centres[:, 0]) > 360.0).any():
        raise _NotPossibleError("the coordinates are no degrees")
    a, b = ellipsoid.semi_major_metre, ellipsoid.semi_minor_metre
    latitude, height = np.radians(centres[:, 1]), centres[:, 2]
    # Radii of curvature along the parallel and the meridian.
    across = a**2 / np.hypot(a * np.cos(latitude), b * np.sin(latitude))
    along = across**3 * (b / a) ** 2 / a**2
    steps = np.zeros((3, len(centres), 3))
    steps[0, :, 0] = np.degrees(1.0 / ((across + height) * np.cos(latitude)))
    steps[1, :, 1] = np.degrees(1.0 / (along + height))
    steps[2, :, 2] = 1.0
    return steps


def _linearised(
    convert: Callable[[Float64], Float64], centres: Float64, steps: Float64 | None = None
) -> _Turned:
    """Convert centres and, by steps of a metre along each axis, directions."""
    placed = convert(centres)
    one_metre = np.eye(3)[:, None, :] if steps is None else steps
    columns = [0.5 * (convert(centres + step) - convert(centres - step)) for step in one_metre]
    slopes = np.stack(columns, axis=2)
    if not (np.isfinite(placed).all() and np.isfinite(slopes).all()):
        raise _NotPossibleError("the coordinates are outside what the survey's CRS can say")
    left, size, right = np.linalg.svd(slopes)
    turns = left @ right
    if (np.linalg.det(turns) < 0.0).any() or not (np.abs(size - 1.0) < 0.2).all():
        raise _NotPossibleError("the coordinates are no metres in the survey's CRS")
    return placed, turns


def _topocentric(origin: tuple[float, float, float]) -> _Turned:
    """Rotation and shift of metres east, north, up to Earth-centred WGS 84."""
    latitude, longitude = np.radians(origin[:2])
    to_cart = Transformer.from_pipeline("+proj=cart +ellps=WGS84")
    centre = np.array(to_cart.transform(longitude, latitude, origin[2], radians=True))
    (ca, so, co, sa) = np.cos(latitude), np.sin(longitude), np.cos(longitude), np.sin(latitude)
    turn = np.array([[-so, -sa * co, ca * co], [co, -sa * so, ca * so], [0.0, ca, sa]])
    return turn, centre


def _orthonormal(rotation: Float64) -> Float64:
    """Remove the rounding that files and products bring."""
    left, _, right = np.linalg.svd(rotation)
    nearest: Float64 = left @ right
    return nearest


def _height_warning(frame: Frame, crs: Crs | None) -> tuple[str, ...]:
    if frame.kind == "offset" or crs is None or not crs.wkt:
        return ()
    if not CRS.from_wkt(crs.wkt).is_compound:
        return ()
    warning = (
        f"The cameras' heights come from {frame.source} above the ellipsoid, the survey's "
        f"({crs.name}) above a geoid; where PROJ has no grid for it the cameras are too high or "
        "low by the geoid's height. Export the cameras in the survey's own system to be sure."
    )
    return (warning,)
