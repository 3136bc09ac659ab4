"""Cameras: rays and projection agree, framing keeps all in, bearings are compass bearings."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.cameras import Camera, eye_level, oblique, top_down

BOX = np.array([[0, 0, 0], [200, 30, 100]], dtype=np.float64)
WIDTH, HEIGHT = 64, 36


def cameras(points: np.ndarray) -> list[Camera]:
    aspect = WIDTH / HEIGHT
    return [
        top_down(points, aspect=aspect),
        oblique(points, aspect=aspect),
        oblique(points, aspect=aspect, azimuth_deg=200, elevation_deg=70),
    ]


@pytest.mark.parametrize("which", range(3))
def test_a_point_on_a_pixels_ray_projects_into_that_pixel(which) -> None:
    camera = cameras(BOX)[which]
    origins, directions = camera.rays(WIDTH, HEIGHT)
    column, row, depth = camera.project(origins + 70.0 * directions, WIDTH, HEIGHT)
    expected_row, expected_column = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    np.testing.assert_allclose(column, expected_column + 0.5, atol=1e-3)
    np.testing.assert_allclose(row, expected_row + 0.5, atol=1e-3)
    assert (depth > 0).all()


@pytest.mark.parametrize("which", range(3))
def test_framing_keeps_every_point_in_and_fills_the_picture(which) -> None:
    points = np.random.default_rng(5).uniform(BOX[0], BOX[1], (500, 3))
    column, row, _ = cameras(points)[which].project(points, WIDTH, HEIGHT)
    assert column.min() >= 0
    assert column.max() <= WIDTH
    assert row.min() >= 0
    assert row.max() <= HEIGHT
    # One of the two directions is filled but for the margins.
    assert max(np.ptp(column) / WIDTH, np.ptp(row) / HEIGHT) > 0.85


def test_top_down_has_north_up_and_east_right() -> None:
    camera = top_down(BOX, aspect=1.0)
    column, row, _ = camera.project(np.array([[10, 0, 50], [190, 0, 50], [100, 0, 5]]), 100, 100)
    assert column[0] < column[1]
    assert row[2] < row[0]  # smaller z is further north


@pytest.mark.parametrize(
    ("azimuth_deg", "heading"),
    [(0, (0, 0, -1)), (90, (1, 0, 0)), (180, (0, 0, 1)), (270, (-1, 0, 0))],
)
def test_bearings_are_compass_bearings(azimuth_deg, heading) -> None:
    camera = eye_level((1, 2, 3), azimuth_deg=azimuth_deg, pitch_deg=0)
    np.testing.assert_allclose(camera.forward, heading, atol=1e-12)
    np.testing.assert_allclose(camera.up, (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(np.cross(camera.right, camera.forward), camera.up, atol=1e-12)


def test_points_behind_a_pinhole_are_not_projected() -> None:
    camera = eye_level((0, 0, 0), azimuth_deg=0, pitch_deg=0)
    column, row, _ = camera.project(np.array([[0, 0, 5.0], [0, 0, -5.0]]), 10, 10)
    assert np.isnan([column[0], row[0]]).all()
    np.testing.assert_allclose([column[1], row[1]], [5, 5])


def test_nothing_to_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="received no points"):
        top_down(np.empty((0, 3)), aspect=1.0)
