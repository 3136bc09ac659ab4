"""Lenses and views: where a point falls in a photo, and which ray a pixel looks along.

Three steps lead from a point of the camera frame (x right, y down, z forward) to a pixel:

1. *Direction*: ``(a, b) = (x / z, y / z)`` for an ordinary lens; a fisheye's is as long as the
   angle to the axis, ``(a, b) = (x, y) / r * atan2(r, z)`` with ``r = hypot(x, y)``.
2. *Distortion* (Brown), with ``q = a^2 + b^2``::

       m = (1 + k1 q + k2 q^2 + .. + k6 q^6) / (1 + k4' q + k5' q^2 + k6' q^3)
       a' = a m + 2 p1 a b + p2 (q + 2 a^2)
       b' = b m + p1 (q + 2 b^2) + 2 p2 a b

3. *Sensor*: ``u = fx a' + skew b' + cx``, ``v = fy b' + cy``, where the centre of the top
   left pixel is (0.5, 0.5), as in COLMAP, Agisoft and OpenGL.

Beyond some radius a distortion polynomial folds back: it is a fit that means nothing out there, and
would show a house far outside in the middle of the photo. :func:`valid_radius` finds where; points
beyond are no part of the photo.

PURE: no I/O, no clock.

References
----------
D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971. J. Kannala,
S. Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye
lenses", IEEE PAMI 28(8), 2006. Names and order of the coefficients as in OpenCV's ``calib3d``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from terraport_payload.types import AnyFloat, Float64
from terraport_pipeline.geometry.photos import lens_kernels as kernels
from terraport_pipeline.geometry.photos.lens_kernels import PACKED, project_packed, ray_packed

__all__ = ["PACKED", "Lens", "View", "project_packed", "ray_packed", "valid_radius"]

_MAX_RADIUS: Final = {"radial": float(np.tan(np.radians(89.0))), "fisheye": 0.5 * float(np.pi)}
"""Nothing is projected further from the axis than 89 (fisheye: 90) degrees."""

_LEAST: Final = 1e-30
"""Leading coefficients below this do nothing within 89 degrees, and overflow the root finder."""

_RINGS: Final = 2048
_SPOKES: Final = 72
"""Where a lens with tangential terms is searched for its first fold."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Interior orientation of a camera, pixels.

    Raises
    ------
    ValueError
        A number that is not finite, no pixels, a focal length that is not positive, or more
        coefficients than the model has.

    Examples
    --------
    >>> lens = Lens(width=400, height=300, fx=200.0, fy=200.0, cx=200.0, cy=150.0)
    >>> lens.project(np.array([[0.5, 0.0, 1.0], [0.0, 0.0, -1.0]])).tolist()
    [[300.0, 150.0], [nan, nan]]
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    """Principal point; the middle of the picture is ``(width / 2, height / 2)``."""
    model: Literal["radial", "fisheye"] = "radial"
    radial: tuple[float, ...] = ()
    """k1, k2, .. of the polynomial, up to six."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """p1, p2 in OpenCV's order (Agisoft's is the other way round)."""
    skew: float = 0.0
    denominator: tuple[float, ...] = ()
    """k4, k5, k6 of OpenCV's rational model."""

    def __post_init__(self) -> None:
        """Refuse sizes, focal lengths and coefficients that project nothing."""
        numbers = [self.fx, self.fy, self.cx, self.cy, self.skew]
        numbers += [*self.radial, *self.tangential, *self.denominator]
        if not np.isfinite(numbers).all():
            raise ValueError(f"a lens of finite numbers expected, got {self!r}")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"a picture of {self.width} x {self.height} pixels has no pixels")
        if self.fx <= 0.0 or self.fy <= 0.0:
            raise ValueError(f"focal lengths above 0 expected, got {self.fx:g} and {self.fy:g}")
        if self.model not in _MAX_RADIUS:
            raise ValueError(f"model 'radial' or 'fisheye' expected, got {self.model!r}")
        for name, terms, most in (
            ("radial", self.radial, kernels.MAX_RADIAL),
            ("denominator", self.denominator, kernels.MAX_DENOMINATOR),
        ):
            if len(terms) > most:
                raise ValueError(f"at most {most} {name} coefficients expected, got {len(terms)}")
        if len(self.tangential) != 2:
            raise ValueError(f"two tangential coefficients expected, got {self.tangential!r}")

    def project(self, points: AnyFloat) -> Float64:
        """Project points of the camera frame.

        Parameters
        ----------
        points : ndarray of shape (N, 3)
            Metres: x right, y down, z forward.

        Returns
        -------
        ndarray of shape (N, 2), float64
            Pixels, also beyond the picture's edge; NaN where ``z <= 0`` or the lens folds back.
        """
        return kernels.project_rows(_pack_lens(self).copy(), _rows(points, 3))[:, :2]

    def unproject(self, pixels: AnyFloat) -> Float64:
        """Find the direction that a pixel looks along; the inverse of :meth:`project`.

        Parameters
        ----------
        pixels : ndarray of shape (N, 2)

        Returns
        -------
        ndarray of shape (N, 3), float64
            Unit, camera frame; NaN where no direction within the valid radius gives the pixel.
        """
        return kernels.unproject_rows(_pack_lens(self).copy(), _rows(pixels, 2))

    def scaled(self, width: int, height: int) -> Lens:
        """Return the lens of the same photo stored at another size.

        Parameters
        ----------
        width, height : int
            Pixels; sides may scale differently.
        """
        across, down = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * across,
            fy=self.fy * down,
            cx=self.cx * across,
            cy=self.cy * down,
            skew=self.skew * across,
        )


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One photo: a lens somewhere in the scene."""

    name: str
    """File name as the cameras' file gives it; may have folders before it."""
    lens: Lens
    rotation: Float64
    """(3, 3), scene frame to camera frame; its rows are the camera's right, down and forward."""
    position: Float64
    """(3,) projection centre, metres, scene frame."""

    def __post_init__(self) -> None:
        """Refuse a matrix that does not rotate and a place that is none."""
        rotation = np.asarray(self.rotation, dtype=np.float64)
        position = np.asarray(self.position, dtype=np.float64)
        if rotation.shape != (3, 3) or position.shape != (3,):
            raise ValueError(
                f"{self.name}: a rotation (3, 3) and a position (3,) expected, got "
                f"{rotation.shape} and {position.shape}"
            )
        if not np.isfinite(position).all():
            raise ValueError(f"{self.name}: a finite position expected, got {position.tolist()}")
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not error < 1e-6 or np.linalg.det(rotation) < 0.0:
            raise ValueError(
                f"{self.name}: a rotation without mirroring expected, got {rotation.tolist()}"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position", position)

    def project(self, points: AnyFloat) -> tuple[Float64, Float64]:
        """Project points of the scene.

        Parameters
        ----------
        points : ndarray of shape (N, 3)
            Metres, scene frame.

        Returns
        -------
        pixels : ndarray of shape (N, 2), float64
            As :meth:`Lens.project`.
        depth_m : ndarray of shape (N,), float64
            Along the axis; not positive behind the camera.
        """
        rows = kernels.project_rows(self.packed(), _rows(points, 3))
        return rows[:, :2], rows[:, 2]

    def rays(self, pixels: AnyFloat) -> Float64:
        """Find the directions that pixels look along.

        Parameters
        ----------
        pixels : ndarray of shape (N, 2)

        Returns
        -------
        ndarray of shape (N, 3), float64
            Unit, scene frame; NaN as in :meth:`Lens.unproject`.
        """
        rays: Float64 = self.lens.unproject(pixels) @ self.rotation
        return rays

    def packed(self) -> Float64:
        """Pack into one row for :func:`project_packed` and :func:`ray_packed`.

        Returns
        -------
        ndarray of shape (PACKED,), float64
            A new array.
        """
        row = _pack_lens(self.lens).copy()
        row[kernels.ROTATION : kernels.POSITION] = self.rotation.ravel()
        row[kernels.POSITION : kernels.POSITION + 3] = self.position
        return row


def valid_radius(lens: Lens) -> float:
    """Find how far from its axis a lens maps directions one to one.

    Parameters
    ----------
    lens : Lens

    Returns
    -------
    float
        Largest length of ``(a, b)`` (see the module): a tangent, or for a fisheye an angle in
        radians. Never beyond 89 degrees, or 90 for a fisheye.

    Notes
    -----
    Radial terms alone: the least positive root of the derivative of ``r m(r^2)`` or of the
    denominator, exactly. With tangential terms: the first ring of a fine mesh on which the
    determinant of the Jacobian is not positive somewhere.
    """
    most = _MAX_RADIUS[lens.model]
    above = np.polynomial.Polynomial((1.0, *lens.radial))
    below = np.polynomial.Polynomial((1.0, *lens.denominator))
    square = np.polynomial.Polynomial((0.0, 2.0))
    slope = above * below + square * (above.deriv() * below - above * below.deriv())
    for one in (slope, below):
        roots = np.asarray(one.trim(_LEAST).roots(), dtype=np.complex128)
        real = roots.real[(np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))) & (roots.real > 0.0)]
        if len(real):
            most = min(most, float(np.sqrt(real.min())))
    if lens.tangential == (0.0, 0.0):
        return most
    row = _pack(lens, most)
    last = most if lens.model == "fisheye" else float(np.arctan(most))
    rings = np.linspace(0.0, last, _RINGS + 1)[1:]
    radii = rings if lens.model == "fisheye" else np.tan(rings)
    folded = int(kernels.first_fold(row, radii, _SPOKES))
    if folded == len(radii):
        return most
    return float(radii[folded - 1]) if folded else 0.0


@lru_cache(maxsize=4096)
def _pack_lens(lens: Lens) -> Float64:
    """Pack a lens; the view's places hold the identity."""
    row = _pack(lens, valid_radius(lens))
    row.setflags(write=False)
    return row


def _pack(lens: Lens, limit: float) -> Float64:
    row = np.zeros(PACKED)
    row[: kernels.HEIGHT + 1] = (
        float(lens.model == "fisheye"),
        lens.fx, lens.fy, lens.cx, lens.cy, lens.skew, lens.width, lens.height,
    )  # fmt: skip
    row[kernels.RADIAL : kernels.RADIAL + len(lens.radial)] = lens.radial
    row[kernels.DENOMINATOR : kernels.DENOMINATOR + len(lens.denominator)] = lens.denominator
    row[kernels.P1], row[kernels.P2] = lens.tangential
    row[kernels.LIMIT] = limit
    row[kernels.ROTATION : kernels.POSITION] = np.eye(3).ravel()
    return row


def _rows(values: AnyFloat, width: int) -> Float64:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != width:
        raise ValueError(f"an array of shape (N, {width}) expected, got {array.shape}")
    return array
