"""Gains from made-up sightings, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.photos.photo_gains import MAX_VIEWS, Sightings, solve_gains
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET, neutral_gains

EXPOSURE = np.array([0.8, 1.0, 1.15, 0.9])
"""What each photo's levels were multiplied by (with the offset of sRGB)."""


def sightings(
    count: int = 400,
    *,
    cloud: float | None = 1.0,
    exposure: np.ndarray = EXPOSURE,
    darkening: float = 0.0,
    seed: int = 0,
) -> Sightings:
    """Places of random colours in three of the photos each, and in the cloud where it has any."""
    rng = np.random.default_rng(seed)
    n_views = len(exposure)
    true = rng.uniform(60, 150, (count, 3)) + SRGB_OFFSET
    view = np.argsort(rng.random((count, n_views)), axis=1)[:, :3].astype(np.int16)
    radius = rng.uniform(0, 1, view.shape).astype(np.float32)
    factor = exposure[view] * (1 - darkening * radius**2)
    level = true[:, None] * factor[..., None] - SRGB_OFFSET
    if cloud is not None:
        view = np.column_stack([view, np.full(count, n_views, np.int16)])
        radius = np.column_stack([radius, np.zeros(count, np.float32)])
        level = np.concatenate([level, true[:, None] * cloud - SRGB_OFFSET], axis=1)
    return Sightings(view, np.rint(level).astype(np.uint8), radius)


LENSES = np.zeros(4, np.int32)


def test_exposures_come_back_and_the_cloud_stays() -> None:
    solution = solve_gains(sightings(), 4, LENSES, vignetting=False)
    assert solution.gains[:4, :3] == pytest.approx((1 / EXPOSURE)[:, None].repeat(3, 1), rel=0.01)
    assert (solution.gains[4] == neutral_gains(0)[-1]).all()
    assert solution.sightings == 1600
    assert solution.spread_after < 0.1 * solution.spread_before


def test_trucks_do_not_count() -> None:
    seen = sightings()
    rng = np.random.default_rng(1)
    truck = rng.random(seen.view.shape) < 0.15
    truck[:, 3] = False  # the cloud has none
    seen.level[truck] = rng.integers(10, 240, (int(truck.sum()), 3))
    solution = solve_gains(seen, 4, LENSES, vignetting=False)
    assert solution.gains[:4, :3] == pytest.approx((1 / EXPOSURE)[:, None].repeat(3, 1), rel=0.02)


def test_clipped_levels_say_nothing() -> None:
    seen = sightings()
    seen.level[::2, 0] = 255
    seen.level[1::4, 1] = 0
    solution = solve_gains(seen, 4, LENSES, vignetting=False)
    assert solution.gains[:4, :3] == pytest.approx((1 / EXPOSURE)[:, None].repeat(3, 1), rel=0.01)
    assert solution.sightings == 1600 - 200 - 100


def test_without_a_cloud_the_photos_keep_their_mean() -> None:
    solution = solve_gains(sightings(cloud=None), 4, LENSES, vignetting=False)
    logarithm = np.log(solution.gains[:4, 0] * EXPOSURE)
    assert np.ptp(logarithm) < 0.01
    assert abs(np.log(solution.gains[:4, :3]).mean()) < 0.01


@pytest.mark.parametrize(("light", "follows"), [(0.8, True), (0.6, False)])
def test_a_cloud_of_another_light_is_followed_only_so_far(light: float, follows: bool) -> None:
    solution = solve_gains(sightings(cloud=light), 4, LENSES, vignetting=False)
    cloud = float(solution.gains[4, 0])
    assert (cloud == pytest.approx(1.0, abs=1e-6)) == follows
    # either way photos and cloud end up alike
    assert solution.gains[:4, 0] * EXPOSURE == pytest.approx(cloud * light, rel=0.02)


def test_vignetting_comes_back() -> None:
    solution = solve_gains(sightings(2000, darkening=0.2), 4, LENSES)
    square = np.linspace(0, 1, 5)[:, None]
    gain = 1 + square * (solution.gains[:4, 3] + square * solution.gains[:4, 4])
    assert gain == pytest.approx((1 / (1 - 0.2 * square)).repeat(4, 1), rel=0.02)
    assert (solution.gains[4, 3:] == 0).all()


def test_a_place_seen_once_compares_nothing() -> None:
    seen = sightings(20)
    seen.view[:, 1:] = -1
    solution = solve_gains(seen, 4, LENSES)
    assert (solution.gains == neutral_gains(4)).all()
    assert solution.sightings == 0


def test_a_photo_that_sees_nothing_is_left_as_it_is() -> None:
    seen = sightings()
    seen.view[seen.view == 2] = -1
    solution = solve_gains(seen, 4, LENSES, vignetting=False)
    assert (solution.gains[2] == neutral_gains(0)[-1]).all()


def test_more_photos_than_the_matrix_holds_are_refused() -> None:
    with pytest.raises(ValueError, match="4097 views, expected at most 4096"):
        solve_gains(sightings(2), MAX_VIEWS + 1, np.zeros(MAX_VIEWS + 1, np.int32))
