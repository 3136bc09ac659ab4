"""Least cuts against SciPy's flow, and labels against all that there are."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import maximum_flow

from terraport_research.kernels.graph_cut import arcs_of_pairs, expand_labels, least_cut


def test_cuts_cost_what_flows() -> None:
    rng = np.random.default_rng(0)
    for n in (2, 5, 20, 60):
        both = rng.integers(0, n, (4 * n, 2))
        pairs = np.unique(np.sort(both[both[:, 0] != both[:, 1]], axis=1), axis=0)
        there, back = rng.integers(0, 9, (2, len(pairs))).astype(float)
        pull = rng.integers(-12, 13, n).astype(float)
        near = least_cut(arcs_of_pairs(n, pairs), there, back, pull)
        a, b = pairs.T
        cost = there[near[a] & ~near[b]].sum() + back[~near[a] & near[b]].sum()
        cost += np.maximum(pull, 0)[~near].sum() + np.maximum(-pull, 0)[near].sum()
        ends = np.arange(n)
        from_, to = np.full(n, n), np.full(n, n + 1)
        flow = maximum_flow(
            coo_matrix(
                (
                    np.concatenate([there, back, np.maximum(pull, 0), np.maximum(-pull, 0)]),
                    (np.concatenate([a, b, from_, ends]), np.concatenate([b, a, ends, to])),
                ),
                (n + 2, n + 2),
            ).astype(np.int32).tocsr(),
            n, n + 1,
        )  # fmt: skip
        assert cost == flow.flow_value


def test_two_labels_are_the_best_and_more_are_not_worse_than_alone() -> None:
    rng = np.random.default_rng(3)
    pairs = np.array([(i, j) for i in range(8) for j in range(i) if rng.random() < 0.4], np.int32)
    weights = rng.random(len(pairs))
    for labels in (2, 3):
        # Costs below 0 are costs too: likelihoods above 1 have them.
        costs = 2.0 * rng.random((8, labels)) - 1.0

        def energy(chosen: np.ndarray, costs: np.ndarray = costs) -> float:
            apart = chosen[pairs[:, 0]] != chosen[pairs[:, 1]]
            return float(costs[np.arange(8), chosen].sum() + weights[apart].sum())

        start = costs.argmin(axis=1).astype(np.int32)
        found = expand_labels(start, costs, pairs, weights)
        least = min(energy(np.array(one)) for one in product(range(labels), repeat=8))
        assert energy(found) <= energy(start)
        if labels == 2:
            assert abs(energy(found) - least) < 1e-3
