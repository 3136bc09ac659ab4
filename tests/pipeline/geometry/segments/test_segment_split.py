"""Cutting units: bounds, balance, order."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.segments.segment_split import split_units


def boxes(centres):
    """Boxes of 0.1 m about positions."""
    centres = np.asarray(centres, np.float32)
    return centres - np.float32(0.05), centres + np.float32(0.05)


@pytest.mark.parametrize("seed", range(20))
def test_pieces_keep_bounds_and_never_mix_units(seed):
    """Random clouds with ties, negative coordinates, clusters."""
    rng = np.random.default_rng(seed)
    centres = np.round(rng.normal(0, 20, (500, 3)) * rng.choice([0.01, 1, 3], 3), seed % 3)
    labels = rng.integers(0, 4, 500).astype(np.int32)
    low, high = boxes(centres)
    pieces, count = split_units(labels, 4, low, high, 30, 25.0)
    assert sorted(set(pieces.tolist())) == list(range(count))
    for p in range(count):
        mine = pieces == p
        assert len(set(labels[mine].tolist())) == 1
        assert np.count_nonzero(mine) <= 30
        assert (high[mine].max(axis=0) - low[mine].min(axis=0)).max() <= 25.0


def test_cut_is_at_the_rank():
    """Six faces in two: the three leftmost by position, whatever their order in the file."""
    x = np.array([5.0, -1.0, 3.0, -7.0, 0.0, 9.0])
    low, high = boxes(np.stack([x, 0 * x, 0 * x], axis=1))
    pieces, _ = split_units(np.zeros(6, np.int32), 1, low, high, 4, 1000.0)
    assert pieces.tolist() == [1, 0, 1, 0, 0, 1]


def test_ties_keep_face_order():
    """All in one place: equal shares in face order."""
    low, high = boxes(np.zeros((8, 3)))
    pieces, count = split_units(np.zeros(8, np.int32), 1, low, high, 5, 1000.0)
    assert (pieces.tolist(), count) == ([0] * 4 + [1] * 4, 2)


def test_units_within_bounds_stay_whole():
    """No cut without need, and a single wide face is never cut."""
    low, high = np.zeros((3, 3), np.float32), np.full((3, 3), 50, np.float32)
    pieces, count = split_units(np.array([0, 0, 1], np.int32), 2, low, high, 2, 100.0)
    assert (pieces.tolist(), count) == ([0, 0, 1], 2)
    pieces, count = split_units(np.array([0, 1, 2], np.int32), 3, low, high, 2, 10.0)
    assert count == 3
