"""Rows of neighbours: small graphs with the answer written out, and random ones by plain loops."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.unit_rows import (
    combine_rows,
    contract_rows,
    pairs_of_rows,
    row_sums,
    rows_of_labels,
    rows_of_pairs,
)

SQUARE = np.array([[0, 1], [1, 2], [2, 3], [0, 3]], np.int32)
"""Four units in a ring."""
LENGTHS = np.array([5, 7, 11, 13], np.int64)


def as_lists(rows):
    offsets, neighbours, border = rows
    return [
        list(zip(neighbours[a:b].tolist(), border[a:b].tolist(), strict=True))
        for a, b in itertools.pairwise(offsets)
    ]


def test_a_ring():
    rows = rows_of_pairs(4, SQUARE, LENGTHS)
    assert as_lists(rows) == [
        [(1, 5), (3, 13)],
        [(0, 5), (2, 7)],
        [(1, 7), (3, 11)],
        [(2, 11), (0, 13)],
    ]
    assert row_sums(rows[0], rows[2]).tolist() == [18, 12, 18, 24]
    pairs, weight = pairs_of_rows(*combine_rows(*rows))
    assert pairs.tolist() == [[0, 1], [0, 3], [1, 2], [2, 3]]
    assert weight.tolist() == [5, 13, 7, 11]


def test_united_units_share_a_row_and_their_borders_are_added():
    rows = rows_of_pairs(4, SQUARE, LENGTHS)
    halves = contract_rows(*rows, np.array([0, 0, 1, 1], np.int32), 2)
    assert as_lists(halves) == [[(1, 20)], [(0, 20)]]
    whole = contract_rows(*rows, np.zeros(4, np.int32), 1)
    assert as_lists(whole) == [[]]


@pytest.mark.parametrize("seed", range(20))
def test_random_labels_against_plain_loops(seed):
    rng = np.random.default_rng(seed)
    items, count = int(rng.integers(2, 30)), int(rng.integers(1, 8))
    labels = rng.integers(0, count, items).astype(np.int32)
    pairs = np.array(
        [(a, b) for a in range(items) for b in range(a) if rng.random() < 0.2], np.int32
    )
    pairs = pairs.reshape(-1, 2)
    lengths = rng.integers(1, 100, len(pairs))
    expected = [{} for _ in range(count)]
    for (a, b), length in zip(pairs.tolist(), lengths.tolist(), strict=True):
        u, v = labels[a], labels[b]
        if u != v:
            expected[u][v] = expected[u].get(v, 0) + length
            expected[v][u] = expected[v].get(u, 0) + length
    sorted_rows = [sorted((int(v), n) for v, n in row.items()) for row in expected]
    combined = combine_rows(*rows_of_labels(labels, count, pairs, lengths))
    assert as_lists(combined) == sorted_rows
    single = rows_of_pairs(items, pairs, lengths)
    assert as_lists(contract_rows(*single, labels, count)) == sorted_rows
