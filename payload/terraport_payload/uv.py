"""Texture coordinates in whole half texels. PURE: no I/O, no clock."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float32, UInt16

__all__ = ["UV_STEPS_PER_TEXEL", "decode_uvs", "encode_uvs", "snap_uvs"]

UV_STEPS_PER_TEXEL: Final = 2
"""Texture coordinates are whole half texels: coarse enough to pack well, and without any error for
an atlas that is drawn after :func:`snap_uvs`."""

_MAX_CODE: Final = 65535


def _steps(width: int, height: int) -> tuple[int, int]:
    return UV_STEPS_PER_TEXEL * width, UV_STEPS_PER_TEXEL * height


def encode_uvs(uvs: Float32, width: int, height: int) -> UInt16:
    """Round texture coordinates to half texels.

    Parameters
    ----------
    uvs : ndarray of shape (V, 2), float32
        0..1, from the image's upper left.
    width, height : int
        Texels of the image, powers of two.

    Returns
    -------
    ndarray of shape (V, 2), uint16
    """
    codes = np.rint(uvs.astype(np.float64) * _steps(width, height))
    return np.minimum(codes, _MAX_CODE).astype("<u2")


def decode_uvs(codes: UInt16, width: int, height: int) -> Float32:
    """Turn codes of half texels into texture coordinates.

    Parameters
    ----------
    codes : ndarray of shape (V, 2), uint16
    width, height
        As in :func:`encode_uvs`.

    Returns
    -------
    ndarray of shape (V, 2), float32
    """
    across, down = _steps(width, height)
    # Sides are powers of two, so the products are exact.
    return codes.astype(np.float32) * np.array([1.0 / across, 1.0 / down], dtype=np.float32)


def snap_uvs(uvs: Float32, width: int, height: int) -> Float32:
    """Round texture coordinates to what a payload holds; draw the atlas with these.

    Parameters
    ----------
    uvs, width, height
        As in :func:`encode_uvs`.

    Returns
    -------
    ndarray of shape (V, 2), float32
        Within a quarter of a texel.

    Examples
    --------
    >>> snap_uvs(np.array([[0.1, 1.0]], dtype=np.float32), 8, 4).tolist()
    [[0.125, 1.0]]
    """
    return decode_uvs(encode_uvs(uvs, width, height), width, height)
