"""Split units that are too big or too wide into compact pieces of nearly equal face counts.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np

from terraport_payload.types import Float32, Int32, Int64, UInt32
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["split_units"]


_Whole = int | np.signedinteger[Any]

_FILL: Final = 0.8
"""Pieces aim at this share of ``max_faces``, so that they can take up crumbs of their neighbours
afterwards."""
_STACK: Final = 256
"""A cut leaves at most two thirds on one side, so 2^31 faces are cut at most 54 deep."""


def split_units(
    labels: Int32,
    count: int,
    low: Float32,
    high: Float32,
    max_faces: int,
    max_extent_m: float,
    *,
    threads: int = 1,
) -> tuple[Int32, int]:
    """Cut every unit over a bound across its longest side, at equal shares, until none is.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        Unit of every face, 0..count-1.
    count : int
        Number of units.
    low, high : ndarray of shape (F, 3), float32
        Box of every face, metres.
    max_faces : int
        Units with more faces are cut.
    max_extent_m : float
        Units whose box has a longer side are cut; a single face never is.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    pieces : ndarray of shape (F,), int32
        Numbers 0..; a piece need not be edge-connected.
    n_pieces : int
        Number of pieces.

    Notes
    -----
    The cut is at a rank of the face boxes' centres along the axis, not at the box's middle: sizes
    stay within a factor of two for any density. Ties at the cut keep face order. Time O(F log(F /
    max_faces)).
    """
    order, starts = _grouped(as_kernel_input(labels, np.int32), count)
    target = max(int(_FILL * max_faces), 1)
    keys = np.empty((len(labels), 3), np.uint32)
    in_chunks(
        lambda begin, end: _ordered_bits(low, high, keys, begin, end), len(labels), threads=threads
    )
    pieces, n_pieces = _split(order, starts, low, high, keys, max_faces, target, max_extent_m)
    return pieces, int(n_pieces)


@numba.njit(cache=True, nogil=True)
def _grouped(labels: Int32, count: int) -> tuple[Int32, Int64]:
    """Faces by label, in face order within each, and where each label's faces begin."""
    starts = np.zeros(count + 1, np.int64)
    for f in range(len(labels)):
        starts[labels[f] + 1] += 1
    for u in range(count):
        starts[u + 1] += starts[u]
    order = np.empty(len(labels), np.int32)
    cursor = starts[:-1].copy()
    for f in range(len(labels)):
        order[cursor[labels[f]]] = f
        cursor[labels[f]] += 1
    return order, starts


@numba.njit(cache=True, nogil=True)
def _ordered_bits(low: Float32, high: Float32, keys: UInt32, begin: int, end: int) -> None:
    """Unsigned integers in the order of the boxes' middles: sign flipped, negatives inverted."""
    one = np.empty(1, np.float32)
    bits = one.view(np.uint32)
    sign = np.uint32(0x80000000)
    for f in range(begin, end):
        for axis in range(3):
            one[0] = low[f, axis] + high[f, axis] + np.float32(0.0)  # -0.0 becomes 0.0
            key = bits[0]
            keys[f, axis] = ~key if key & sign else key | sign


@numba.njit(cache=True, nogil=True)
def _select(
    keys: UInt32, axis: int, order: Int32, start: _Whole, end: _Whole, rank: _Whole
) -> tuple[_Whole, _Whole]:
    """Key of this rank among faces order[start:end], and how many keys lie below it.

    Radix selection, a byte at a time: four passes for any data. (np.partition in numba takes longer
    to compile than all other kernels together.)
    """
    counts = np.empty(256, np.int64)
    prefix = np.int64(0)
    left = rank
    for byte in range(3, -1, -1):
        shift = np.int64(8 * byte)
        counts[:] = 0
        for i in range(start, end):
            key = np.int64(keys[order[i], axis])
            if key >> (shift + 8) == prefix >> (shift + 8):
                counts[(key >> shift) & 255] += 1
        digit = 0
        while left >= counts[digit]:
            left -= counts[digit]
            digit += 1
        prefix |= np.int64(digit) << shift
    return prefix, rank - left


@numba.njit(cache=True, nogil=True)
def _split(
    order: Int32,
    starts: Int64,
    low: Float32,
    high: Float32,
    keys: UInt32,
    max_faces: int,
    target: int,
    max_extent_m: float,
) -> tuple[Int32, int]:
    # Invariant: the ranges on the stack are disjoint slices of `order`, the deepest the one to go
    # on with first; pieces 0..count-1 are finished and within both bounds (or single faces).
    n_faces = len(order)
    pieces = np.empty(n_faces, np.int32)
    spare = np.empty(n_faces, np.int32)
    stack = np.empty((_STACK, 2), np.int64)
    depth = 0
    side = np.empty(3, np.float32)
    count = 0
    for u in range(len(starts) - 1):
        if starts[u] < starts[u + 1]:
            stack[0, 0], stack[0, 1] = starts[u], starts[u + 1]
            depth = 1
        while depth:
            depth -= 1
            start, end = stack[depth, 0], stack[depth, 1]
            n = end - start
            for axis in range(3):
                # (1) Box of the range; the longest side is the one to cut.
                least, most = low[order[start], axis], high[order[start], axis]
                for i in range(start + 1, end):
                    least = min(least, low[order[i], axis])
                    most = max(most, high[order[i], axis])
                side[axis] = most - least
            longest = 0  # ties: x before y before z
            for axis in range(1, 3):
                if side[axis] > side[longest]:
                    longest = axis
            # (2) Into how many pieces; one is finished.
            n_pieces = (n + target - 1) // target if n > max_faces else 1
            if side[longest] > max_extent_m:
                n_pieces = max(n_pieces, 2)
            if n_pieces < 2 or n < 2:
                for i in range(start, end):
                    pieces[order[i]] = count
                count += 1
                continue
            # (3) The cut: as many whole pieces to the left as to the right, by a selection in
            # linear time. Ties of the key go left in face order until `rank` faces are there.
            rank = n * (n_pieces // 2) // n_pieces  # below n, since parts // 2 < parts
            if rank < 1:
                rank += 1
            cut, below = _select(keys, longest, order, start, end, rank)
            level = rank - below  # so many of the faces at the cut go left, in face order
            left, right = start, start + rank
            # (4) Stable partition, back into `order`; the left half is on top of the stack and
            # comes first.
            for i in range(start, end):
                key = np.int64(keys[order[i], longest])
                if key == cut and level > 0:
                    level -= 1
                    key -= 1
                if key < cut:
                    spare[left] = order[i]
                    left += 1
                else:
                    spare[right] = order[i]
                    right += 1
            for i in range(start, end):
                order[i] = spare[i]
            stack[depth, 0], stack[depth, 1] = start + rank, end
            stack[depth + 1, 0], stack[depth + 1, 1] = start, start + rank
            depth += 2
    return pieces, count
