"""Numbers of a new version's segments: a payload that did not change keeps its number.

Clients know payloads by their content (``spec/protocol.md``, section 1), whatever their numbers.
Addresses of segments, 3D Tiles and what people note down go by the number.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import defaultdict, deque

import numpy as np

from terraport_payload.types import Bool, Int32, UInt32, UInt64

__all__ = ["carry_segment_ids", "renumber_rows"]


def carry_segment_ids(hashes: UInt64, before: UInt64) -> tuple[Int32, Bool]:
    """Give payloads of the version before their old numbers, and the others those in between.

    Parameters
    ----------
    hashes : ndarray of shape (S,), uint64
        Of the payloads, in the order of the curve that a new scene is numbered along.
    before : ndarray of shape (T,), uint64
        Of the payloads of the version before, by number.

    Returns
    -------
    ids : ndarray of shape (S,), int32
        A permutation of 0 to S - 1. Numbers that nobody holds are given in the order of the curve.
    held : ndarray of shape (S,), bool
        Segments that have their old number. A number of S or more cannot be held. Of several equal
        payloads the first along the curve has the lowest of their old numbers.

    Examples
    --------
    >>> ids, held = carry_segment_ids(np.array([5, 6, 7], np.uint64), np.array([7, 9], np.uint64))
    >>> ids.tolist(), held.tolist()
    ([1, 2, 0], [False, False, True])
    """
    count = len(hashes)
    waiting: defaultdict[int, deque[int]] = defaultdict(deque)
    for segment, value in enumerate(hashes.tolist()):
        waiting[value].append(segment)
    ids = np.full(count, -1, np.int32)
    for number, value in enumerate(before[:count].tolist()):
        if waiting.get(value):
            ids[waiting[value].popleft()] = number
    held: Bool = ids >= 0
    is_free = np.ones(count, np.bool_)
    is_free[ids[held]] = False
    ids[~held] = np.flatnonzero(is_free)
    return ids, held


def renumber_rows(offsets: UInt32, segments: UInt32, ids: Int32) -> UInt32:
    """Rename the segments of CSR rows, ascending within a row as before.

    Parameters
    ----------
    offsets : ndarray of shape (K + 1,), uint32
    segments : ndarray of shape (N,), uint32
    ids : ndarray of shape (S,), int32
        New number of every segment.
    """
    renamed = ids[segments]
    starts = offsets.astype(np.int64)
    row = np.repeat(np.arange(len(offsets) - 1), starts[1:] - starts[:-1])
    return renamed[np.lexsort((renamed, row))].astype(np.uint32)
