"""Votes go along the ground up to the next border."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from terraport_pipeline.geometry.learning.unit_votes import evened_out


def chain(holds: list[float]) -> csr_array:
    """Units in a row; how strongly each hangs together with the next."""
    low = np.arange(len(holds))
    one_way = coo_array((holds, (low, low + 1)), shape=(len(holds) + 1,) * 2)
    return (one_way + one_way.T).tocsr()


def test_the_answer_is_where_walks_end() -> None:
    rng = np.random.default_rng(0)
    hold = chain(rng.uniform(0.001, 1.0, 39).tolist())
    votes = rng.dirichlet((1.0, 1.0, 1.0), 40).astype(np.float32)
    found = evened_out(votes, hold)
    # By elimination: ending counts .05.
    dense = hold.toarray()
    system = 0.05 * np.eye(40) + np.diag(dense.sum(axis=1)) - dense
    exact = np.linalg.solve(system, 0.05 * votes.astype(np.float64))
    assert np.abs(found - exact).max() < 0.02
    assert np.abs(found.sum(axis=1) - 1.0).max() < 1e-9
    assert (found >= 0.0).all()


def test_one_unit_is_outvoted_and_a_border_stops_votes() -> None:
    votes = np.array([[0.9, 0.1], [0.1, 0.9]], np.float32).repeat(10, axis=0)
    votes[4] = (0.2, 0.8)  # noise among the first ten
    found = evened_out(votes, chain([1.0] * 9 + [0.001] + [1.0] * 9))
    assert (found[:10, 0] > 0.7).all()
    assert (found[10:, 1] > 0.8).all()
    blurred = evened_out(votes, chain([1.0] * 19))
    assert blurred[9, 0] < found[9, 0] - 0.1
