from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.clouds.outliers import duplicate_mask, outlier_mask
from terraport_pipeline.geometry.clouds.spacing import nearest_neighbours


@given(st.lists(st.tuples(*[st.sampled_from([0.0, -0.0, 1.0, 2.5, 1e7])] * 3), max_size=40))
@settings(max_examples=60)
def test_duplicates_are_exactly_the_rows_seen_before(rows: list[tuple[float, ...]]) -> None:
    points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    seen: set[tuple[float, ...]] = set()
    expected = []
    for row in points.tolist():
        key = tuple(value + 0.0 for value in row)
        expected.append(key in seen)
        seen.add(key)
    assert duplicate_mask(points).tolist() == expected


def test_points_a_float32_step_apart_are_not_duplicates() -> None:
    points = np.array([[641200.0, 8594700.0, 1.0], [641200.0, 8594700.01, 1.0]])
    assert not duplicate_mask(points).any()


def ground(rng: np.random.Generator, count: int, low: float, high: float) -> np.ndarray:
    x, z = rng.uniform(low, high, (2, count))
    return np.column_stack([x, 0.3 * np.sin(x), z])


def test_lone_points_above_the_ground_are_outliers() -> None:
    rng = np.random.default_rng(1)
    lone = np.column_stack([rng.uniform(2, 18, 20), rng.uniform(4, 30, 20), rng.uniform(2, 18, 20)])
    points = np.concatenate([ground(rng, 4000, 0, 20), lone])
    mask = outlier_mask(nearest_neighbours(points, 16))
    assert mask[4000:].mean() >= 0.9
    assert mask[:4000].mean() < 0.002


def test_thinly_sampled_ground_is_kept() -> None:
    """A tenth of the density next door is not a reason to go."""
    rng = np.random.default_rng(2)
    dense, thin = ground(rng, 8000, 0, 20), ground(rng, 400, 20, 36)
    mask = outlier_mask(nearest_neighbours(np.concatenate([dense, thin]), 16))
    assert mask[8000:].mean() < 0.02


def test_larger_ratio_keeps_more() -> None:
    rng = np.random.default_rng(3)
    points = np.concatenate([ground(rng, 2000, 0, 20), rng.uniform(0, 20, (60, 3))])
    neighbours = nearest_neighbours(points, 16)
    strict = outlier_mask(neighbours, ratio=2.0, deviations=0.0)
    loose = outlier_mask(neighbours, ratio=8.0, deviations=0.0)
    assert strict.sum() > loose.sum()
    assert not (loose & ~strict).any()
