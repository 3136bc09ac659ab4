"""Payload frames: literal bytes, truncations, contradictions, limits."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_wire import (
    FRAME_HEADER_BYTES,
    MAX_CHUNK_BYTES,
    MAX_FRAME_BYTES,
    MAX_SEGMENT_BYTES,
    DecodeError,
    Frame,
    MalformedError,
    TooLargeError,
    decode_frame,
    frame_header,
)

LITERAL = (
    b"\x01\x00\x18\x00"  # kind, nothing, 24
    b"\x04\x03\x02\x01"  # generation
    b"\x08\x07\x06\x05\x04\x03\x02\x01"  # key
    b"\x05\x00\x00\x00"  # offset
    b"\x08\x00\x00\x00"  # total
    b"abc"
)
FRAME = Frame(0x01020304, 0x0102030405060708, 5, 8, memoryview(b"abc"))


def test_literal_bytes_both_ways() -> None:
    header = frame_header(generation=FRAME.generation, key=FRAME.key, offset=5, total=8)
    assert header + b"abc" == LITERAL
    assert len(header) == FRAME_HEADER_BYTES
    assert decode_frame(LITERAL) == FRAME


@pytest.mark.parametrize("received", [bytes, bytearray, memoryview])
def test_any_bytes_like_is_taken_and_the_data_is_read_only(received: type) -> None:
    frame = decode_frame(received(LITERAL))
    assert frame is not None
    assert frame.data == b"abc"
    assert frame.data.readonly


def test_the_data_is_a_view_not_a_copy() -> None:
    data = bytearray(LITERAL)
    frame = decode_frame(data)
    data[-1:] = b"z"
    assert frame is not None
    assert frame.data == b"abz"


def test_every_truncation_is_malformed() -> None:
    for length in range(FRAME_HEADER_BYTES + 1):
        with pytest.raises(MalformedError):
            decode_frame(LITERAL[:length])


def test_bytes_beyond_total_are_malformed_with_the_offset() -> None:
    with pytest.raises(MalformedError) as caught:
        decode_frame(LITERAL + b"d")
    assert str(caught.value) == "got 4 bytes at 5, expected some within 8 (at byte 16)"


def test_the_largest_frame_is_taken_and_one_more_byte_is_not() -> None:
    header = frame_header(generation=0, key=0, offset=0, total=MAX_SEGMENT_BYTES)
    data = header + bytes(MAX_CHUNK_BYTES)
    assert len(data) == MAX_FRAME_BYTES == 131_072
    assert decode_frame(data) == Frame(0, 0, 0, MAX_SEGMENT_BYTES, memoryview(data)[24:])
    with pytest.raises(TooLargeError, match="got a frame of 131073 bytes, expected at most 131072"):
        decode_frame(data + b"\x00")


def test_the_first_byte_tells_frames_and_kinds_apart() -> None:
    for kind in (0x02, 0x7F):
        assert decode_frame(bytes([kind])) is None
    for other in (0x00, 0x80, 0xFF):
        with pytest.raises(MalformedError):
            decode_frame(bytes([other]) + LITERAL[1:])


@given(
    generation=st.integers(0, 2**32 - 1),
    key=st.integers(0, 2**64 - 1),
    offset=st.integers(0, 1000),
    rest=st.integers(0, 1000),
    data=st.binary(min_size=1, max_size=300),
)
def test_round_trip(generation: int, key: int, offset: int, rest: int, data: bytes) -> None:
    total = offset + len(data) + rest
    header = frame_header(generation=generation, key=key, offset=offset, total=total)
    assert decode_frame(header + data) == Frame(generation, key, offset, total, memoryview(data))


@given(data=st.binary(max_size=60), head=st.sampled_from([b"", LITERAL[:4], LITERAL[:16]]))
def test_random_bytes_give_a_frame_or_a_documented_error(data: bytes, head: bytes) -> None:
    try:
        frame = decode_frame(head + data)
    except DecodeError:
        pass
    else:
        assert frame is None or isinstance(frame, Frame)
