"""Named regions as places: which there are, and which one is meant."""

from __future__ import annotations

from typing import Any

import pytest

from terraport.errors import UsageError
from terraport.places import coarser_pieces, find_place, places_of

VIEW = {"position": [1.0, 2.0, -3.0], "heading_deg": 270.0, "radius_m": 25.0}
REGIONS = {
    "regions": [
        {"stable_id": 3, "area_m2": 10.0, "centroid": [0, 0, 0], "place": VIEW, "class": "pile"},
        {"stable_id": 5, "area_m2": 90.0, "centroid": [7, 8, 9]},
        {"stable_id": 4, "label": "road of the build", "centroid": [4, 5, 6], "place": "nowhere"},
        {"stable_id": 8, "area_m2": 1.0, "centroid": [1, 1, 1]},
        {"stable_id": 9, "label": "no middle"},
        "no region",
    ]
}
LABELS = {
    "labels": [
        {"stable_id": 3, "label": "pile"},
        {"stable_id": 5, "label": "Pile"},
        {"stable_id": 8},
    ]
}


def test_places_by_name_the_largest_first() -> None:
    places = places_of(REGIONS, LABELS)
    assert [(place.label, place.stable_id) for place in places] == [
        ("Pile", 5),
        ("pile", 3),
        ("road of the build", 4),
    ]
    middle, view, road = places
    assert (middle.is_view, middle.position, middle.heading_deg) == (False, (7, 8, 9), None)
    assert (view.is_view, view.position, view.radius_m) == (True, (1, 2, -3), 25.0)
    assert (view.heading_deg, view.kind) == (270.0, "pile")
    assert not road.is_view
    assert places_of({}, {}) == ()


def test_a_place_is_found_by_its_name_or_stable_id() -> None:
    places = places_of(REGIONS, LABELS)
    assert find_place(places, " PILE ").stable_id == 5
    assert find_place(places, "3").stable_id == 3
    with pytest.raises(UsageError, match="no region is called 'lake'; expected one of: 'Pile'"):
        find_place(places, "lake")
    with pytest.raises(UsageError, match="none has a name yet"):
        find_place((), "lake")


UNITED: dict[str, Any] = {
    "regions": [
        {"stable_id": 4, "area_m2": 2.0, "label": "field"},
        {"stable_id": 5, "area_m2": 3.0},
        {"stable_id": 6, "area_m2": 5.0, "label": "meadow"},
        {"stable_id": 7, "area_m2": 7.0},
    ],
    "unions": [[0, 1, 1.5], [2, 4, 2.0], [3, 5, 2.0]],
}
TAUGHT = {"labels": [{"stable_id": 7, "label": "wood"}]}


def test_they_grow_from_cost_to_cost() -> None:
    small, whole = coarser_pieces(UNITED, {}, 1)
    assert (small.cost, small.regions, small.area_m2, small.label) == (1.5, (0, 1), 5.0, "field")
    assert (whole.cost, whole.regions, whole.area_m2, whole.label) == (
        2.0, (0, 1, 2, 3), 17.0, "meadow",
    )  # fmt: skip
    assert coarser_pieces(UNITED, {}, 3) == (whole,), "two at one cost are one answer"


def test_what_users_say_comes_first() -> None:
    (whole,) = coarser_pieces(UNITED, TAUGHT, 3)
    assert whole.label == "wood"


@pytest.mark.parametrize(
    "unions", [None, 3, [], [[0, 9, 2]], [[0, 0, 2]], [[0, 1]], [[0, 1, "2"]], ["x"]]
)
def test_without_unions_that_can_be_read_there_are_none(unions: object) -> None:
    assert coarser_pieces({**UNITED, "unions": unions}, TAUGHT, 0) == ()


def test_a_region_that_is_not_there_has_none() -> None:
    assert coarser_pieces(UNITED, TAUGHT, 4) == coarser_pieces(UNITED, TAUGHT, -1) == ()
    assert coarser_pieces({}, {}, 0) == ()
