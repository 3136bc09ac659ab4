"""Coarser pieces that a region is part of: nested, named by most of their named ground."""

from __future__ import annotations

from typing import Any

import pytest

from terraport.coarser import coarser_pieces

DOCUMENT: dict[str, Any] = {
    "regions": [
        {"stable_id": 4, "area_m2": 2.0, "label": "field"},
        {"stable_id": 5, "area_m2": 3.0},
        {"stable_id": 6, "area_m2": 5.0, "label": "meadow"},
        {"stable_id": 7, "area_m2": 7.0},
    ],
    "unions": [[0, 1, 1.5], [2, 4, 2.0], [3, 5, 2.0]],
}
LABELS = {"labels": [{"stable_id": 7, "label": "wood"}]}


def test_they_grow_from_cost_to_cost() -> None:
    small, whole = coarser_pieces(DOCUMENT, {}, 1)
    assert (small.cost, small.regions, small.area_m2, small.label) == (1.5, (0, 1), 5.0, "field")
    assert (whole.cost, whole.regions, whole.area_m2, whole.label) == (
        2.0, (0, 1, 2, 3), 17.0, "meadow",
    )  # fmt: skip
    assert coarser_pieces(DOCUMENT, {}, 3) == (whole,), "two at one cost are one answer"


def test_what_users_say_comes_first() -> None:
    (whole,) = coarser_pieces(DOCUMENT, LABELS, 3)
    assert whole.label == "wood"


@pytest.mark.parametrize(
    "unions", [None, 3, [], [[0, 9, 2]], [[0, 0, 2]], [[0, 1]], [[0, 1, "2"]], ["x"]]
)
def test_without_unions_that_can_be_read_there_are_none(unions: object) -> None:
    assert coarser_pieces({**DOCUMENT, "unions": unions}, LABELS, 0) == ()


def test_a_region_that_is_not_there_has_none() -> None:
    assert coarser_pieces(DOCUMENT, LABELS, 4) == coarser_pieces(DOCUMENT, LABELS, -1) == ()
    assert coarser_pieces({}, {}, 0) == ()
