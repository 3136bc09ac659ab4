"""Noisy samples end up on their surface; edges, order and far places are left alone."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.smooth import REACH_RADII, smooth_samples

HALF = 20.0
RADIUS = 5.5


def cloud(height, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Samples one apart, and which lie a radius inside of the rim."""
    rng = np.random.default_rng(0)
    x, z = rng.uniform(-HALF, HALF, (2, int(4 * HALF**2)))
    points = np.stack([x, height(x, z), z], axis=1) + rng.normal(0.0, noise, (len(x), 3))
    points = points.astype(np.float32)
    points.setflags(write=False)
    return points, (np.abs(points[:, [0, 2]]) < HALF - RADIUS).all(axis=1)


def hills(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.sin(x / 6) + np.cos(z / 7)


def test_noise_falls_to_a_third_on_hills() -> None:
    points, inner = cloud(hills, 1.0)
    moved, normals = smooth_samples(points, radius_m=RADIUS, most_m=4.0)
    left = (moved[:, 1] - hills(moved[:, 0], moved[:, 2]))[inner]
    assert moved.dtype == normals.dtype == np.float32
    assert left.std() < 0.35
    assert np.abs(normals[inner, 1]).mean() > 0.9
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)


def test_a_clean_plane_stays_where_it_is() -> None:
    points, _ = cloud(lambda x, z: 0.5 * x - 0.2 * z, 0.0)
    moved, _ = smooth_samples(points, radius_m=RADIUS, most_m=1.0)
    assert np.abs(moved - points).max() < 1e-4


def test_an_edge_stays_sharper_than_an_average_leaves_it() -> None:
    """A gable of 90 degrees: averaging over the radius would lower its ridge by 1.2."""

    def gable(x: np.ndarray, _z: np.ndarray) -> np.ndarray:
        return -np.abs(x)

    points, inner = cloud(gable, 0.3)
    moved, _ = smooth_samples(points, radius_m=RADIUS, most_m=1.2)
    ridge = inner & (np.abs(moved[:, 0]) < 1.0)
    apart = (moved[ridge, 1] - gable(moved[ridge, 0], None)) / np.sqrt(2)
    assert abs(apart.mean()) < 0.3
    assert apart.std() < 0.3


def test_a_sample_far_from_its_neighbours_fit_stays() -> None:
    points, _ = cloud(hills, 0.3)
    pole = np.array([[0.3, hills(0.3, 0.1) + 3.0, 0.1]], np.float32)
    moved, _ = smooth_samples(np.concatenate([points, pole]), radius_m=RADIUS, most_m=1.2)
    assert (moved[-1] == pole[0]).all()


def test_a_lone_sample_stays() -> None:
    points = np.array([[0.0, 0, 0], [50, 0, 0], [50.1, 0, 0]], np.float32)
    moved, normals = smooth_samples(points, radius_m=1.0, most_m=1.0)
    assert moved == pytest.approx(points, abs=1e-3)
    assert np.isfinite(normals).all()


def test_two_tiles_move_what_both_see_alike() -> None:
    """Other samples, another order, another origin: the same places within rounding."""
    points, _ = cloud(hills, 1.0)
    radius = 5.0
    rows = np.flatnonzero(points[:, 0] < HALF - 8)[::-1]
    own, own_normals = smooth_samples(points, radius_m=radius, most_m=4.0)
    shift = np.array([-7.3, 2.1, 4.4], np.float32)
    other, other_normals = smooth_samples(points[rows] + shift, radius_m=radius, most_m=4.0)
    both = points[rows, 0] < HALF - 8 - REACH_RADII * radius
    assert both.sum() > 100
    assert other[both] - shift == pytest.approx(own[rows][both], abs=2e-4)
    along = np.abs((own_normals[rows][both] * other_normals[both]).sum(axis=1))
    assert along == pytest.approx(1.0, abs=1e-4)
