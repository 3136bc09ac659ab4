"""Pieces that are too small to mean anything join what lies beside them.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float64, Int32
from terraport_pipeline.geometry.mesh.adjacency import components

__all__ = ["absorb_small"]

_MOST_ROUNDS: Final = 32
"""A round at least halves chains of small pieces."""


def absorb_small(
    labels: Int32,
    pairs: tuple[Int32, Int32],
    vertices: AnyFloat,
    size: AnyFloat | AnyInt,
    least: float,
    *,
    movable: Bool | None = None,
) -> Int32:
    """Give small connected pieces the label of what they touch most.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        Of the faces, >= 0.
    pairs : pair of ndarray of shape (P, 2), int32
        From ``face_pairs``.
    vertices : ndarray of shape (V, 3)
        Metres.
    size : ndarray of shape (F,)
        What a face counts: 1, or its area.
    least : float
        Connected pieces of one label below it are small.
    movable : ndarray of shape (F,), bool, optional
        Only pieces of these faces join others.

    Returns
    -------
    ndarray of shape (F,), int32
        A small piece has the label of the larger piece with the longest common border (of equals
        that of the lower first face), round by round from the outside inwards. One that touches
        nothing larger keeps its own.
    """
    neighbours, edges = pairs
    labels = labels.astype(np.int32)
    for _ in range(_MOST_ROUNDS):
        piece, count = components(len(labels), neighbours, labels=labels)
        total = np.bincount(piece, size, minlength=count)
        small = total < least
        if movable is not None:
            small[piece[~movable]] = False
        a, b = piece[neighbours[:, 0]], piece[neighbours[:, 1]]
        apart = a != b
        one = np.concatenate([a[apart], b[apart]]).astype(np.int64)
        other = np.concatenate([b[apart], a[apart]]).astype(np.int64)
        # Of borders alone: most pairs are within a piece.
        ends = edges[apart]
        along = vertices[ends[:, 0]].astype(np.float64) - vertices[ends[:, 1]]
        length: Float64 = np.sqrt((along * along).sum(axis=1))
        border = np.concatenate([length, length])
        # Only towards what is larger, so that no two change places for ever.
        larger = (total[other] > total[one]) | ((total[other] == total[one]) & (other < one))
        kept = small[one] & larger
        if not kept.any():
            break
        keys, at = np.unique(one[kept] * count + other[kept], return_inverse=True)
        small_one, beside = np.divmod(keys, count)
        order = np.lexsort((-beside, np.bincount(at, border[kept])))
        joins = np.full(count, -1, np.int64)
        joins[small_one[order]] = beside[order]  # the last written is the longest border
        label_of_piece = np.empty(count, np.int32)
        label_of_piece[piece] = labels
        moves = np.flatnonzero(joins >= 0)
        moved = label_of_piece.copy()
        moved[moves] = label_of_piece[joins[moves]]
        labels = moved[piece]
    return labels
