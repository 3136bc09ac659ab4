"""Which texels a face covers, and where in the face each lies: for kernels that draw atlases.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float64

__all__ = ["NO_AREA", "face_frame", "middle_texel", "texel_box", "texel_weights"]

_INSIDE: Final = -1e-9
"""Barycentric weight from which a texel's centre counts as inside: centres on a shared edge belong
to both faces, so none is left out."""

NO_AREA: Final = 1e-12
"""Doubled area, square texels, below which a face holds no texel's centre."""

Sides = tuple[float, float, float, float, float]
"""Two sides of a face from its first corner, and twice the area between them."""


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def face_frame(corners: Float64, margin: float) -> tuple[Sides, tuple[float, float, float]]:
    """Sides from the first corner and twice the area between them; the least weights to draw."""
    bx, by = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1]
    cx, cy = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1]
    area = bx * cy - by * cx
    # Weights that a margin away from each edge stands for: distance over height.
    return (bx, by, cx, cy, area), (
        _INSIDE - margin * np.hypot(cx - bx, cy - by) / abs(area),
        _INSIDE - margin * np.hypot(cx, cy) / abs(area),
        _INSIDE - margin * np.hypot(bx, by) / abs(area),
    )


@numba.njit(cache=True, nogil=True, inline="always", error_model="numpy")
def texel_weights(corners: Float64, sides: Sides, i: int, j: int) -> tuple[float, float, float]:
    """Barycentric weights of a texel's centre."""
    bx, by, cx, cy, area = sides
    px, py = i + 0.5 - corners[0, 0], j + 0.5 - corners[0, 1]
    l1 = (px * cy - py * cx) / area
    l2 = (bx * py - by * px) / area
    return 1.0 - l1 - l2, l1, l2


@numba.njit(cache=True, nogil=True, inline="always")
def middle_texel(corners: Float64, sides: Sides) -> tuple[int, int]:
    """Texel that a face's middle lies in."""
    third = 1.0 / 3.0
    return (
        int(corners[0, 0] + (sides[0] + sides[2]) * third),
        int(corners[0, 1] + (sides[1] + sides[3]) * third),
    )


@numba.njit(cache=True, nogil=True, inline="always")
def texel_box(
    corners: Float64, width: int, height: int, margin: float
) -> tuple[int, int, int, int]:
    """Texels whose centres may lie in a face: first and behind the last, across and down."""
    left = min(corners[0, 0], corners[1, 0], corners[2, 0])
    right = max(corners[0, 0], corners[1, 0], corners[2, 0])
    upper = min(corners[0, 1], corners[1, 1], corners[2, 1])
    lower = max(corners[0, 1], corners[1, 1], corners[2, 1])
    return (
        max(int(np.floor(left - margin - 0.5)), 0),
        max(int(np.floor(upper - margin - 0.5)), 0),
        min(int(np.floor(right + margin + 0.5)) + 1, width),
        min(int(np.floor(lower + margin + 0.5)) + 1, height),
    )
