"""Cameras for pictures: where a pixel's ray starts and goes, and where a point falls.

Scene frame throughout (metres, right-handed, Y up). A camera looks along ``forward``; pixel (0, 0)
is the upper left. ``azimuth`` is the compass bearing the camera looks *towards*, in degrees: 0 is
north (-z), 90 east (+x).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyFloat, Bool, Float32, Float64, Int32
from terraport_pipeline.geometry.photos.lens import View

__all__ = ["Camera", "PhotoCamera", "eye_level", "oblique", "top_down"]

FIELD_OF_VIEW_DEG: Final = 40.0
"""Vertical opening of the overview pictures: little distortion, still some depth."""

EYE_FIELD_OF_VIEW_DEG: Final = 65.0
"""Vertical opening at eye height: near what a headset shows of the middle of its picture."""

NEAR_M: Final = 0.05
"""Points nearer than this to the camera's plane are not projected."""

_SIGHT_MARGIN: Final = 1e-3
"""Share by which the picture is taken larger where faces beside it are left out."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole or a parallel projection, given by its eye and three axes."""

    kind: Literal["perspective", "orthographic"]
    eye: tuple[float, float, float]
    """Metres; for a parallel projection the middle of the picture plane."""
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    forward: tuple[float, float, float]
    """Right, up and forward are unit and mutually orthogonal."""
    half_height: float
    """Perspective: tangent of half the vertical opening. Orthographic: metres."""

    def rays(self, width: int, height: int, rows: slice = slice(None)) -> tuple[Float32, Float32]:
        """Make one ray through the middle of each pixel, row by row.

        Parameters
        ----------
        width, height : int
            Pixels.
        rows : slice
            Of the picture; all of them by default.

        Returns
        -------
        origins, directions : ndarray of shape (R * width, 3), float32
            Of R rows. Metres; directions have unit length.
        """
        half_width = self.half_height * width / height
        across = (2 * (np.arange(width) + 0.5) / width - 1) * half_width
        down = (1 - 2 * (np.arange(height)[rows] + 0.5) / height) * self.half_height
        right, up, forward = (np.array(axis) for axis in (self.right, self.up, self.forward))
        offsets = across[None, :, None] * right + down[:, None, None] * up
        eye = np.array(self.eye)
        if self.kind == "orthographic":
            origins = eye + offsets
            headings = np.broadcast_to(forward, offsets.shape)
        else:
            origins = np.broadcast_to(eye, offsets.shape)
            headings = offsets + forward
            headings = headings / np.linalg.norm(headings, axis=-1, keepdims=True)
        return (
            origins.reshape(-1, 3).astype(np.float32),
            headings.reshape(-1, 3).astype(np.float32),
        )

    def pixel_m(self, distance_m: Float32, height: int) -> Float32:
        """Return how wide a pixel is at hits so far along their rays, (R,) metres."""
        size = np.float32(2 * self.half_height / height)
        if self.kind == "orthographic":
            return np.full(len(distance_m), size, dtype=np.float32)
        result: Float32 = distance_m * size
        return result

    def may_see(self, vertices: AnyFloat, faces: Int32, aspect: float) -> Bool:
        """Tell which faces may be in the picture: no ray of it meets any other.

        Parameters
        ----------
        vertices : ndarray of shape (V, 3)
            Metres, scene frame.
        faces : ndarray of shape (F, 3), int32
        aspect : float
            Width over height of the picture.

        Returns
        -------
        ndarray of shape (F,), bool
            False where all three vertices lie beyond the same side of the picture, or behind the
            eye; a face beyond a corner may count as seen.
        """
        local = np.asarray(vertices, dtype=np.float32) - np.array(self.eye, np.float32)
        depth = local @ np.array(self.forward, np.float32)
        # Half width and height of the picture where the vertex is, a little larger for rounding.
        half = np.float32(self.half_height * (1 + _SIGHT_MARGIN)) * (
            depth if self.kind == "perspective" else np.ones_like(depth)
        )
        beyond = (depth < 0).astype(np.uint8)
        for axis, reach, bit in ((self.right, half * np.float32(aspect), 2), (self.up, half, 8)):
            across = local @ np.array(axis, np.float32)
            beyond |= np.where(across < -reach, bit, 0).astype(np.uint8)
            beyond |= np.where(across > reach, 2 * bit, 0).astype(np.uint8)
        first, second, third = beyond[faces.T]
        seen: Bool = (first & second & third) == 0
        return seen

    def project(
        self, points: AnyFloat, width: int, height: int
    ) -> tuple[Float64, Float64, Float64]:
        """Find where points fall in the picture.

        Parameters
        ----------
        points : ndarray of shape (N, 3)
            Metres, scene frame.
        width, height : int
            Pixels.

        Returns
        -------
        column, row : ndarray of shape (N,), float64
            Pixel coordinates, (0, 0) the upper left corner of the upper left pixel; NaN for points
            behind a pinhole.
        depth : ndarray of shape (N,), float64
            Metres along ``forward``.
        """
        local = np.asarray(points, dtype=np.float64) - np.array(self.eye)
        depth = local @ np.array(self.forward)
        scale = np.ones_like(depth)
        if self.kind == "perspective":
            scale = np.where(depth > NEAR_M, depth, np.nan)
        x = local @ np.array(self.right) / (scale * self.half_height * width / height)
        y = local @ np.array(self.up) / (scale * self.half_height)
        return (x + 1) / 2 * width, (1 - y) / 2 * height, depth


@dataclass(frozen=True, slots=True, eq=False)
class PhotoCamera:
    """The camera that took a photo, distortion and all: draws what the photo shows."""

    view: View
    window: tuple[float, float, float, float] | None = None
    """Part of the photo that is drawn: left, top, width, height in its pixels; None: all of it."""
    kind: Literal["perspective"] = "perspective"

    @property
    def eye(self) -> tuple[float, float, float]:
        """The projection centre, metres."""
        x, y, z = self.view.position.tolist()
        return (x, y, z)

    def rays(self, width: int, height: int, rows: slice = slice(None)) -> tuple[Float32, Float32]:
        """Make one ray through the middle of each pixel; see :meth:`Camera.rays`.

        A pixel beyond the lens's valid radius looks straight up.
        """
        left, top, wide, high = self._window
        column, row = np.meshgrid(
            left + (np.arange(width) + 0.5) * (wide / width),
            top + (np.arange(height)[rows] + 0.5) * (high / height),
        )
        pixels = np.stack([column.ravel(), row.ravel()], axis=1)
        headings = self.view.lens.unproject(pixels) @ self.view.rotation
        headings[~np.isfinite(headings).all(axis=1)] = (0.0, 1.0, 0.0)
        origins = np.broadcast_to(self.view.position, headings.shape)
        return origins.astype(np.float32), headings.astype(np.float32)

    def pixel_m(self, distance_m: Float32, height: int) -> Float32:
        """Return how wide a pixel is at hits so far along their rays, (R,) metres."""
        result: Float32 = distance_m / np.float32(self.view.lens.fy * height / self._window[3])
        return result

    @property
    def _window(self) -> tuple[float, float, float, float]:
        return self.window or (0.0, 0.0, float(self.view.lens.width), float(self.view.lens.height))


def top_down(points: AnyFloat, *, aspect: float, margin: float = 0.03) -> Camera:
    """Look straight down on everything, north up.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        What must be in the picture: vertices, or the two corners of a box. N >= 1.
    aspect : float
        Width over height of the picture.
    margin : float
        Empty share on each side.

    Returns
    -------
    Camera
        Orthographic.
    """
    low, high = _bounds(points)
    middle = (low + high) / 2
    half_width, half_depth = (high - low)[[0, 2]] / 2
    half = max(half_depth, half_width / aspect, 1e-3) * (1 + 2 * margin)
    rise = max(float(high[1] - low[1]), 1.0)
    eye = (float(middle[0]), float(high[1] + rise), float(middle[2]))
    return Camera("orthographic", eye, (1, 0, 0), (0, 0, -1), (0, -1, 0), float(half))


def oblique(
    points: AnyFloat,
    *,
    aspect: float,
    azimuth_deg: float = 30.0,
    elevation_deg: float = 35.0,
    margin: float = 0.03,
) -> Camera:
    """Look at everything from above and aside, as near as it still fits.

    Parameters
    ----------
    points : ndarray of shape (N, 3)
        What must be in the picture; a few thousand vertices frame tighter than a box does.
    aspect : float
        Width over height of the picture.
    azimuth_deg : float
        Compass bearing of the view.
    elevation_deg : float
        How far above the horizon the camera stands, seen from the middle.
    margin : float
        Empty share on each side.

    Returns
    -------
    Camera
        Perspective.
    """
    right, up, forward = _axes(azimuth_deg, -elevation_deg)
    half_height = float(np.tan(np.radians(FIELD_OF_VIEW_DEG) / 2))
    low, high = _bounds(points)
    middle = (low + high) / 2
    local = (np.asarray(points, np.float64) - middle) @ np.stack([right, up, forward], axis=1)
    x, y, depth = local.T
    opening_x, opening_y = half_height * aspect / (1 + margin), half_height / (1 + margin)
    # A point is inside when |x - cx| <= (depth - c) * opening. Left and right (and top and bottom)
    # each bound c + cx / opening and c - cx / opening; their mean gives c, their difference cx.
    left, rightmost = np.max(-x / opening_x - depth), np.max(x / opening_x - depth)
    bottom, top = np.max(-y / opening_y - depth), np.max(y / opening_y - depth)
    distance = max((left + rightmost) / 2, (bottom + top) / 2, float(np.max(-depth)) + 1.0)
    shift_x, shift_y = (rightmost - left) / 2 * opening_x, (top - bottom) / 2 * opening_y
    eye = middle + right * shift_x + up * shift_y - forward * distance
    return _camera("perspective", eye, right, up, forward, half_height)


def eye_level(position: npt.ArrayLike, *, azimuth_deg: float, pitch_deg: float = -8.0) -> Camera:
    """Look around from a place, as a visitor would.

    Parameters
    ----------
    position : array_like of shape (3,)
        The eye (not the feet), metres.
    azimuth_deg : float
        Compass bearing of the view.
    pitch_deg : float
        Above (+) or below (-) the horizon.

    Returns
    -------
    Camera
        Perspective.
    """
    right, up, forward = _axes(azimuth_deg, pitch_deg)
    half_height = float(np.tan(np.radians(EYE_FIELD_OF_VIEW_DEG) / 2))
    return _camera("perspective", np.asarray(position, np.float64), right, up, forward, half_height)


def _bounds(points: AnyFloat) -> tuple[Float64, Float64]:
    if len(points) == 0:
        raise ValueError("received no points, expected at least one to frame")
    array = np.asarray(points, dtype=np.float64)
    return array.min(axis=0), array.max(axis=0)


def _axes(azimuth_deg: float, pitch_deg: float) -> tuple[Float64, Float64, Float64]:
    bearing, pitch = np.radians(azimuth_deg), np.radians(pitch_deg)
    forward = np.array(
        [np.sin(bearing) * np.cos(pitch), np.sin(pitch), -np.cos(bearing) * np.cos(pitch)]
    )
    right = np.array([np.cos(bearing), 0.0, np.sin(bearing)])
    return right, np.cross(right, forward), forward


def _camera(
    kind: Literal["perspective", "orthographic"],
    eye: Float64,
    right: Float64,
    up: Float64,
    forward: Float64,
    half_height: float,
) -> Camera:
    def triple(vector: Float64) -> tuple[float, float, float]:
        return float(vector[0]), float(vector[1]), float(vector[2])

    return Camera(kind, triple(eye), triple(right), triple(up), triple(forward), half_height)
