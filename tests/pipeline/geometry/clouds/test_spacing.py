from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from terraport_pipeline.geometry.clouds.spacing import (
    estimate_spacing,
    nearest_neighbours,
    remaining_neighbours,
)


def grid(side: int, step_m: float) -> np.ndarray:
    x, z = np.meshgrid(np.arange(side) * step_m, np.arange(side) * step_m)
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)


def test_neighbours_are_the_nearest_others() -> None:
    points = np.random.default_rng(1).normal(size=(500, 3))
    neighbours = nearest_neighbours(points, 5)
    distance_m = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance_m, np.inf)
    expected = np.sort(distance_m, axis=1)[:, :5]
    assert np.allclose(neighbours.distances, expected, rtol=1e-6)
    assert (neighbours.indices != np.arange(500)[:, None]).all()


def test_a_point_is_never_its_own_neighbour_even_among_copies() -> None:
    points = np.repeat(np.random.default_rng(2).normal(size=(30, 3)), 4, axis=0)
    neighbours = nearest_neighbours(points, 3)
    assert (neighbours.indices != np.arange(120)[:, None]).all()
    assert (neighbours.distances[:, :3] == 0).all()


@pytest.mark.parametrize("workers", [1, 2])
def test_neighbours_do_not_depend_on_threads(workers: int) -> None:
    points = np.random.default_rng(3).normal(size=(2000, 3))
    expected = nearest_neighbours(points, 8, workers=1)
    neighbours = nearest_neighbours(points, 8, workers=workers)
    assert (neighbours.indices == expected.indices).all()


def test_fewer_points_than_asked_give_what_there_is() -> None:
    assert nearest_neighbours(np.eye(3), 16).indices.shape == (3, 2)
    with pytest.raises(ValueError, match="received 1 points"):
        nearest_neighbours(np.zeros((1, 3)), 4)


def test_remaining_neighbours_equal_a_fresh_search() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(800, 3))
    removed = rng.random(800) < 0.1
    updated = remaining_neighbours(points, nearest_neighbours(points, 6), removed)
    fresh = nearest_neighbours(points[~removed], 6)
    assert (updated.indices == fresh.indices).all()
    assert (updated.distances == fresh.distances).all()


def test_removing_nothing_changes_nothing() -> None:
    points = np.random.default_rng(5).normal(size=(100, 3))
    before = nearest_neighbours(points, 6)
    after = remaining_neighbours(points, before, np.zeros(100, dtype=bool))
    assert (after.indices == before.indices).all()


def test_areal_spacing_of_random_samples_is_the_root_of_area_per_sample() -> None:
    rng = np.random.default_rng(6)
    points = np.column_stack(
        [rng.uniform(0, 50, 10_000), np.zeros(10_000), rng.uniform(0, 50, 10_000)]
    )
    spacing = estimate_spacing(nearest_neighbours(points, 16))
    assert spacing.areal_m == pytest.approx(0.5, rel=0.05)
    assert spacing.median_m < 0.3


def test_areal_spacing_of_a_grid_is_its_step() -> None:
    spacing = estimate_spacing(nearest_neighbours(grid(60, 0.25), 12))
    assert spacing.areal_m == pytest.approx(0.25, rel=0.05)
    assert spacing.median_m == pytest.approx(0.25)


def test_areal_spacing_survives_overlapping_scans() -> None:
    """Twenty copies of one strip, jittered, must not make the whole survey look dense."""
    rng = np.random.default_rng(7)
    ground = np.column_stack([rng.uniform(0, 50, 5000), np.zeros(5000), rng.uniform(0, 50, 5000)])
    strip = np.repeat(ground[ground[:, 0] < 2.5], 4, axis=0)
    strip += rng.normal(0, 0.005, strip.shape)
    both = np.concatenate([ground, strip])
    spacing = estimate_spacing(nearest_neighbours(both, 16))
    assert 0.6 < spacing.areal_m < 0.75
    assert cKDTree(both).n == len(both)
