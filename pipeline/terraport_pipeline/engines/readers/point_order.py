"""An order of points, and a choice among them, that do not depend on how they lie in files.

A delivery may come as one file or as many, with overlaps or without, in any order. So points are
put into an order of their own: along a Morton curve through the survey's box, ties by coordinates
and then by every value. Neighbours in space are near in the order, so what takes every n-th point
spreads evenly.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int64, UInt64

__all__ = ["HashThinning", "curve_keys", "order_rows", "point_hashes", "thinning_rows"]

_AXIS_BITS: Final = 21
"""Of a 64-bit key, per axis: cells of half a millimetre over a kilometre."""

_SPREAD: Final = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two zero bits between the bits of a 21-bit number."""

_MIXERS: Final = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
"""Odd 64-bit multipliers, one per axis (primes of xxHash)."""

_SKETCH_SIZE: Final = 1 << 16
"""Smallest hashes from which the number of different points is estimated: 0.4 % exact."""


def curve_keys(points: Float64, low: Float64, high: Float64) -> UInt64:
    """Compute the place of points along a Morton curve through a box.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Finite; what lies outside the box counts as on its side.
    low, high : ndarray of shape (3,), float64
        Corners of the box. The curve's cells are cubes: 2^21 along the longest side.

    Returns
    -------
    ndarray of shape (N,), uint64

    Examples
    --------
    >>> box = np.zeros(3), np.ones(3)
    >>> curve_keys(np.array([[0.9, 0, 0], [0.1, 0.1, 0.1], [0, 0, 0]]), *box).argsort().tolist()
    [2, 1, 0]
    """
    side = float((high - low).max()) or 1.0
    keys = np.zeros(len(points), np.uint64)
    for axis in range(3):
        cells = (points[:, axis] - low[axis]) * (2.0**_AXIS_BITS / side)
        bits = np.clip(cells, 0, 2.0**_AXIS_BITS - 1).astype(np.uint64)
        for shift, mask in _SPREAD:
            bits |= bits << np.uint64(shift)
            bits &= np.uint64(mask)
        keys |= bits << np.uint64(axis)
    return keys


def order_rows(keys: UInt64, columns: Sequence[AnyArray], file: AnyArray) -> tuple[Int64, Bool]:
    """Sort rows by key and then by value; mark those that repeat another in every value.

    Parameters
    ----------
    keys : ndarray of shape (N,), uint64
    columns : sequence of ndarray of shape (N,)
        Everything that tells points apart; compared by their bits, so NaN equals itself.
    file : ndarray of shape (N,)
        Number of the file that a row comes from; the last to decide, and not compared.

    Returns
    -------
    order : ndarray of shape (N,), int64
    repeats : ndarray of shape (N,), bool
        In that order: the row has every value of the one before it. The first of equal ones is of
        the first file.
    """
    order: Int64 = np.argsort(keys).astype(np.int64, copy=False)
    sorted_keys = keys[order]
    same = np.zeros(len(keys), bool)
    same[1:] = sorted_keys[1:] == sorted_keys[:-1]
    # Only rows that share their key need more than it: few, as cells are fine.
    tied = same.copy()
    tied[:-1] |= same[1:]
    places = np.flatnonzero(tied)
    if not len(places):
        return order, same
    rows = order[places]
    values = [_bits(column[rows]) for column in columns]
    inner = np.lexsort([file[rows], *reversed(values), sorted_keys[places]])
    order[places] = rows[inner]
    equal = same[places]
    for column in values:
        ordered = column[inner]
        equal[1:] &= ordered[1:] == ordered[:-1]
    same[places] = equal
    return order, same


def point_hashes(points: Float64) -> UInt64:
    """Hash coordinates (N, 3) to (N,) uint64, evenly spread over all 64 bits."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)  # + 0.0 turns -0.0 into 0.0
    hashes = np.zeros(len(points), np.uint64)
    for axis, mixer in enumerate(_MIXERS):
        hashes ^= bits[:, axis] * np.uint64(mixer)
        hashes ^= hashes >> np.uint64(29)
        hashes *= np.uint64(_MIXERS[0])
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        hashes ^= hashes >> np.uint64(shift)
        hashes *= np.uint64(factor)
    hashes ^= hashes >> np.uint64(31)
    return hashes


class HashThinning:
    """Chooses about so many points of a survey of unknown size, while it is read.

    A point stays when the hash of its coordinates is below a limit, and the limit follows from the
    number of different points alone: the choice is the same however the points come and however
    often one repeats. The limit only falls, so what was passed before is a superset.

    Parameters
    ----------
    count : int
        Different points to keep, about; smaller surveys are kept whole, and of any at least 65,536.
    """

    def __init__(self, count: int) -> None:
        self._count = max(count, _SKETCH_SIZE)
        self._sketch: UInt64 = np.zeros(0, np.uint64)
        self.limit = (1 << 64) - 1
        """Largest hash that stays, so far."""

    def look(self, hashes: UInt64) -> None:
        """Count hashes of further points."""
        if len(self._sketch) == _SKETCH_SIZE:
            hashes = hashes[hashes < self._sketch[-1]]
        self._sketch = np.unique(np.concatenate([self._sketch, hashes]))[:_SKETCH_SIZE]
        if len(self._sketch) == _SKETCH_SIZE:
            # The k-th smallest of n evenly spread hashes lies at about k/n of their range.
            different = (_SKETCH_SIZE - 1) * 2.0**64 / float(self._sketch[-1])
            share = self._count / different
            self.limit = (1 << 64) - 1 if share >= 1.0 else int(share * 2.0**64)


def thinning_rows(count: int, max_points: int | None) -> Int64 | None:
    """Choose which of `count` points to keep.

    The points are cut into `max_points` runs of (nearly) equal length, and one point of each run is
    taken by a fixed random stream: evenly spread like every n-th point, but without the stripes
    that a regular step makes in scan lines. The same numbers give the same choice.

    Parameters
    ----------
    count : int
        Points in the file.
    max_points : int or None
        Points to keep at most, >= 1; None keeps all.

    Returns
    -------
    ndarray of shape (max_points,), int64, or None
        Ascending, without repetition; None when all are kept.

    Examples
    --------
    >>> rows = thinning_rows(1000, 4)
    >>> [int(row) // 250 for row in rows]
    [0, 1, 2, 3]
    """
    if max_points is None or count <= max_points:
        return None
    edges = np.arange(max_points + 1, dtype=np.int64) * count // max_points
    draw = np.random.default_rng(0).random(max_points)
    rows: Int64 = edges[:-1] + (draw * np.diff(edges)).astype(np.int64)
    return rows


def _bits(column: AnyArray) -> AnyArray:
    whole = np.ascontiguousarray(column)
    if whole.dtype.kind == "f":
        whole = whole + whole.dtype.type(0)  # -0.0 equals 0.0
    return whole.view(f"u{whole.dtype.itemsize}")
