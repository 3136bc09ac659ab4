"""The structure walk agrees with the msgpack library on what is one whole value."""

from __future__ import annotations

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_wire import MAX_DEPTH, MalformedError
from terraport_wire.guard import check_msgpack, leading_type

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


@settings(max_examples=200)
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


def test_depth_is_bounded() -> None:
    deepest: object = []
    for _ in range(MAX_DEPTH - 1):
        deepest = [deepest]
    check_msgpack(msgpack.packb(deepest))
    for value in ([deepest], {"a": deepest}):
        with pytest.raises(MalformedError, match="got nesting beyond 16 levels"):
            check_msgpack(msgpack.packb(value))


@settings(max_examples=200)
@given(value=_VALUES)
def test_values_are_counted_with_keys_and_containers(value: object) -> None:
    data, count = msgpack.packb(value), _count(value)
    check_msgpack(data, max_values=count)
    with pytest.raises(MalformedError, match=f"got more than {count - 1} values, expected fewer"):
        check_msgpack(data, max_values=count - 1)


def _count(value: object) -> int:
    if isinstance(value, dict):
        return 1 + sum(_count(key) + _count(inner) for key, inner in value.items())
    return 1 + sum(map(_count, value)) if isinstance(value, list) else 1


@pytest.mark.parametrize(
    "name", ["", "land", "ü" * 20, "x" * 31, "x" * 32, "x" * 300, "x" * 70_000]
)
def test_the_leading_type_is_the_first_keys(name: str) -> None:
    data = msgpack.packb({"type": name, "later": [1, 2]})
    assert leading_type(data) == name
    assert leading_type(b"\xde\x00\x02" + data[1:]) == name
    assert leading_type(b"\xdf\x00\x00\x00\x02" + data[1:]) == name
    end = len(data) - len(msgpack.packb("later")) - len(msgpack.packb([1, 2]))
    assert leading_type(data[:end]) == name
    assert [leading_type(data[:length]) for length in {*range(min(end, 40)), end - 1}] == [
        None for _ in {*range(min(end, 40)), end - 1}
    ]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        msgpack.packb({"later": 1, "type": "bye"}),
        msgpack.packb({"type": 5}),
        msgpack.packb({"type": b"bye"}),
        msgpack.packb({}),
        msgpack.packb(["type", "bye"]),
        b"\x81\xa4type\xa2\xff\xfe",
    ],
)
def test_there_is_no_leading_type(data: bytes) -> None:
    assert leading_type(data) is None
