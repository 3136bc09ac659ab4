"""Chunks to payloads."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport.assembly import Assembler
from terraport.errors import ProtocolViolationError
from terraport_wire import PayloadFrame


def chunk(payload: bytes, start: int, end: int, segment: int = 1) -> PayloadFrame:
    return PayloadFrame(1, segment, start, len(payload), memoryview(payload)[start:end])


@given(payload=st.binary(min_size=1, max_size=40), cuts=st.sets(st.integers(1, 39)))
def test_however_it_is_cut_the_payload_comes_out(payload: bytes, cuts: set[int]) -> None:
    places = [0, *sorted(cut for cut in cuts if cut < len(payload)), len(payload)]
    assembler = Assembler()
    for start, end in pairwise(places):
        assert assembler.received(1) == start
        whole = assembler.take(chunk(payload, start, end), len(payload))
        assert whole == (payload if end == len(payload) else None)
    assert len(assembler) == 0


@pytest.mark.parametrize(
    ("start", "end", "length", "text"),
    [
        (2, 4, 10, "continues at byte 2, expected 3"),
        (4, 5, 10, "continues at byte 4, expected 3"),
        (3, 5, 9, "announces 10 bytes, expected 9 by the plan"),
    ],
)
def test_gap_overlap_and_wrong_total_are_violations(start, end, length, text: str) -> None:
    payload, assembler = bytes(10), Assembler()
    assembler.take(chunk(payload, 0, 3), 10)
    with pytest.raises(ProtocolViolationError, match=text):
        assembler.take(chunk(payload, start, end), length)


def test_parts_that_a_plan_does_not_need_are_forgotten() -> None:
    payload, assembler = bytes(10), Assembler()
    for segment in (1, 2, 3):
        assembler.take(chunk(payload, 0, 3, segment), 10)
    assembler.keep_only({2})
    assert [assembler.received(segment) for segment in (1, 2, 3)] == [0, 3, 0]
    assembler.clear()
    assert len(assembler) == 0
