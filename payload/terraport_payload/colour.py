"""8-bit sRGB to 16-bit linear light and back, exactly.

glTF defines ``COLOR_0`` as linear; surveys hold 8-bit sRGB. Every sRGB level owns an interval of
linear values that round back to it, and any 16-bit code inside that interval decodes to the level
without loss. From each interval :func:`srgb_to_linear16` takes the code with the **most trailing
zero bits**: above level 100 or so the low byte is then constant zero, which the vertex codec stores
for almost nothing (measured in ``benchmarks/store.py``). A viewer that writes 8-bit sRGB shows the
survey's own level, since the code is nearer to it than to any other.

The transfer function is that of IEC 61966-2-1 (sRGB).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["linear16_to_srgb", "srgb_to_linear16"]

_GUARD: Final = 0.05
"""Share of an interval left free at either end (in sRGB levels): a renderer's own rounding then
stays inside it."""


def srgb_to_linear16(colours: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint16]:
    """Convert sRGB levels to 16-bit linear codes.

    Parameters
    ----------
    colours : ndarray of uint8, any shape
        sRGB, 0..255.

    Returns
    -------
    ndarray of uint16, same shape
        Linear light, 65535 = 1.0.

    Examples
    --------
    >>> srgb_to_linear16(np.array([0, 255], dtype=np.uint8)).tolist()
    [0, 65535]
    """
    return _TO_LINEAR[colours]


def linear16_to_srgb(codes: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint8]:
    """Convert 16-bit linear codes to the nearest sRGB level; the exact inverse.

    Parameters
    ----------
    codes : ndarray of uint16, any shape
        Linear light, 65535 = 1.0.

    Returns
    -------
    ndarray of uint8, same shape
        sRGB, 0..255.

    Examples
    --------
    >>> levels = np.arange(256, dtype=np.uint8)
    >>> bool((linear16_to_srgb(srgb_to_linear16(levels)) == levels).all())
    True
    """
    return _TO_SRGB[codes]


def _linear(level: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    value = level / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _code_table() -> npt.NDArray[np.uint16]:
    levels = np.arange(256, dtype=np.float64)
    low = np.ceil(_linear(np.maximum(levels - 0.5 + _GUARD, 0.0)) * 65535.0).astype(np.int64)
    high = np.floor(_linear(np.minimum(levels + 0.5 - _GUARD, 255.0)) * 65535.0).astype(np.int64)
    table = np.zeros(256, dtype=np.uint16)
    for level in range(1, 255):
        # The roundest number of the interval: the largest power of two with a multiple in it.
        for bit in range(15, -1, -1):
            candidate = (low[level] + (1 << bit) - 1) >> bit << bit
            if candidate <= high[level]:
                table[level] = candidate
                break
    table[255] = 65535  # white stays exactly 1.0
    return table


def _level_table() -> npt.NDArray[np.uint8]:
    borders = _linear(np.arange(255, dtype=np.float64) + 0.5) * 65535.0
    return np.searchsorted(borders, np.arange(65536), side="right").astype(np.uint8)


_TO_LINEAR: Final = _code_table()
_TO_SRGB: Final = _level_table()
