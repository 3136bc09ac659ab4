"""Exact 1-D k-means against every possible partition."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.regions.kmeans_1d import (
    EXACT_VALUES,
    MAX_EXACT_CLUSTERS,
    kmeans_1d,
)


def exact_cost(values, borders):
    """Sum of squares about the means of the intervals, as a fraction."""
    total = Fraction(0)
    for i, j in zip((0, *borders), (*borders, len(values)), strict=True):
        cluster = [Fraction(float(v)) for v in values[i:j]]
        mean = sum(cluster) / len(cluster)
        total += sum((v - mean) ** 2 for v in cluster)
    return total


def borders_of(labels):
    """First index of each cluster but the first."""
    return tuple((np.flatnonzero(np.diff(labels)) + 1).tolist())


def all_partitions(values, k):
    """Every way to cut sorted values into k intervals without separating equal values."""
    firsts = (np.flatnonzero(np.diff(values)) + 1).tolist()
    return combinations(firsts, min(k, len(firsts) + 1) - 1)


@settings(max_examples=150)
@given(
    st.lists(st.floats(-8, 8, width=32) | st.integers(-3, 3).map(float), min_size=1, max_size=11),
    st.integers(1, 5),
)
def test_cost_is_the_least_of_all_partitions(values, k):
    """Optimal to rounding, with equal values together."""
    ordered = np.sort(np.array(values, np.float32))
    labels = kmeans_1d(ordered, k).assign(ordered)
    least = min(exact_cost(ordered, cut) for cut in all_partitions(ordered, k))
    slack = Fraction(1e-9) * (exact_cost(ordered, ()) + Fraction(1e-30))
    assert exact_cost(ordered, borders_of(labels)) <= least + slack
    assert len(np.unique(labels)) == min(k, len(np.unique(ordered)))


def test_ties_go_left():
    """0, 1, 2 into two: {0} {1 2} and {0 1} {2} cost the same; the border lies leftmost."""
    assert kmeans_1d(np.array([0, 1, 2], np.float32), 2).assign(
        np.array([0, 1, 2], np.float32)
    ).tolist() == [0, 1, 1]


def test_many_values_are_nearly_optimal():
    """Beyond the exact size: within 1 % of an independent optimum, and at rest."""
    rng = np.random.default_rng(2)
    ordered = np.sort(rng.gamma(2.0, 1.0, 60_000).astype(np.float32))
    assert len(np.unique(ordered)) > EXACT_VALUES
    clusters = kmeans_1d(ordered, 12)
    labels = clusters.assign(ordered)
    cost = ((ordered - clusters.means[labels]) ** 2).sum()
    # an independent optimum: the exact solver on a sample's quantiles, applied to all values
    sample = np.quantile(ordered, (np.arange(4000) + 0.5) / 4000).astype(np.float32)
    means = kmeans_1d(sample, 12).means
    nearest = np.abs(ordered[:, None] - means).min(axis=1)
    assert cost <= 1.01 * (nearest**2).sum()
    centres = np.array([ordered[labels == c].mean(dtype=np.float64) for c in range(12)])
    np.testing.assert_allclose(clusters.means, centres, rtol=1e-9)


def test_thousands_of_clusters_stay_bounded():
    """A threshold far too small asks for more clusters than the table may hold."""
    ordered = np.sort(np.random.default_rng(3).random(20_000).astype(np.float32))
    clusters = kmeans_1d(ordered, MAX_EXACT_CLUSTERS + 500)
    assert len(clusters.means) == MAX_EXACT_CLUSTERS + 500
    assert (np.diff(clusters.means) > 0).all()


def test_more_clusters_than_values():
    """Every distinct value is then its own cluster."""
    ordered = np.array([1, 1, 2, 5, 5], np.float32)
    assert kmeans_1d(ordered, 9).assign(ordered).tolist() == [0, 0, 1, 2, 2]


def test_bad_input_is_named():
    """Nothing to cluster, no clusters, or values out of order."""
    with pytest.raises(ValueError, match="received 0 values and k = 2"):
        kmeans_1d(np.zeros(0, np.float32), 2)
    with pytest.raises(ValueError, match="received 1 values and k = 0"):
        kmeans_1d(np.zeros(1, np.float32), 0)
    with pytest.raises(ValueError, match=r"value 2 is 1.0 after 3.0, expected ascending"):
        kmeans_1d(np.array([0, 3, 1], np.float32), 2)
    with pytest.raises(ValueError, match=r"value 1 is nan after 0.0"):
        kmeans_1d(np.array([0, np.nan], np.float32), 2)
