"""The structure walk agrees with the msgpack library on what is one whole value."""

from __future__ import annotations

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_wire import MAX_DEPTH, MalformedError
from terraport_wire.guard import check_depth, check_msgpack

_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=300)
    | st.binary(max_size=300),
    lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=30,
)


@settings(max_examples=200, deadline=None)
@given(value=_VALUES)
def test_whole_values_pass_and_cut_or_longer_ones_do_not(value: object) -> None:
    data = msgpack.packb(value)
    check_msgpack(data)
    for wrong in (data[:-1], data + b"\x00"):
        with pytest.raises(MalformedError):
            check_msgpack(wrong)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "got the end of the message, expected a value (at byte 0)"),
        (b"\x92\x01", "got the end of the message, expected a value (at byte 2)"),
        (b"\xcd\x01", "got 2 bytes, expected 3 of a value (at byte 0)"),
        (b"\x91\xc5\x01", "got 2 bytes, expected a length of 2 bytes (at byte 1)"),
        (b"\xdd\x00\x01\x00\x00", "got 65536 items, expected at most 16384 (at byte 0)"),
        (b"\x91\xc1", "got msgpack token 0xc1, which no message uses (at byte 1)"),
        (b"\xd4\x00\x00", "got msgpack token 0xd4, which no message uses (at byte 0)"),
        (b"\xc0\xc0", "got 1 bytes after the message, expected none (at byte 1)"),
    ],
)
def test_texts(data: bytes, text: str) -> None:
    with pytest.raises(MalformedError) as caught:
        check_msgpack(data)
    assert str(caught.value) == text


def test_depth_counts_the_same_in_both_forms() -> None:
    deepest: object = []
    for _ in range(MAX_DEPTH - 1):
        deepest = [deepest]
    check_msgpack(msgpack.packb(deepest))
    check_depth(deepest)
    for value in ([deepest], {"a": deepest}):
        with pytest.raises(MalformedError, match="got nesting beyond 16 levels"):
            check_msgpack(msgpack.packb(value))
        with pytest.raises(MalformedError, match="got nesting beyond 16 levels"):
            check_depth(value)
