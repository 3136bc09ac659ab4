"""Occupied blocks of a survey of which only some ground was looked at.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Int64

__all__ = ["fill_blocks"]


def fill_blocks(blocks: Int64, ground: Int64, columns: int, points: int) -> tuple[Int64, Int64]:
    """Add columns of blocks where there must be ground, as high as the nearest that is known.

    Samples count the same in every block: where some ground was looked at and the rest was not, how
    many were seen says nothing.

    Parameters
    ----------
    blocks : ndarray of shape (B, 3), int64
        Indices along x, y (up), z of occupied blocks.
    ground : ndarray of shape (G, 2), int64
        Columns (x, z) that may hold ground, such as those within the files' boxes.
    columns : int
        Columns that the survey has, about; those of `ground` nearest to the known ones are taken.
    points : int
        Samples of the whole survey.

    Returns
    -------
    blocks : ndarray of shape (C, 3), int64
    counts : ndarray of shape (C,), int64
        About `points` together.
    """
    known, first = np.unique(blocks[:, [0, 2]], axis=0, return_index=True)
    missing = columns - len(known)
    added = np.zeros((0, 3), np.int64)
    if missing > 0 and len(ground):
        distances, nearest = cKDTree(known).query(ground)
        order = np.argsort(distances, kind="stable")
        order = order[distances[order] > 0][:missing]
        height = blocks[first[nearest[order]], 1]
        added = np.stack([ground[order, 0], height, ground[order, 1]], axis=1)
    every = np.concatenate([blocks, added])
    return every, np.full(len(every), max(1, round(points / len(every))), np.int64)
