"""Refining on rows of pools whose answer can be read off (the oracle: test_triangle_pool.py)."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.regions.pool_refine import (
    join_nearest,
    number_by_first,
    refine_pools,
)


def refine(sizes, means, smallest, links=None):
    """Refine pools standing in a row (or linked as told); the group and state of each pool."""
    labels = np.repeat(np.arange(len(sizes)), sizes).astype(np.int32)
    first = np.cumsum(sizes) - sizes
    links = [(i, i + 1) for i in range(len(sizes) - 1)] if links is None else links
    pairs = np.array([(first[a], first[b]) for a, b in links], np.int32).reshape(-1, 2)
    similarity = np.array(means, np.float32)[labels]
    groups, unreached = refine_pools(labels, len(sizes), pairs, similarity, smallest)
    return groups[first].tolist(), unreached.tolist()


def test_small_pools_join_the_nearer_mean():
    """0.2 goes to 0.0, 0.8 to 1.0; a tie goes to the larger pool."""
    assert refine([9, 1, 9], [0.0, 0.2, 1.0], 5) == ([0, 0, 1], [False, False])
    assert refine([9, 1, 9], [0.0, 0.8, 1.0], 5) == ([0, 1, 1], [False, False])
    assert refine([8, 1, 9], [0.0, 0.5, 1.0], 5) == ([0, 1, 1], [False, False])
    assert refine([9, 1, 9], [0.0, 0.5, 1.0], 5) == ([0, 0, 1], [False, False])


def test_rounds_reach_pools_behind_pools():
    """A chain of small pools is taken from both ends; the middle meets both and chooses."""
    assert refine([9, 1, 1, 1, 9], [0, 1, 0.1, 0, 1], 5)[0] == [0, 0, 0, 1, 1]


def test_without_a_large_pool_the_alike_unite_first():
    """Pairs of like pools become large enough; what is left joins them."""
    groups, unreached = refine([3, 3, 1, 3, 3], [0.0, 0.1, 0.3, 0.9, 1.0], 6)
    assert groups == [0, 0, 0, 1, 1]
    assert unreached == [False, False]


def test_islands_are_told():
    """A lone small pool has nothing to join; a pair unites and is still small."""
    assert refine([9, 2], [0.0, 0.0], 5, links=[]) == ([0, 1], [False, True])
    assert refine([9, 1, 1], [0.0, 0.0, 0.5], 5, links=[(1, 2)]) == ([0, 1, 1], [False, True])


def test_islands_join_the_nearest_face():
    """Centre to centre, ties to the lowest face."""
    x = np.array([0.0, 10.0, 6.0, 5.0])
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 0, 3]])
    vertices = (corners[None] + 3 * x[:, None, None] * [1, 0, 0]).reshape(-1, 3)
    faces = np.arange(12).reshape(4, 3)
    groups = np.array([0, 1, 2, 3], np.int32)
    lost = np.array([False, False, True, False])
    assert join_nearest(vertices, faces, groups, lost).tolist() == [0, 1, 3, 3]
    lost = np.array([False, False, False, True])
    assert join_nearest(vertices, faces, groups, lost).tolist() == [0, 1, 2, 2]
    lost = np.array([False, False, True, True])
    tie = np.array(
        [0, 1, 2, 2], np.int32
    )  # face 3 at 5 is as far from 0 as from 10, but 2 is nearer
    assert join_nearest(vertices, faces, tie, lost[:3]).tolist() == [0, 1, 1, 1]


def test_numbering():
    """By first appearance."""
    numbered, count = number_by_first(np.array([7, 2, 7, 0], np.int32))
    assert (numbered.tolist(), count) == ([0, 1, 0, 2], 3)
