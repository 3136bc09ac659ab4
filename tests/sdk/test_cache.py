"""The memory cache against a list that does the same slowly."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport.cache import CachedSegment, SegmentCache, SegmentFacts
from terraport.errors import UsageError


def entry(segment: int, size: int) -> CachedSegment:
    facts = SegmentFacts(segment, size, segment, 1, 3, (0, 0, 0, 1, 1, 1))
    return CachedSegment(facts, bytes(size))


IDS = st.integers(0, 6)
OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), IDS, st.integers(1, 50)),
        st.tuples(st.just("get"), IDS),
        st.tuples(st.just("discard"), IDS),
        st.tuples(st.just("pin"), st.frozensets(IDS, max_size=3)),
        st.tuples(st.just("trim")),
    ),
    max_size=40,
)


@given(operations=OPERATIONS, max_bytes=st.integers(0, 120))
def test_any_history_gives_what_a_list_gives(operations, max_bytes: int) -> None:
    """Least recently used goes first, pinned never, and only as much as must."""
    cache = SegmentCache(max_bytes)
    model: list[tuple[int, int]] = []  # (id, size), least recently used first
    pinned: frozenset[int] = frozenset()
    for operation in operations:
        match operation:
            case ("put", segment, size):
                cache.put(entry(segment, size))
                model = [item for item in model if item[0] != segment] + [(segment, size)]
            case ("get", segment):
                cached = [item for item in model if item[0] == segment]
                assert (cache.get(segment) is not None) == bool(cached)
                model = [item for item in model if item[0] != segment] + cached
            case ("discard", segment):
                assert cache.discard(segment) == any(item[0] == segment for item in model)
                model = [item for item in model if item[0] != segment]
            case ("pin", segments):
                cache.pin(segments)
                pinned = segments
            case ("trim",):
                gone = []
                for item in [item for item in model if item[0] not in pinned]:
                    if sum(size for _, size in model) <= max_bytes:
                        break
                    model.remove(item)
                    gone.append(item[0])
                assert [facts.segment for facts in cache.trim()] == gone
        assert list(cache) == [segment for segment, _ in model]
        assert cache.bytes == sum(size for _, size in model)
        assert len(cache) == len(model)


def test_peek_changes_no_age() -> None:
    cache = SegmentCache(10)
    for segment in (1, 2):
        cache.put(entry(segment, 5))
    assert cache.peek(1) is not None
    cache.put(entry(3, 5))
    assert [facts.segment for facts in cache.trim()] == [1]


def test_a_negative_bound_is_refused() -> None:
    with pytest.raises(UsageError, match="-1 bytes, expected 0 or more"):
        SegmentCache(-1)
