"""Named regions as places: which there are, and which one is meant."""

from __future__ import annotations

import pytest

from terraport.errors import UsageError
from terraport.places import find_place, places_of

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
