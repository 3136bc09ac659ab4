"""Space-filling curves: the order in which faces and segments lie on disk.

A curve gives one integer per position so that positions near each other in space mostly get
integers near each other. Segments are numbered, and appended to the pack, along a Morton curve, so
that one landing reads few long runs of the file. Positions are quantised with *one* scale for all
axes (cubic cells), so a flat scene does not spend its bits on height.

PURE: no I/O, no clock.

References
----------
G. M. Morton, "A computer oriented geodetic data base and a new technique in file sequencing", IBM,
1966. J. Skilling, "Programming the Hilbert curve", AIP Conference Proceedings 707, 2004 (the
transpose form used here).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Int64, UInt64

__all__ = ["CURVE_BITS", "hilbert_codes", "hilbert_order", "morton_codes", "morton_order"]

CURVE_BITS: Final = 21
"""Bits per axis: 3 x 21 = 63 fit one uint64, and 2^21 cells over 2 km are 1 mm each."""


def morton_codes(positions: AnyFloat) -> UInt64:
    """Morton (Z-order) code of every position.

    Parameters
    ----------
    positions : ndarray of shape (N, 3), float
        Any unit, any frame; finite.

    Returns
    -------
    ndarray of shape (N,), uint64
        Bits of the three quantised coordinates interleaved, x lowest. Equal cells give equal codes.
        Positions that all coincide give 0.

    Raises
    ------
    ValueError
        Wrong shape, or a value that is not finite.

    Examples
    --------
    >>> morton_codes(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])).argsort().tolist()
    [0, 1, 2]
    """
    cells = _quantise(positions)
    codes: UInt64 = (
        _spread(cells[:, 0])
        | _spread(cells[:, 1]) << np.uint64(1)
        | (_spread(cells[:, 2]) << np.uint64(2))
    )
    return codes


def morton_order(positions: AnyFloat) -> Int64:
    """Permutation that sorts positions along the Morton curve; ties keep the given order.

    Parameters
    ----------
    positions : ndarray of shape (N, 3), float
        Finite.

    Returns
    -------
    ndarray of shape (N,), int64
    """
    return np.argsort(morton_codes(positions), kind="stable").astype(np.int64, copy=False)


def hilbert_codes(positions: AnyFloat) -> UInt64:
    """Hilbert code of every position: like Morton, without its long jumps, at ten times the price.

    Parameters
    ----------
    positions : ndarray of shape (N, 3), float
        Finite.

    Returns
    -------
    ndarray of shape (N,), uint64
        Cells with consecutive codes are neighbours in space.

    Raises
    ------
    ValueError
        Wrong shape, or a value that is not finite.
    """
    cells = _quantise(positions)
    axes = [cells[:, 0].copy(), cells[:, 1].copy(), cells[:, 2].copy()]
    one = np.uint64(1)
    # Skilling's AxestoTranspose: undo the excess work from the highest bit down, then Gray-encode.
    for level in range(CURVE_BITS - 1, 0, -1):
        bit = one << np.uint64(level)
        low = bit - one
        for axis in range(3):
            is_set = (axes[axis] & bit) != 0
            swap = np.where(is_set, np.uint64(0), (axes[0] ^ axes[axis]) & low)
            axes[0] = np.where(is_set, axes[0] ^ low, axes[0] ^ swap)
            if axis:
                axes[axis] = axes[axis] ^ swap
    axes[1] = axes[1] ^ axes[0]
    axes[2] = axes[2] ^ axes[1]
    flip = np.zeros_like(axes[0])
    for level in range(CURVE_BITS - 1, 0, -1):
        bit = one << np.uint64(level)
        flip = np.where((axes[2] & bit) != 0, flip ^ (bit - one), flip)
    axes = [axis ^ flip for axis in axes]
    # The transpose's first axis holds the most significant bit of every triple.
    return (_spread(axes[0]) << np.uint64(2)) | (_spread(axes[1]) << one) | _spread(axes[2])


def hilbert_order(positions: AnyFloat) -> Int64:
    """Permutation that sorts positions along the Hilbert curve; ties keep the given order.

    Parameters
    ----------
    positions : ndarray of shape (N, 3), float
        Finite.

    Returns
    -------
    ndarray of shape (N,), int64
    """
    return np.argsort(hilbert_codes(positions), kind="stable").astype(np.int64, copy=False)


def _quantise(positions: AnyFloat) -> UInt64:
    if positions.ndim != 2 or positions.shape[1] != 3:
        msg = f"positions have shape {positions.shape}, expected (N, 3)"
        raise ValueError(msg)
    if len(positions) == 0:
        return np.zeros((0, 3), dtype=np.uint64)
    if not np.isfinite(positions).all():
        bad = int(np.flatnonzero(~np.isfinite(positions).all(axis=1))[0])
        msg = f"position {bad} is {positions[bad].tolist()}, expected finite values"
        raise ValueError(msg)
    local = positions.astype(np.float64)
    local -= local.min(axis=0)
    side = float(local.max())
    if side > 0.0:
        local *= (2**CURVE_BITS - 1) / side
    return local.astype(np.uint64)


def _spread(values: UInt64) -> UInt64:
    """Put two zero bits before every bit of a 21-bit value (the well-known magic masks)."""
    spread = values & np.uint64(0x1FFFFF)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
    return spread
