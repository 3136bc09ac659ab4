"""Regions over the next survey: literal oracles, and what must hold for any two surfaces."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.geometry.regions.region_numbers import (
    RegionNumbers,
    carry_numbers,
    local_numbers,
)


def carry(
    joined: list[int], held: list[int], matched: dict[int, int], area: list[float] | None = None
) -> tuple[list[int], list[int]]:
    numbers = carry_numbers(
        np.array(joined, np.int32),
        np.array(held, np.int32),
        np.ones(len(joined)) if area is None else np.array(area),
        (np.array(list(matched), np.int32), np.array(list(matched.values()), np.int32)),
    )
    return numbers.region.tolist(), numbers.before.tolist()


def test_a_region_that_continues_one_has_its_number() -> None:
    assert carry([0, 0, 1], [-1, -1, -1], {0: 1, 1: 0}) == ([1, 1, 0], [0, 1])


def test_held_units_stay_where_they_were_whatever_the_join_says() -> None:
    """The join unites what was 0 and 1; the second unit's tile did not change."""
    assert carry([0, 0, 0], [0, 1, -1], {0: 0}) == ([0, 1, 0], [0, 1])


def test_a_new_region_takes_a_gap_and_then_a_new_number() -> None:
    """Of 0 to 2, 1 is gone; two are new."""
    assert carry([0, 1, 2, 3], [0, 2, -1, -1], {0: 0, 1: 2}) == ([0, 2, 1, 3], [0, -1, 2, -1])


def test_a_number_beyond_the_count_moves_into_a_gap() -> None:
    assert carry([0, 1], [5, 0], {0: 5, 1: 0}) == ([1, 0], [0, 5])


def test_a_region_without_a_match_is_what_holds_enough_of_it() -> None:
    """Or else it would end along the border of the changed tile."""
    assert carry([0, 0], [0, -1], {}, [1.0, 2.0]) == ([0, 0], [0])
    assert carry([0, 0], [0, -1], {}, [1.0, 3.0]) == ([0, 1], [0, -1])
    assert carry([0, 0, 0], [1, 0, -1], {}, [2.0, 1.0, 1.0]) == ([1, 0, 1], [0, 1])


def test_what_another_region_continues_is_not_continued_twice() -> None:
    """Region 1 of the join is the old 0; the changed unit of the other one is new ground."""
    assert carry([0, 0, 1], [0, -1, -1], {1: 0}) == ([0, 1, 0], [0, -1])


def test_without_a_version_before_the_joins_numbers_stand() -> None:
    numbers = RegionNumbers.anew(np.array([2, 0, 1, 0], np.int32))
    assert (numbers.region.tolist(), numbers.before.tolist()) == ([2, 0, 1, 0], [-1, -1, -1])


@st.composite
def surfaces(draw: st.DrawFn) -> tuple[list[int], list[int], dict[int, int], list[float]]:
    joined = local_numbers(
        np.array(draw(st.lists(st.integers(0, 5), min_size=1, max_size=20)))
    ).tolist()
    size = len(joined)
    held = draw(st.lists(st.integers(-1, 6), min_size=size, max_size=size))
    old = draw(st.permutations(range(7)))
    new = draw(st.lists(st.sampled_from(sorted(set(joined))), unique=True))
    area = draw(st.lists(st.floats(0, 5), min_size=size, max_size=size))
    return joined, held, dict(zip(new, old, strict=False)), area


@given(surfaces())
def test_whatever_the_surfaces(given_: tuple) -> None:
    joined, held, matched, area = given_
    region, before = carry(joined, held, matched, area)
    count = len(before)
    # Without gaps, and none without a unit.
    assert set(region) == set(range(count))
    # Every old region once; its units that are held are in it, under its number if there is room.
    olds = [old for old in before if old >= 0]
    assert len(set(olds)) == len(olds)
    for number, old in zip(region, held, strict=True):
        if old >= 0:
            assert before[number] == old
            assert number == old or old >= count
    # What is not held follows the join.
    for a in range(len(joined)):
        for b in range(a):
            if held[a] < 0 and held[b] < 0 and joined[a] == joined[b]:
                assert region[a] == region[b]
        if held[a] < 0 and joined[a] in matched:
            assert before[region[a]] == matched[joined[a]]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=12))
def test_the_same_surface_again_is_numbered_as_it_was(joined: list[int]) -> None:
    names = local_numbers(np.array(joined))
    same = dict.fromkeys(names.tolist())
    shuffled = {new: len(same) - 1 - new for new in same}
    held = [shuffled[new] for new in names.tolist()]
    assert carry(names.tolist(), held, shuffled) == (held, list(range(len(same))))
