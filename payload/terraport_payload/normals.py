"""Normals as the codec's octahedral filter takes them, chosen to pack well.

The octahedral map (Z. H. Cigolle, S. Donow, D. Evangelakos, M. Mara, M. McGuire, Q. Meyer, "A
survey of efficient representations for independent unit vectors", JCGT 3(2), 2014) puts a unit
vector on a square; the filter of ``EXT_meshopt_compression`` stores the square's two coordinates as
whole numbers. Rounding is not the only choice within an error bound: a code that stays as the one
before it costs almost nothing.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.steady import steady_codes
from terraport_payload.types import Float32, Float64, UInt8

__all__ = ["encode_octahedral", "largest_error_deg"]

_SLACK: Final = 0.8
"""Steps that a coordinate may lie off, where rounding has a half: saves 0.03 bytes a triangle and
costs a fifth of the mean error."""

_WORST_DEG: Final = 1.9
"""Largest error of rounding with 7 bits, in degrees (found over the sphere). The decoder rounds to
8 bits per axis after that: 2.2 in all."""


def largest_error_deg(bits: int) -> float:
    """Bound of the error of a number of bits per coordinate, degrees: that of rounding."""
    return _WORST_DEG * 63.0 / ((1 << (bits - 1)) - 1)


def encode_octahedral(normals: Float32, bits: int) -> UInt8:
    """Make the input of the octahedral filter.

    Parameters
    ----------
    normals : ndarray of shape (V, 3), float32
        Unit, in the order in which the codec gets them.
    bits : int
        Per coordinate, sign included; 4 to 8.

    Returns
    -------
    ndarray of shape (V, 4), uint8
        Bytes of signed x, y, the code of 1, and 0. Within :func:`largest_error_deg`.
    """
    top = (1 << (bits - 1)) - 1
    unit = normals.astype(np.float64)
    square = _fold(unit) * top
    least = np.maximum(np.ceil(square - _SLACK), -top).astype(np.int8).T
    most = np.minimum(np.floor(square + _SLACK), top).astype(np.int8).T
    codes = steady_codes(np.ascontiguousarray(least), np.ascontiguousarray(most)).T
    # At the corners of the slack, and where the map is stretched most, rounding it is.
    away = (_unfold(codes / top) * unit).sum(axis=1) < np.cos(np.radians(largest_error_deg(bits)))
    rows = np.zeros((len(normals), 4), dtype=np.int8)
    rows[:, :2] = np.where(away[:, None], np.rint(square), codes)
    rows[:, 2] = top
    return rows.view(np.uint8)


def _fold(unit: Float64) -> Float64:
    """Put unit vectors on the square from -1 to 1; the lower half goes to the corners."""
    plane = unit / np.abs(unit).sum(axis=1, keepdims=True)
    x, y = plane[:, 0], plane[:, 1]
    corner = [(1.0 - np.abs(y)) * np.copysign(1.0, x), (1.0 - np.abs(x)) * np.copysign(1.0, y)]
    below = plane[:, 2:] < 0.0
    return np.where(below, np.stack(corner, axis=1), plane[:, :2])


def _unfold(square: Float64) -> Float64:
    """Turn places on the square into unit vectors, as the filter's decoder does."""
    z = 1.0 - np.abs(square).sum(axis=1)
    below = np.minimum(z, 0.0)[:, None]
    plane = square + np.where(square >= 0.0, below, -below)
    vector = np.concatenate([plane, z[:, None]], axis=1)
    unit: Float64 = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit
