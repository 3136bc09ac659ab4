"""The compiled loops of rendered photos: values at hits, and the camera's own errors. PURE."""

from __future__ import annotations

import numpy as np
from numba import njit

from terraport_payload.types import Float32, Float64, Int32, UInt8

__all__ = ["FIELDS", "develop_rows", "fields_at"]

FIELDS = 11
"""x, y, z, normal (3), lane, inside, road, water depth, pile: columns of a vertex table."""

_WATER = 9
_PILE = 10


@njit("f8[:,::1](f4[:,::1], i4[:,::1], i4[::1], f4[::1], f4[::1])", cache=True, nogil=True)
def fields_at(table: Float32, faces: Int32, face: Int32, u: Float32, v: Float32) -> Float64:
    """Interpolate a vertex table at hits, (R, FIELDS); unit normals.

    Water depth and pile cannot be mixed: a hit takes those of the corners that hold more than half
    of its weight (0 and -1 where those are dry and bare).
    """
    count = face.shape[0]
    result = np.empty((count, FIELDS))
    for n in range(count):
        a, b, c = faces[face[n], 0], faces[face[n], 1], faces[face[n], 2]
        wb, wc = np.float64(u[n]), np.float64(v[n])
        wa = 1.0 - wb - wc
        for k in range(_WATER):
            result[n, k] = wa * table[a, k] + wb * table[b, k] + wc * table[c, k]
        length = np.sqrt(result[n, 3] ** 2 + result[n, 4] ** 2 + result[n, 5] ** 2)
        for k in range(3, 6):
            result[n, k] /= max(length, 1e-12)
        wet, heaped, depth, pile = 0.0, 0.0, 0.0, -1.0
        for corner, weight in ((a, wa), (b, wb), (c, wc)):
            if table[corner, _WATER] > 0.0:
                wet += weight
                depth = max(depth, np.float64(table[corner, _WATER]))
            if table[corner, _PILE] >= 0.0:
                heaped += weight
                pile = max(pile, np.float64(table[corner, _PILE]))
        result[n, _WATER] = depth if wet > 0.5 else 0.0
        result[n, _PILE] = pile if heaped > 0.5 else -1.0
    return result


@njit("u8(u8)", cache=True, nogil=True)
def _mixed(state: np.uint64) -> np.uint64:
    """Scramble a counter: the finaliser of splitmix64 (Steele, Lea, Flood, OOPSLA 2014)."""
    z = state * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit("void(f4[:,:,::1], i8, f8[::1], f8, f8, u8, u1[:,:,::1])", cache=True, nogil=True)
def develop_rows(
    picture: Float32,
    first_row: int,
    gains: Float64,
    vignetting: float,
    noise: float,
    seed: np.uint64,
    result: UInt8,
) -> None:
    """Turn sRGB scene colours (0..255) into what a camera stores, row by row.

    `gains` (per channel) and vignetting act on linear light; noise on the stored levels. The noise
    of a pixel depends on `seed` and its number alone, so bands may be made in any order.
    """
    height, width = result.shape[:2]
    half = 0.25 * (height * height + width * width)
    rows = picture.shape[0]
    table = np.empty(256)
    for level in range(256):
        value = level / 255.0
        table[level] = value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
    for row in range(rows):
        y = first_row + row
        for x in range(width):
            r2 = ((x + 0.5 - 0.5 * width) ** 2 + (y + 0.5 - 0.5 * height) ** 2) / half
            fall = 1.0 - vignetting * r2
            number = np.uint64((y * width + x) * 4)
            for k in range(3):
                grey = min(max(np.float64(picture[row, x, k]), 0.0), 255.0)
                low = min(int(grey), 254)
                light = table[low] + (grey - low) * (table[low + 1] - table[low])
                light *= gains[k] * fall
                if light <= 0.0031308:
                    value = 12.92 * light
                else:
                    value = 1.055 * light ** (1.0 / 2.4) - 0.055
                bits = _mixed(seed ^ _mixed(number + np.uint64(k)))
                # Four 16-bit numbers: their sum is nearly normal, with variance 1/3.
                total = 0.0
                for quarter in range(4):
                    total += float((bits >> np.uint64(16 * quarter)) & np.uint64(0xFFFF)) / 65536.0
                value = 255.0 * value + (total - 2.0) * 1.7320508 * noise
                result[y, x, k] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
