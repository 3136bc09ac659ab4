"""Stable ids and labels by region."""

from __future__ import annotations

from typing import Any

import pytest

from terraport_store import DamagedSceneError, RegionNames

ROWS: list[dict[str, Any]] = [
    {"id": 0, "stable_id": 5},
    {"id": 1, "stable_id": 2, "label": "rock"},
    {"id": 2, "stable_id": 9},
]


def test_a_users_label_stands_before_the_builds() -> None:
    names = RegionNames.of({"regions": ROWS, "next_stable_id": 10})
    assert [names.stable_id(region) for region in range(4)] == [5, 2, 9, None]
    assert [names.label(region) for region in range(4)] == [None, "rock", None, None]
    named = names.with_labels({2: "quartzite", 7: "gone", 9: "road"})
    assert [named.label(region) for region in range(3)] == [None, "quartzite", "road"]
    assert named.without_region() == {7: "gone"}
    assert names.label(1) == "rock", "the value is not changed"


def test_a_scene_of_format_1_0_has_labels_of_its_build_alone() -> None:
    names = RegionNames.of({"regions": [{"id": 0, "label": "road"}, {"id": 1}]})
    named = names.with_labels({0: "not mine"})
    assert named.stable_id(0) is None
    assert [named.label(region) for region in (0, 1)] == ["road", None]
    assert RegionNames.of({"regions": []}).stable_ids is None


@pytest.mark.parametrize(
    ("document", "text"),
    [
        ({}, "regions are a NoneType, expected a list"),
        ({"regions": ROWS}, "next_stable_id None, expected 0 to 4294967296"),
        ({"regions": ROWS, "next_stable_id": -1}, "next_stable_id -1, expected"),
        ({"regions": ROWS, "next_stable_id": 9}, "region 2: stable_id 9, expected 0 to 8"),
        (
            {"regions": [ROWS[0], {"id": 1}], "next_stable_id": 9},
            "region 1: stable_id None, expected 0 to 8",
        ),
        (
            {"regions": [ROWS[0], ROWS[0]], "next_stable_id": 9},
            "region 1: stable_id 5 as region 0, expected once",
        ),
    ],
)
def test_what_is_wrong_is_named(document: dict[str, Any], text: str) -> None:
    with pytest.raises(DamagedSceneError) as caught:
        RegionNames.of(document, file="v-1/regions.json")
    assert str(caught.value) == f"v-1/regions.json: {text}" or text in str(caught.value)
