"""8-bit sRGB to 16-bit linear light and back, exactly.

glTF defines ``COLOR_0`` as linear; surveys hold 8-bit sRGB. The transfer function is that of
IEC 61966-2-1 (sRGB).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64, UInt8, UInt16

__all__ = ["linear16_to_srgb", "srgb_to_linear16"]


def srgb_to_linear16(colours: UInt8) -> UInt16:
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
    >>> srgb_to_linear16(np.array([[0], [255]], dtype=np.uint8)).tolist()
    [[0], [65535]]
    """
    return _TO_LINEAR[colours]


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
    >>> levels = np.arange(256, dtype=np.uint8)
    >>> bool((linear16_to_srgb(srgb_to_linear16(levels)) == levels).all())
    True
    """
    return _TO_SRGB[codes]


def _linear(level: Float64) -> Float64:
    value = level / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4) * 65535.0


_TO_LINEAR: Final[UInt16] = np.rint(_linear(np.arange(256.0))).astype(np.uint16)
_TO_SRGB: Final[UInt8] = np.searchsorted(
    _linear(np.arange(255.0) + 0.5), np.arange(65536), side="right"
).astype(np.uint8)
