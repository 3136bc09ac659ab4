"""Where a scene is, and what is said of a place that it does not reach."""

from __future__ import annotations

import pytest

from terraport.outside import SceneBox

BOX = SceneBox((-0.01, 90.0, -50.0), (100.0, 120.0, 50.0), (500_000.0, 8_000_000.0, 100.0))


def test_it_is_read_from_a_manifest() -> None:
    document = {
        "bounds": {"min": [-0.01, 90, -50], "max": [100, 120, 50]},
        "origin": [500_000, 8_000_000, 100],
    }
    assert SceneBox.of(document) == BOX


@pytest.mark.parametrize(
    ("position", "nearest", "distance_m"),
    [
        ((10.0, 100.0, 0.0), (10.0, 100.0, 0.0), 0.0),
        ((100.0, 90.0, -50.0), (100.0, 90.0, -50.0), 0.0),
        ((103.0, 124.0, 0.0), (100.0, 120.0, 0.0), 5.0),
        ((-3.01, 90.0, -54.0), (-0.01, 90.0, -50.0), 5.0),
    ],
)
def test_the_nearest_place_of_it(
    position: tuple[float, ...], nearest: tuple[float, ...], distance_m: float
) -> None:
    assert BOX.nearest(position) == nearest
    assert BOX.distance_m(position) == distance_m


def test_a_far_place_is_told_with_all_that_one_needs_to_find_back() -> None:
    assert BOX.explain((500_012.25, 8_000_040.0, 103.5), 60.0) == (
        "(500012.2, 8000040, 103.5) lies 8,015,524 m outside the scene, more than the radius of "
        "60 m: nothing of it is there. The scene reaches from (0, 90, -50) to (100, 120, 50); "
        "nearest is (100, 120, 50)"
    )


def test_what_was_perhaps_meant() -> None:
    assert BOX.is_survey_place((500_012.0, 8_000_040.0, 203.5))
    assert not BOX.is_survey_place((500_012.0, 8_000_040.0, 103.5))  # 86 m below it
    assert BOX.is_above_or_below((10.0, 0.0, 0.0))
    assert not BOX.is_above_or_below((10.0, 0.0, 60.0))
