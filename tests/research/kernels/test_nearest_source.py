from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from terraport_research.kernels.nearest_source import nearest_source, rows_of_edges


@pytest.mark.parametrize("seed", range(20))
def test_shortest_ways_and_whose_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 40
    edges = np.unique(np.sort(rng.integers(0, n, (70, 2))), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    lengths = rng.random(len(edges)) + 0.01
    sources = rng.permutation(n)[:3].astype(np.int32)
    distance, nearest = nearest_source(*rows_of_edges(n, edges, lengths), sources)
    graph = coo_matrix((lengths, edges.T), (n, n)).tocsr()
    each = dijkstra(graph, directed=False, indices=sources)
    np.testing.assert_allclose(distance, each.min(axis=0), rtol=1e-12)
    reached = np.isfinite(distance)
    assert (nearest[~reached] == -1).all()
    np.testing.assert_array_equal(nearest[reached], each.argmin(axis=0)[reached])


def test_ways_stay_within_a_label() -> None:
    """A ring of six; labels part it into two rows of three."""
    edges = np.array([[i, (i + 1) % 6] for i in range(6)])
    rows = rows_of_edges(6, edges, np.ones(6))
    labels = np.array([0, 0, 0, 1, 1, 1], np.int32)
    distance, nearest = nearest_source(*rows, np.array([0, 3], np.int32), labels)
    assert distance.tolist() == [0, 1, 2, 0, 1, 2]
    assert nearest.tolist() == [0, 0, 0, 1, 1, 1]
    assert nearest_source(*rows, np.array([0], np.int32))[0].tolist() == [0, 1, 2, 3, 2, 1]
    alone, _ = nearest_source(*rows, np.array([0], np.int32), labels)
    assert np.isinf(alone[3:]).all()
