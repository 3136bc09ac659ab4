"""The sieve loses no point within a radius, and keeps few far ones."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.near_filter import may_be_near


@pytest.mark.parametrize("seed", range(20))
def test_no_near_point_is_lost(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-50, 50, (4000, 3)) * [1, rng.choice([0.0, 0.01, 1.0]), 1]
    queries = rng.uniform(-60, 60, (int(rng.integers(1, 12)), 3))
    radius = rng.choice([0.0, 1e-9, 2.0, 30.0], len(queries))
    queries[0] = points[7]  # a distance of zero counts
    kept = may_be_near(points, queries, radius, threads=1 + seed % 2)
    distance = np.linalg.norm(points[:, None] - queries[None], axis=2)
    assert kept[(distance <= radius).any(axis=1)].all()


def test_points_exactly_on_the_radius_stay():
    points = np.array([[3.0, 4.0, 0.0], [0.0, -5.0, 0.0], [500.0, 0.0, 0.0]])
    kept = may_be_near(points, np.zeros((1, 3)), np.array([5.0]))
    assert kept.tolist() == [True, True, False]


def test_far_points_go():
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 1000, (20000, 3))
    kept = may_be_near(points, np.array([[10.0, 10, 10], [990, 990, 990]]), np.array([5.0, 5.0]))
    assert kept.sum() < 30


def test_one_place_and_no_radius():
    points = np.zeros((3, 3))
    assert may_be_near(points, np.zeros((1, 3)), np.zeros(1)).all()
