"""Where loose pieces go."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.segments.segment_debris import DebrisCounts, join_debris
from terraport_pipeline.geometry.segments.unit_graph import Units


def gather(x, sizes, touching, **bounds):
    """Units of `sizes` faces at positions x, all faces in one spot; the group of each unit."""
    labels = np.repeat(np.arange(len(x)), sizes).astype(np.int32)
    centre = np.stack([np.array(x, float), np.zeros(len(x)), np.zeros(len(x))], axis=1)
    low = (centre - 0.5).astype(np.float32)
    high = (centre + 0.5).astype(np.float32)
    size = np.array(sizes, np.int64)
    units = Units(size, size.astype(float), np.zeros(len(x), np.int32), low, high)
    groups, counts = join_debris(
        labels, units, np.array(touching), low[labels], high[labels], min_faces=5, **bounds
    )
    first = np.cumsum(sizes) - sizes
    return groups[first].tolist(), counts


def test_nearest_segment_that_has_room():
    """The nearer segment is full, so the piece goes to the next."""
    groups, counts = gather(
        [0.0, 3.0, 2.0], [7, 6, 2], [False, False, False], max_faces=8, max_extent_m=20.0
    )
    assert groups == [0, 1, 1]
    assert counts == DebrisCounts(joined=1, alone=0)
    groups, _ = gather([0.0, 3.0, 1.0], [7, 6, 2], [False] * 3, max_faces=8, max_extent_m=20.0)
    assert groups == [0, 1, 1]


def test_out_of_reach_or_bounds_stays_alone():
    """Beyond a quarter of the extent nothing is joined; nor where the box would grow too wide."""
    groups, counts = gather([0.0, 9.0], [9, 2], [False] * 2, max_faces=99, max_extent_m=20.0)
    assert (groups, counts) == ([0, 1], DebrisCounts(joined=0, alone=1))


def test_pieces_gather_until_large_enough():
    """Five pieces of two faces in a row: three make six faces, the other two stay together."""
    groups, counts = gather(
        [0.0, 1.0, 2.0, 3.0, 4.0], [2] * 5, [False] * 5, max_faces=99, max_extent_m=100.0
    )
    assert groups == [0, 0, 0, 1, 1]
    assert counts == DebrisCounts(joined=5, alone=0)


def test_what_touches_something_is_no_debris():
    """Small but attached: left to the merge."""
    groups, counts = gather([0.0, 1.0], [9, 2], [True, True], max_faces=99, max_extent_m=20.0)
    assert (groups, counts) == ([0, 1], DebrisCounts())
