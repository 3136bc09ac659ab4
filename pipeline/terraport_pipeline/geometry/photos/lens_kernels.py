"""Kernels of :mod:`terraport_pipeline.geometry.photos.lens`, which states the model.

They work on one row of numbers per view, so that other kernels can project millions of texels
without touching Python.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64

__all__ = [
    "CX", "CY", "DENOMINATOR", "FX", "FY", "HEIGHT", "KIND", "LIMIT", "MAX_DENOMINATOR",
    "MAX_RADIAL", "P1", "P2", "PACKED", "POSITION", "RADIAL", "ROTATION", "SKEW", "WIDTH",
    "first_fold", "project_packed", "project_rows", "ray_packed", "unproject_rows",
]  # fmt: skip

PACKED: Final = 34
"""Numbers of one packed view. Their places follow; others may want ``WIDTH`` and ``HEIGHT``."""

KIND, FX, FY, CX, CY, SKEW, WIDTH, HEIGHT = range(8)
RADIAL, DENOMINATOR, P1, P2, LIMIT = 8, 14, 17, 18, 19
ROTATION, POSITION = 20, 29

MAX_RADIAL: Final = 6
MAX_DENOMINATOR: Final = 3

_NEWTON_STEPS: Final = 60
_NEWTON_TOLERANCE: Final = 1e-13
"""Unprojection ends when a step is shorter than this (tangent units, relative beyond 1): below
1e-9 pixels for any lens."""

_HALVINGS: Final = 30
_NEAR: Final = 1e-12
"""A direction this near the goal counts as found when no step leads nearer."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_packed(packed: Float64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Project one point of the scene, for kernels.

    Parameters
    ----------
    packed : ndarray of shape (PACKED,), float64
        From :meth:`View.packed`.
    x, y, z : float
        Metres, scene frame.

    Returns
    -------
    u, v, depth_m : float
        Pixels (NaN where the photo cannot see the point) and depth along the axis.
    """
    # (1) Into the camera's axes; behind it there is no picture.
    dx = x - packed[POSITION]
    dy = y - packed[POSITION + 1]
    dz = z - packed[POSITION + 2]
    r = ROTATION
    a = packed[r] * dx + packed[r + 1] * dy + packed[r + 2] * dz
    b = packed[r + 3] * dx + packed[r + 4] * dy + packed[r + 5] * dz
    depth = packed[r + 6] * dx + packed[r + 7] * dy + packed[r + 8] * dz
    if not depth > 0.0:
        return np.nan, np.nan, depth
    radius = np.hypot(a, b)
    # (2) Onto the plane at distance 1, or a fisheye's angle.
    if packed[KIND] == 0.0:
        a /= depth
        b /= depth
        radius /= depth
    else:
        angle = np.arctan2(radius, depth)
        scale = angle / radius if radius > 0.0 else 1.0 / depth
        a *= scale
        b *= scale
        radius = angle
    # (3) Beyond the valid radius the distortion folds back: no pixel there can be trusted.
    if not radius <= packed[LIMIT]:
        return np.nan, np.nan, depth
    a, b, _, _, _, _ = _distort(packed, a, b)
    u = packed[FX] * a + packed[SKEW] * b + packed[CX]
    v = packed[FY] * b + packed[CY]
    return u, v, depth


@numba.njit(cache=True, nogil=True, error_model="numpy")
def ray_packed(packed: Float64, u: float, v: float) -> tuple[float, float, float]:
    """Find the direction a pixel looks along, for kernels.

    Parameters
    ----------
    packed : ndarray of shape (PACKED,), float64
    u, v : float
        Pixels.

    Returns
    -------
    x, y, z : float
        Unit, scene frame; NaN where nothing within the valid radius gives the pixel.

    Notes
    -----
    Newton's method within the valid radius, where the map is one to one: first along the radius
    without tangential terms (kept in a bracket), then in the plane, each step halved until it leads
    nearer the goal.
    """
    # (1) From pixels to the distorted point of the unit picture plane; the start along the
    # radius.
    goal_b = (v - packed[CY]) / packed[FY]
    goal_a = (u - packed[CX] - packed[SKEW] * goal_b) / packed[FX]
    a, b = _along_radius(packed, goal_a, goal_b)
    converged = False
    # (2) Newton with halved steps. Invariant: a, b lies within the valid radius, and `miss` is
    # how far its image is from the goal; it only falls.
    da, db, aa, ab, ba, bb = _distort(packed, a, b)
    miss = np.hypot(da - goal_a, db - goal_b)
    for _ in range(_NEWTON_STEPS):
        det = aa * bb - ab * ba
        if not det > 0.0:
            break
        step_a = (bb * (da - goal_a) - ab * (db - goal_b)) / det
        step_b = (aa * (db - goal_b) - ba * (da - goal_a)) / det
        if max(abs(step_a), abs(step_b)) <= _NEWTON_TOLERANCE * max(1.0, abs(a), abs(b)):
            converged = True
            break
        share = 1.0
        for _ in range(_HALVINGS):
            try_a, try_b = _within(a - share * step_a, b - share * step_b, packed[LIMIT])
            da, db, aa, ab, ba, bb = _distort(packed, try_a, try_b)
            new_miss = np.hypot(da - goal_a, db - goal_b)
            if new_miss < miss:
                break
            share *= 0.5
        if not new_miss < miss:  # as near as numbers go, or stuck at the limit
            converged = miss <= _NEAR * max(1.0, abs(goal_a), abs(goal_b))
            break
        a, b, miss = try_a, try_b, new_miss
    if not converged:
        return np.nan, np.nan, np.nan
    # (3) From the undistorted point to a direction: the plane at distance 1, or a fisheye's
    # angle.
    radius = np.hypot(a, b)
    if packed[KIND] == 0.0:
        size = np.sqrt(radius * radius + 1.0)
        a, b, c = a / size, b / size, 1.0 / size
    else:
        scale = np.sin(radius) / radius if radius > 0.0 else 1.0
        a, b, c = a * scale, b * scale, np.cos(radius)
    # (4) To the scene frame, by the rotation's transpose.
    r = ROTATION
    return (
        packed[r] * a + packed[r + 3] * b + packed[r + 6] * c,
        packed[r + 1] * a + packed[r + 4] * b + packed[r + 7] * c,
        packed[r + 2] * a + packed[r + 5] * b + packed[r + 8] * c,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _along_radius(packed: Float64, goal_a: float, goal_b: float) -> tuple[float, float]:
    """Invert the radial terms alone; the limit where they do not reach the goal."""
    goal = np.hypot(goal_a, goal_b)
    if not goal > 0.0:
        return goal_a, goal_b
    # Newton's method. Invariant: the root lies in low..high; a step that leaves the bracket is
    # replaced by halving it.
    low, high = 0.0, packed[LIMIT]
    radius = min(goal, 0.5 * high)
    for _ in range(_NEWTON_STEPS):
        m, slope = _radial(packed, radius * radius)
        value = radius * m - goal
        if value > 0.0:
            high = radius
        else:
            low = radius
        step = value / (m + slope * radius * radius)
        moved = radius - step
        if not low < moved < high:
            moved = 0.5 * (low + high)
        done = abs(moved - radius) <= _NEWTON_TOLERANCE * max(1.0, radius)
        radius = moved
        if done:
            break
    return goal_a / goal * radius, goal_b / goal * radius


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _within(a: float, b: float, limit: float) -> tuple[float, float]:
    """Shorten (a, b) to the valid radius, in its own direction."""
    radius = np.hypot(a, b)
    scale = limit / radius if radius > limit else 1.0
    return a * scale, b * scale


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _radial(packed: Float64, q: float) -> tuple[float, float]:
    """Find m, and s such that dm/da = s a and dm/db = s b."""
    above, above_slope = 0.0, 0.0
    for k in range(MAX_RADIAL - 1, -1, -1):
        above_slope = above_slope * q + above
        above = above * q + packed[RADIAL + k]
    above_slope = above_slope * q + above
    above = above * q + 1.0
    below, below_slope = 0.0, 0.0
    for k in range(MAX_DENOMINATOR - 1, -1, -1):
        below_slope = below_slope * q + below
        below = below * q + packed[DENOMINATOR + k]
    below_slope = below_slope * q + below
    below = below * q + 1.0
    m = above / below
    slope = 2.0 * (above_slope - m * below_slope) / below
    return m, slope


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _distort(
    packed: Float64, a: float, b: float
) -> tuple[float, float, float, float, float, float]:
    """Step 2 of the module, with its Jacobian (da'/da, da'/db, db'/da, db'/db)."""
    q = a * a + b * b
    m, slope = _radial(packed, q)
    p1, p2 = packed[P1], packed[P2]
    return (
        a * m + 2.0 * p1 * a * b + p2 * (q + 2.0 * a * a),
        b * m + p1 * (q + 2.0 * b * b) + 2.0 * p2 * a * b,
        m + slope * a * a + 2.0 * p1 * b + 6.0 * p2 * a,
        slope * a * b + 2.0 * p1 * a + 2.0 * p2 * b,
        slope * a * b + 2.0 * p1 * a + 2.0 * p2 * b,
        m + slope * b * b + 6.0 * p1 * b + 2.0 * p2 * a,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def first_fold(packed: Float64, radii: Float64, spokes: int) -> int:
    """Row of `radii` at which the map first folds on some spoke; ``len(radii)`` if nowhere."""
    for i in range(len(radii)):
        for k in range(spokes):
            turn = 2.0 * np.pi * k / spokes
            _, _, aa, ab, ba, bb = _distort(
                packed, radii[i] * np.cos(turn), radii[i] * np.sin(turn)
            )
            if not (aa * bb - ab * ba > 0.0 and aa + bb > 0.0):
                return i
    return len(radii)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_rows(packed: Float64, points: Float64) -> Float64:
    """Project points (N, 3) to rows (N, 3) of u, v, depth."""
    rows = np.empty((len(points), 3))
    for i in range(len(points)):
        u, v, depth = project_packed(packed, points[i, 0], points[i, 1], points[i, 2])
        rows[i, 0], rows[i, 1], rows[i, 2] = u, v, depth
    return rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def unproject_rows(packed: Float64, pixels: Float64) -> Float64:
    """Find the unit rays (N, 3), scene frame, of pixels (N, 2)."""
    rays = np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        x, y, z = ray_packed(packed, pixels[i, 0], pixels[i, 1])
        rays[i, 0], rays[i, 1], rays[i, 2] = x, y, z
    return rays
