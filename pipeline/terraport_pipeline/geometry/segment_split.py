"""Split units that are too big or too wide into compact pieces of nearly equal face counts.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["split_units"]

_Float32 = npt.NDArray[np.float32]
_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]

_FILL: Final = 0.8
"""Pieces aim at this share of ``max_faces``, so that they can take up crumbs of their neighbours
afterwards."""


def split_units(
    labels: _Int32, count: int, low: _Float32, high: _Float32, max_faces: int, max_extent_m: float
) -> tuple[_Int32, int]:
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
    order = np.argsort(labels, kind="stable").astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(np.bincount(labels, minlength=count))])
    target = max(int(_FILL * max_faces), 1)
    pieces, n_pieces = _split(order, starts, low, high, max_faces, target, max_extent_m)
    return pieces, int(n_pieces)


@numba.njit(cache=True)
def _split(
    order: _Int32,
    starts: _Int64,
    low: _Float32,
    high: _Float32,
    max_faces: int,
    target: int,
    max_extent_m: float,
) -> tuple[_Int32, int]:
    n_faces = len(order)
    pieces = np.empty(n_faces, np.int32)
    spare = np.empty(n_faces, np.int32)
    keys = np.empty(n_faces, np.float32)
    stack = [(np.int64(0), np.int64(0))]
    stack.pop()
    side = np.empty(3, np.float32)
    count = 0
    for u in range(len(starts) - 1):
        if starts[u] < starts[u + 1]:
            stack.append((starts[u], starts[u + 1]))
        while len(stack):
            start, end = stack.pop()
            n = end - start
            for axis in range(3):
                least, most = low[order[start], axis], high[order[start], axis]
                for i in range(start + 1, end):
                    least = min(least, low[order[i], axis])
                    most = max(most, high[order[i], axis])
                side[axis] = most - least
            longest = 0  # ties: x before y before z
            for axis in range(1, 3):
                if side[axis] > side[longest]:
                    longest = axis
            parts = (n + target - 1) // target if n > max_faces else 1
            if side[longest] > max_extent_m:
                parts = max(parts, 2)
            if parts < 2 or n < 2:
                for i in range(start, end):
                    pieces[order[i]] = count
                count += 1
                continue
            rank = n * (parts // 2) // parts  # below n, since parts // 2 < parts
            if rank < 1:
                rank += 1
            for i in range(start, end):
                keys[i] = low[order[i], longest] + high[order[i], longest]
            cut = np.partition(keys[start:end], rank)[rank]
            below = 0
            for i in range(start, end):
                if keys[i] < cut:
                    below += 1
            level = rank - below  # so many of the faces at the cut go left, in face order
            left, right = start, start + rank
            for i in range(start, end):
                go_left = keys[i] < cut
                if keys[i] == cut and level > 0:
                    go_left = True
                    level -= 1
                if go_left:
                    spare[left] = order[i]
                    left += 1
                else:
                    spare[right] = order[i]
                    right += 1
            order[start:end] = spare[start:end]
            stack.append((start + rank, end))
            stack.append((start, start + rank))
    return pieces, count
