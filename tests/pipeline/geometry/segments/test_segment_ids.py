"""Segments keep their numbers: literal oracles, and what must hold for any two versions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.geometry.segments.segment_ids import carry_segment_ids, renumber_rows

HASHES = st.lists(st.integers(0, 12), max_size=30)


def carry(hashes: list[int], before: list[int]) -> tuple[list[int], list[bool]]:
    ids, held = carry_segment_ids(np.array(hashes, np.uint64), np.array(before, np.uint64))
    return ids.tolist(), held.tolist()


def test_a_new_scene_is_numbered_along_the_curve() -> None:
    assert carry([7, 5, 6], []) == ([0, 1, 2], [False] * 3)


def test_what_did_not_change_keeps_its_number_and_the_others_fill_in() -> None:
    """5 and 7 stay; 8 takes the number of 6, which is gone; 9 is one more than there were."""
    assert carry([7, 8, 9, 5], [5, 6, 7]) == ([2, 1, 3, 0], [True, False, False, True])


def test_a_number_beyond_the_count_cannot_be_held() -> None:
    assert carry([7, 8], [5, 8, 7]) == ([0, 1], [False, True])


def test_equal_payloads_share_their_old_numbers_in_order() -> None:
    assert carry([4, 4, 4], [9, 4, 4]) == ([1, 2, 0], [True, True, False])


def test_hashes_use_all_64_bits() -> None:
    large = 2**64 - 1
    assert carry([1, large], [large, 1]) == ([1, 0], [True, True])


@given(hashes=HASHES, before=HASHES)
def test_ids_are_a_permutation_and_as_many_as_can_are_held(
    hashes: list[int], before: list[int]
) -> None:
    ids, held = carry(hashes, before)
    assert sorted(ids) == list(range(len(hashes)))
    for value, number, is_held in zip(hashes, ids, held, strict=True):
        assert not is_held or before[number] == value
    for value in set(hashes):
        offered = before[: len(hashes)].count(value)
        kept = sum(h for v, h in zip(hashes, held, strict=True) if v == value)
        assert kept == min(offered, hashes.count(value))
    free = [number for number, is_held in zip(ids, held, strict=True) if not is_held]
    assert free == sorted(free)


@given(hashes=HASHES, before=HASHES)
def test_the_same_payloads_again_keep_every_number(hashes: list[int], before: list[int]) -> None:
    ids, _ = carry(hashes, before)
    published = [0] * len(ids)
    for value, number in zip(hashes, ids, strict=True):
        published[number] = value
    assert carry(hashes, published)[1] == [True] * len(hashes)


def test_rows_are_renamed_and_stay_ascending() -> None:
    offsets, segments = np.array([0, 2, 2, 5], np.uint32), np.array([0, 1, 0, 2, 3], np.uint32)
    renamed = renumber_rows(offsets, segments, np.array([3, 0, 2, 1], np.int32))
    assert renamed.tolist() == [0, 3, 1, 2, 3]
    assert renamed.dtype == np.uint32
