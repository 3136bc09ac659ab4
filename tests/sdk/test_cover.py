"""Hidden base faces: the counters against the rule itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport.cover import CoverCounters
from terraport.errors import ProtocolViolationError, UsageError
from terraport_payload import Cover

ROWS = st.lists(st.frozensets(st.integers(0, 9), max_size=4), max_size=12)
CHANGES = st.lists(
    st.tuples(st.sampled_from(["add", "remove", "show"]), st.lists(st.integers(0, 12))), max_size=8
)


def csr(rows: list[frozenset[int]]) -> tuple[np.ndarray, np.ndarray]:
    offsets = np.cumsum([0, *(len(row) for row in rows)])
    return offsets, np.array([segment for row in rows for segment in sorted(row)], dtype=np.uint32)


@given(rows=ROWS, changes=CHANGES)
def test_any_history_gives_what_the_rule_says(rows, changes) -> None:
    """Hidden iff something lies over the face and all of it is loaded; rim iff a part is."""
    cover, loaded = CoverCounters(*csr(rows)), set()
    for verb, segments in changes:
        getattr(cover, verb)(segments)
        loaded = {
            "add": loaded | set(segments),
            "remove": loaded - set(segments),
            "show": set(segments),
        }[verb]
        assert cover.loaded == loaded
        assert cover.hidden.tolist() == [bool(row) and row <= loaded for row in rows]
        assert cover.rim.tolist() == [bool(row & loaded) and not row <= loaded for row in rows]


def test_hidden_is_a_view_that_cannot_be_written() -> None:
    cover = CoverCounters.of(Cover(np.array([0, 1], np.uint32), np.array([0], np.uint32)))
    hidden = cover.hidden
    cover.add([0])
    assert hidden.tolist() == [True]
    with pytest.raises(ValueError, match="read-only"):
        hidden[0] = False


def test_a_cover_without_faces_or_entries_is_fine() -> None:
    assert CoverCounters([0], []).face_count == 0
    empty = CoverCounters([0, 0, 0], [])
    assert empty.show([0, 5]).tolist() == [False, False]


@pytest.mark.parametrize(
    ("offsets", "segments", "text"),
    [
        ([], [], "expected \\(B \\+ 1,\\)"),
        ([1, 1], [0], "expected 0..1"),
        ([0, 2, 1], [0], "never falling"),
        ([0, 1], [0, 1], "run 0..1, expected 0..2"),
        ([0, 2], [1, 1], "expected them ascending"),
        ([0, 2], [-1, 1], "names segment -1"),
        ([0, 1], [2**25], "names segment 33554432, expected below 33554432"),
    ],
)
def test_arrays_that_are_no_cover_are_refused(offsets, segments, text: str) -> None:
    with pytest.raises(ProtocolViolationError, match=text):
        CoverCounters(offsets, segments)


def test_a_negative_id_is_the_callers_error() -> None:
    with pytest.raises(UsageError, match="segment id -3"):
        CoverCounters([0, 0], []).add([-3])
