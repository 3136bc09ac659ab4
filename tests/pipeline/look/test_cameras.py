"""Cameras: rays and projection agree, framing keeps all in, bearings are compass bearings."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.cameras import Camera, PhotoCamera, eye_level, oblique, top_down
from terraport_pipeline.geometry.photos.lens import Lens, View

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


@pytest.mark.parametrize("which", range(4))
def test_some_rows_are_those_of_the_whole_picture(which) -> None:
    lens = Lens(width=WIDTH, height=HEIGHT, fx=50.0, fy=50.0, cx=32.0, cy=18.0)
    photo = PhotoCamera(View("a.jpg", lens, np.eye(3), np.array([3.0, 40.0, 5.0])))
    camera = [*cameras(BOX), photo][which]
    whole = camera.rays(WIDTH, HEIGHT)
    bands = [camera.rays(WIDTH, HEIGHT, slice(first, first + 16)) for first in (0, 16, 32)]
    for part in (0, 1):
        np.testing.assert_array_equal(np.concatenate([band[part] for band in bands]), whole[part])


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


def test_a_photos_camera_draws_what_the_photo_shows() -> None:
    lens = Lens(width=400, height=300, fx=300.0, fy=299.0, cx=203.0, cy=148.0, radial=(-0.08, 0.02))
    view = View("a.jpg", lens, np.diag([1.0, -1.0, -1.0]), np.array([5.0, 2.0, 9.0]))
    camera = PhotoCamera(view)
    origins, headings = camera.rays(200, 150)  # drawn at half the size
    assert origins.shape == headings.shape == (30_000, 3)
    assert camera.eye == (5.0, 2.0, 9.0)
    row, column = 31, 150
    pixels, _ = view.project((origins + 7.0 * headings)[row * 200 + column][None].astype(float))
    np.testing.assert_allclose(pixels[0] / 2, [column + 0.5, row + 0.5], atol=1e-3)
    # A part of it, enlarged: the same rays.
    part = PhotoCamera(view, (180.0, 130.0, 50.0, 40.0))
    enlarged = part.rays(150, 120)[1].reshape(120, 150, 3)
    pixels, _ = view.project((origins[0] + 7.0 * enlarged[31, 46])[None].astype(float))
    np.testing.assert_allclose(pixels[0], [180 + 46.5 / 3, 130 + 31.5 / 3], atol=1e-3)
    # A pixel is as wide as the angle between two rays.
    step = np.linalg.norm(headings[75 * 200 + 101] - headings[75 * 200 + 100]) * 10
    np.testing.assert_allclose(camera.pixel_m(np.float32([10.0]), 150), step, rtol=0.02)
    step = np.linalg.norm(enlarged[60, 76] - enlarged[60, 75]) * 10
    np.testing.assert_allclose(part.pixel_m(np.float32([10.0]), 120), step, rtol=0.02)


def test_a_pixel_grows_with_the_distance_but_not_in_a_parallel_projection() -> None:
    flat = top_down(np.array([[0, 0, 0], [90, 0, 90]]), aspect=1.0, margin=0.0)
    np.testing.assert_allclose(flat.pixel_m(np.float32([1, 50]), 90), [1.0, 1.0])
    near = eye_level((0, 0, 0), azimuth_deg=0.0)
    at_10_m, at_20_m = near.pixel_m(np.float32([10, 20]), 100)
    assert at_20_m == pytest.approx(2 * at_10_m)
