from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError
from terraport_pipeline.synth.flight import plan_flight, seen_by
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import FlightOptions, QuarryOptions
from terraport_pipeline.synth.terrain import Terrain
from terraport_pipeline.synth.way import way_places

QUARRY = QuarryOptions(seed=3)


def test_the_nadir_photos_overlap_as_asked_and_cover_the_site() -> None:
    options = FlightOptions(count=60, width=1000, height=750, overlap=0.6)
    flight = plan_flight(options, QUARRY)
    nadir = flight.views[: flight.nadir]
    assert len(flight.views) == 60
    assert 30 <= flight.nadir <= 36
    assert all(view.rotation[2, 1] < -0.99 for view in nadir)  # forward is down
    across = flight.height_m * 1000 / nadir[0].lens.fx
    along = flight.height_m * 750 / nadir[0].lens.fx
    north = np.unique(np.round([-view.position[2] for view in nadir], -1))
    assert np.diff(sorted(-view.position[2] for view in nadir)).max() < 0.4 * across + 8
    assert north.max() + across / 2 > 144
    rows = [v.position[0] for v in nadir if abs(v.position[2] - nadir[0].position[2]) < 5]
    assert np.diff(sorted(rows)).max() < 0.4 * along + 8


def test_more_photos_fly_lower() -> None:
    few = plan_flight(FlightOptions(count=20), QUARRY)
    many = plan_flight(FlightOptions(count=200), QUARRY)
    assert many.gsd_m < 0.5 * few.gsd_m
    assert many.height_m == pytest.approx(many.gsd_m * many.views[0].lens.fx)


def test_oblique_photos_look_down_into_the_pit() -> None:
    flight = plan_flight(FlightOptions(count=30), QUARRY)
    oblique = flight.views[flight.nadir :]
    assert len(oblique) == 12
    for view in oblique:
        assert -0.95 < view.rotation[2, 1] < -0.3
        assert view.position[1] > 20.0


def test_the_flight_scales_with_the_site_and_repeats() -> None:
    options = FlightOptions(count=12)
    small = plan_flight(options, QuarryOptions(seed=3, size_m=36.0))
    large = plan_flight(options, QUARRY)
    again = plan_flight(options, QUARRY)
    assert small.height_m == pytest.approx(large.height_m / 10)
    for a, b, c in zip(small.views, large.views, again.views, strict=True):
        np.testing.assert_allclose(a.position * 10, b.position)
        np.testing.assert_array_equal(b.rotation, c.rotation)


def test_one_photo_is_a_flight() -> None:
    flight = plan_flight(FlightOptions(count=1, truck=False), QUARRY)
    assert (len(flight.views), flight.nadir) == (1, 1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"count": 0}, "photo count 0; expected 1 to 2000"),
        ({"width": 63}, "63 x 1500 pixels; expected sides of 64 to 16,384"),
        ({"overlap": 1.0}, "overlap 1; expected 0 to 0.95"),
        ({"width": 10_000, "height": 10_000}, "10000 x 10000 pixels is too large"),
        ({"exposure_drift_ev": float("nan")}, "exposure drift nan; expected 0 to 3"),
    ],
)
def test_what_no_camera_can_is_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        FlightOptions(**values)


def test_a_cloud_of_photos_has_their_pattern_and_pixel() -> None:
    options = FlightOptions(count=20)
    seen = seen_by(options, QUARRY)
    assert seen.detail == 1.0
    assert seen.pixel_m == plan_flight(options, QUARRY).gsd_m
    assert seen_by(options, QuarryOptions(detail=0.5, pixel_m=0.3)).pixel_m == 0.3


def test_a_window_is_flown_over_low_and_looked_at_from_around() -> None:
    quarry = replace(QUARRY, window_m=36.0, window_east_m=-72.0, window_north_m=54.0)
    flight = plan_flight(FlightOptions(count=40), quarry)
    positions = np.array([view.position for view in flight.views])
    middle = np.array([-72.0, -54.0])
    assert np.abs(positions[:, [0, 2]] - middle).max() < 1.1 * 18
    assert flight.gsd_m < plan_flight(FlightOptions(count=40), QUARRY).gsd_m / 5
    # Each flies clear of the ground below it, and the oblique ones look at the middle's ground.
    rng = np.random.default_rng([quarry.seed, 0])
    terrain = Terrain(quarry, Noise(rng), rng)
    ground = terrain.positions(positions[:, 0], -positions[:, 2])[:, 2]
    assert (positions[:, 1] - ground).min() > 3.5
    for view in flight.views[flight.nadir :]:
        forward = view.rotation[2]
        assert forward[1] < 0
        assert forward[[0, 2]] @ (middle - view.position[[0, 2]]) > 0


def test_photos_along_the_way_look_down_on_it_from_low() -> None:
    options = FlightOptions(count=30, way_share=0.4)
    flight = plan_flight(options, QUARRY)
    assert flight.way == 12
    rng = np.random.default_rng([QUARRY.seed, 0])
    terrain = Terrain(QUARRY, Noise(rng), rng)
    low = flight.views[-12:]
    positions = np.array([view.position for view in low])
    ground = terrain.sample(positions[:, 0], -positions[:, 2])
    assert (ground.road > 0.9).all()
    height = positions[:, 1] - ground.positions[:, 2]
    # The wind moves a drone by a hundredth of its height.
    np.testing.assert_allclose(height, np.median(height), rtol=0.08)
    assert flight.way_gsd_m == pytest.approx(np.median(height) / low[0].lens.fx, rel=0.05)
    assert flight.way_gsd_m < 0.4 * flight.gsd_m
    assert all(view.rotation[2, 1] < -0.99 for view in low)
    # Every place in the middle of the way is in one of their pictures.
    places, _, _ = way_places(terrain, 400)
    inside = np.zeros(400, dtype=bool)
    for view in low:
        (pixels, depth) = view.project(places[:, [0, 2, 1]] * [1.0, 1.0, -1.0])
        within = (pixels > 0) & (pixels < [view.lens.width, view.lens.height])
        inside |= within.all(axis=1) & (depth > 0)
    assert inside.all()


def test_without_a_share_of_it_nothing_follows_the_way() -> None:
    flight = plan_flight(FlightOptions(count=10), QUARRY)
    assert (flight.way, flight.way_gsd_m) == (0, flight.gsd_m)


def test_a_window_has_no_way() -> None:
    quarry = replace(QUARRY, window_m=36.0)
    with pytest.raises(OptionError, match="leave out --photo-way or --window-m"):
        plan_flight(FlightOptions(count=10, way_share=0.5), quarry)
