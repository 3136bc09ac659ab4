"""The graph of units against dictionaries; the two joins on graphs drawn by hand."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from terraport_pipeline.geometry.segments.unit_graph import (
    Units,
    contract,
    join_small,
    join_within_bounds,
    merge_units,
    unit_graph,
)


def contacts_by_dictionary(labels, pairs, lengths):
    """Border length of every ordered pair of different units."""
    total = Counter()
    for (a, b), length in zip(pairs.tolist(), lengths.tolist(), strict=True):
        if labels[a] != labels[b]:
            total[labels[a], labels[b]] += length
            total[labels[b], labels[a]] += length
    return dict(total)


def contacts(graph):
    """The same of a graph; rows must be sorted and hold each neighbour once."""
    borders = {}
    for u in range(len(graph.offsets) - 1):
        row = graph.neighbours[graph.offsets[u] : graph.offsets[u + 1]].tolist()
        assert row == sorted(set(row))
        for v, border in zip(row, graph.border[graph.offsets[u] :].tolist(), strict=False):
            borders[u, v] = border
    return borders


def random_contacts(seed):
    """Labels of 40 faces in 9 units, and random pairs with lengths."""
    rng = np.random.default_rng(seed)
    labels = np.concatenate([np.arange(9), rng.integers(0, 9, 31)]).astype(np.int32)
    return labels, rng.integers(0, 40, (120, 2)).astype(np.int32), rng.integers(1, 50, 120)


@pytest.mark.parametrize("seed", range(20))
def test_graph_and_contraction_equal_the_dictionary(seed):
    """Borders add up, before and after units are united."""
    labels, pairs, lengths = random_contacts(seed)
    graph = unit_graph(labels, 9, pairs, lengths)
    assert contacts(graph) == contacts_by_dictionary(labels.tolist(), pairs, lengths)
    nodes = np.array([0, 1, 0, 2, 2, 1, 3, 3, 3], np.int32)
    joined = contacts(contract(graph, nodes, 4))
    assert joined == contacts_by_dictionary(nodes[labels].tolist(), pairs, lengths)


def row_of_units(sizes, means, regions, width=10.0):
    """Units side by side along x; neighbours share a border of 5."""
    n = len(sizes)
    pairs = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1).astype(np.int32)
    graph = unit_graph(np.arange(n, dtype=np.int32), n, pairs, np.full(n - 1, 5))
    size = np.array(sizes, np.int64)
    low = np.stack([np.arange(n) * width, np.zeros(n), np.zeros(n)], axis=1).astype(np.float32)
    units = Units(
        size, size * np.array(means, float), np.array(regions, np.int32), low, low + width
    )
    return graph, units


def test_small_units_join_the_most_similar_of_their_region():
    """Unit 1 is alike to 2 but of another region; unit 3 may join none until borders open."""
    graph, units = row_of_units([9, 2, 9, 3], [0.0, 0.9, 1.0, 1.0], [0, 0, 1, 2])
    assert join_small(graph, units, 5, across_regions=False).tolist() == [0, 0, 2, 3]
    assert join_small(graph, units, 5, across_regions=True).tolist() == [0, 1, 1, 1]


def test_joins_within_bounds_keep_both():
    """Too many faces on the left, too wide on the right: nothing; with either eased: a join."""
    graph, units = row_of_units([9, 2, 5], [0.0, 0.0, 0.0], [0, 0, 0])
    bounds = {"across_regions": False}
    assert join_within_bounds(graph, units, 3, 10, 15.0, **bounds).tolist() == [0, 1, 2]
    assert join_within_bounds(graph, units, 3, 10, 25.0, **bounds).tolist() == [0, 1, 1]
    assert join_within_bounds(graph, units, 3, 11, 25.0, **bounds).tolist() == [0, 0, 2]


def test_two_joins_never_overfill_a_unit():
    """Both neighbours want the middle, which has room for one: the smaller goes first."""
    graph, units = row_of_units([3, 5, 2], [0.0, 0.0, 0.0], [0, 0, 0])
    parent = join_within_bounds(graph, units, 4, 8, 99.0, across_regions=False)
    assert parent.tolist() == [0, 1, 1]


def test_facts_of_unions():
    """Sizes and sums add, boxes unite, the region is the largest unit's."""
    _, units = row_of_units([2, 3, 3, 4], [1.0, 2.0, 0.0, 1.0], [5, 6, 7, 8])
    union = merge_units(units, np.array([0, 0, 0, 1], np.int32), 2)
    assert union.size.tolist() == [8, 4]
    assert union.total.tolist() == [8.0, 4.0]
    assert union.region.tolist() == [6, 8]
    assert union.low[:, 0].tolist() == [0.0, 30.0]
    assert union.high[:, 0].tolist() == [30.0, 40.0]
