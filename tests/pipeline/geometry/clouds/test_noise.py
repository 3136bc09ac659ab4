"""Noise is told apart from curvature, roughness and edges."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.noise import window_noise

HALF = 20.0
"""Half a window's width in spacings; samples stand one apart on average."""


def window(height, *, noise: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Samples of a surface of heights, one for each unit of area, and the inner ones."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-HALF, HALF, (2, int(4 * HALF**2)))
    points = np.stack([x, y, height(x, y)], axis=1) + rng.normal(0.0, noise, (len(x), 3))
    return points, np.flatnonzero((np.abs(points[:, :2]) < HALF - 10).all(axis=1))


def flat(x: np.ndarray, _y: np.ndarray) -> np.ndarray:
    return 0.0 * x


def curved(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Hills of a radius of ten spacings, as a heap of boulders."""
    return 2.5 * np.sin(x / 5) * np.cos(y / 5)


def bench(x: np.ndarray, _y: np.ndarray) -> np.ndarray:
    """A step with two sharp edges, four spacings high and four deep."""
    return np.clip(x, -2.0, 2.0)


@pytest.mark.parametrize("surface", [flat, curved, bench])
@pytest.mark.parametrize("noise", [0.3, 1.0, 2.0, 3.0])
def test_noise_is_measured_within_a_quarter(surface, noise) -> None:
    measured, _ = window_noise(*window(surface, noise=noise))
    assert measured == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize("surface", [flat, curved, bench])
def test_a_clean_surface_has_none_whatever_its_shape(surface) -> None:
    assert window_noise(*window(surface))[0] < 0.1


def test_rough_ground_is_not_noise() -> None:
    """Rubble of three spacings: heights differ by half a spacing, but not between neighbours."""
    rng = np.random.default_rng(3)
    waves = rng.normal(0.0, 2 * np.pi / 6, (40, 2))
    phases = rng.uniform(0, 2 * np.pi, 40)

    def rubble(x, y):
        angles = x[:, None] * waves[:, 0] + y[:, None] * waves[:, 1] + phases
        return 0.5 * np.sqrt(2 / 40) * np.cos(angles).sum(axis=1)

    points, rows = window(rubble)
    assert points[:, 2].std() > 0.4
    assert window_noise(points, rows)[0] < 0.2


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
def test_area_is_that_of_the_surface_in_spite_of_noise(noise) -> None:
    _, area = window_noise(*window(flat, noise=noise))
    assert area.mean() == pytest.approx(1.0, rel=0.15)


def test_scale_and_place_change_nothing_but_the_unit() -> None:
    points, rows = window(curved, noise=0.5)
    noise, area = window_noise(points, rows)
    scaled_noise, scaled_area = window_noise(0.01 * points + [3.0, -2.0, 9.0], rows)
    assert scaled_noise == pytest.approx(0.01 * noise, rel=1e-4)
    assert scaled_area == pytest.approx(1e-4 * area, rel=1e-4)


def test_too_few_samples_tell_nothing() -> None:
    points, rows = window(flat)
    assert window_noise(points[:20], rows[rows < 20])[0] == 0.0
    noise, area = window_noise(points, rows[:0])
    assert (noise, len(area)) == (0.0, 0)
