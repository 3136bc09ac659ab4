"""8-bit sRGB to 16-bit linear light and back, exactly.

glTF defines ``COLOR_0`` as linear; surveys hold 8-bit sRGB. Every sRGB level owns an interval of
linear values that round back to it, and any 16-bit code inside that interval decodes to the level
without loss. :func:`srgb_to_linear16` uses that freedom: the vertex codec stores differences from
vertex to vertex byte by byte, and a byte that stays the same costs almost nothing. So the low byte
is kept for as long as the intervals allow, and the high byte moves as little as they allow. A
viewer that writes 8-bit sRGB shows the survey's own level, since the code is nearer to it than to
any other.

The transfer function is that of IEC 61966-2-1 (sRGB).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.steady import steady_codes
from terraport_payload.types import Float64, Int32, UInt8, UInt16, UInt64

__all__ = ["linear16_to_srgb", "srgb_to_linear16"]

_GUARD: Final = 0.05
"""Share of an interval left free at either end (in sRGB levels): a renderer's own rounding then
stays inside it."""

_RUN: Final = 64
"""Vertices in a stretch; longer ones save 0.01 bytes a triangle and take more steps."""


def srgb_to_linear16(colours: UInt8) -> UInt16:
    """Convert sRGB levels to 16-bit linear codes that pack well in their order.

    Parameters
    ----------
    colours : ndarray of shape (V, C), uint8
        sRGB, 0..255, in the order in which the codec gets them.

    Returns
    -------
    ndarray of shape (V, C), uint16
        Linear light, 65535 = 1.0. Black is 0 and white 65535; other levels have one of the codes of
        their interval, which differs from place to place.

    Notes
    -----
    Low bytes are multiples of 4, so that the ones an interval offers are the bits of one 64-bit
    word. Runs of vertices are made as long as their words have a bit in common (the fewest runs
    there can be, but for a new one every :data:`_RUN` vertices, which lets all stretches be worked
    on at once). High bytes follow by clamping: each is the nearest to the one before that its
    interval allows.

    Examples
    --------
    >>> srgb_to_linear16(np.array([[0], [255]], dtype=np.uint8)).tolist()
    [[0], [65535]]
    """
    count, channels = colours.shape
    if not count:
        return np.zeros((0, channels), dtype=np.uint16)
    stretches = -(-count // _RUN)
    levels = np.empty((channels, stretches * _RUN), dtype=np.uint8)
    levels[:, :count] = colours.T
    levels[:, count:] = levels[:, count - 1 : count]  # filled up by its last level
    low_byte = _common_low_bytes(levels.reshape(-1, _RUN)).reshape(channels, -1)
    # Smallest and largest high byte that lead into the interval with this low byte.
    least = ((_LOW[levels] - low_byte + 255) >> 8).astype(np.int16)
    most = ((_HIGH[levels] - low_byte) >> 8).astype(np.int16)
    codes = ((steady_codes(least, most).astype(np.uint16) << 8) | low_byte)[:, :count]
    codes[colours.T == 255] = 65535  # white stays exactly 1.0
    return np.ascontiguousarray(codes.T.astype(np.uint16))


def linear16_to_srgb(codes: UInt16) -> UInt8:
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
    >>> levels = np.arange(256, dtype=np.uint8)[:, None]
    >>> bool((linear16_to_srgb(srgb_to_linear16(levels)) == levels).all())
    True
    """
    return _TO_SRGB[codes]


def _linear(level: Float64) -> Float64:
    value = level / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _intervals() -> tuple[Int32, Int32]:
    """First and last code of every level."""
    levels = np.arange(256, dtype=np.float64)
    low = np.ceil(_linear(np.maximum(levels - 0.5 + _GUARD, 0.0)) * 65535.0).astype(np.int32)
    high = np.floor(_linear(np.minimum(levels + 0.5 - _GUARD, 255.0)) * 65535.0).astype(np.int32)
    high[0] = 0  # black stays exactly 0
    # White is put in afterwards; it neither ends a run nor moves it.
    low[255], high[255] = 0, 65535
    return low, high


def _low_byte_words() -> UInt64:
    """For every level a word whose bit k says that 4 k is the low byte of one of its codes."""
    bytes_4 = np.arange(0, 256, 4)
    fits = (_HIGH[:, None] - bytes_4) >> 8 >= (_LOW[:, None] - bytes_4 + 255) >> 8
    return np.packbits(fits, axis=1, bitorder="little").view("<u8")[:, 0].astype(np.uint64)


def _common_low_bytes(levels: UInt8) -> Int32:
    """Low bytes for stretches of levels, (stretches, _RUN), with as few changes as there can be."""
    words = _LOW_BYTES[levels.T]
    begins = np.zeros(words.shape, dtype=bool)
    for place in range(1, len(words)):  # all stretches at once; words become "common so far"
        own = words[place]
        common = words[place - 1] & own
        begins[place] = common == 0
        words[place] = np.where(begins[place], own, common)
    for place in range(len(words) - 2, -1, -1):  # what the whole run has in common
        words[place] = np.where(begins[place + 1], words[place], words[place + 1])
    lowest = words & (~words + np.uint64(1))
    # A power of two is exact as a float64, and its exponent is the number of its bit.
    return 4 * (np.frexp(lowest.T.astype(np.float64))[1].astype(np.int32) - 1)


def _level_table() -> UInt8:
    borders = _linear(np.arange(255, dtype=np.float64) + 0.5) * 65535.0
    return np.searchsorted(borders, np.arange(65536), side="right").astype(np.uint8)


_LOW, _HIGH = _intervals()
_LOW_BYTES: Final = _low_byte_words()
_TO_SRGB: Final = _level_table()
