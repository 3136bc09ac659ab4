"""Ranges of a pack, merged."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport.pull_ranges import Fetch, merge_ranges, part_of_content_range


@given(
    st.lists(st.tuples(st.integers(0, 300), st.integers(1, 200)), max_size=40),
    st.randoms(use_true_random=False),
    st.integers(0, 400),
    st.integers(1, 2000),
)
def test_every_payload_lies_in_one_range(
    sizes: list[tuple[int, int]], random: object, gap_bytes: int, range_bytes: int
) -> None:
    at, fetches = 0, []
    for segment, (gap, length) in enumerate(sizes):
        fetches.append(Fetch(segment, at + gap, length))
        at += gap + length
    random.shuffle(fetches)  # type: ignore[attr-defined]
    ranges = merge_ranges(fetches, gap_bytes=gap_bytes, range_bytes=range_bytes)
    assert sorted(f.segment for r in ranges for f in r.fetches) == list(range(len(sizes)))
    for found in ranges:
        assert found.start == found.fetches[0].offset
        assert found.end == found.fetches[-1].offset + found.fetches[-1].length
        for before, after in zip(found.fetches, found.fetches[1:], strict=False):
            assert 0 <= after.offset - (before.offset + before.length) <= gap_bytes
        assert found.fetches[-1].offset - gap_bytes - found.start < range_bytes
    if fetches:
        assert fetches[0] in ranges[0].fetches


@pytest.mark.parametrize(
    "text", ["", "bytes", "bytes 1-2", "bytes */5", "lines 1-2/3", "bytes -1-2/3", "bytes 1-2/*"]
)
def test_what_is_no_content_range(text: str) -> None:
    assert part_of_content_range(text) is None
