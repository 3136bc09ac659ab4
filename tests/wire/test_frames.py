"""Payload frames: literal bytes, truncations, contradictions, limits."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_wire import (
    MAX_CHUNK_BYTES,
    MAX_FRAME_BYTES,
    MAX_SEGMENT_BYTES,
    DecodeError,
    InvalidMessageError,
    MalformedError,
    PayloadFrame,
    TooLargeError,
    UnknownFrame,
    decode_frame,
    encode_frame,
    frame_header,
)

LITERAL = (
    b"\x01\x01\x18\x00"  # kind, last, 24
    b"\x04\x03\x02\x01"  # generation
    b"\x07\x00\x00\x00"  # segment
    b"\x05\x00\x00\x00"  # offset
    b"\x08\x00\x00\x00"  # total
    b"\x00\x00\x00\x00"  # reserved
    b"abc"
)


def test_literal_bytes_both_ways() -> None:
    frame = PayloadFrame(0x01020304, 7, 5, 8, memoryview(b"abc"))
    assert encode_frame(frame) == LITERAL
    assert decode_frame(LITERAL) == frame
    assert frame.last


@pytest.mark.parametrize("received", [bytes, bytearray, memoryview])
def test_any_bytes_like_is_taken_and_the_chunk_is_read_only(received: type) -> None:
    frame = decode_frame(received(LITERAL))
    assert isinstance(frame, PayloadFrame)
    assert frame.chunk == b"abc"
    assert frame.chunk.readonly


def test_the_chunk_is_a_view_not_a_copy() -> None:
    data = bytearray(LITERAL)
    frame = decode_frame(data)
    data[-1:] = b"z"
    assert isinstance(frame, PayloadFrame)
    assert frame.chunk == b"abz"


def test_every_truncation_is_malformed() -> None:
    for length in range(len(LITERAL)):
        with pytest.raises(MalformedError):
            decode_frame(LITERAL[:length])


def test_bytes_beyond_total_are_malformed_with_the_offset() -> None:
    with pytest.raises(MalformedError) as caught:
        decode_frame(LITERAL + b"d")
    assert str(caught.value) == "got 4 bytes at 5, expected to end within 8 (at byte 12)"
    assert caught.value.offset == 12


def test_a_longer_header_is_skipped() -> None:
    longer = LITERAL[:2] + b"\x1a\x00" + LITERAL[4:24] + b"??" + b"abc"
    assert decode_frame(longer) == decode_frame(LITERAL)


def test_unknown_kinds_are_skipped_whatever_follows() -> None:
    assert decode_frame(b"\x02") == UnknownFrame(2)
    assert decode_frame(b"\x7f" + bytes(100)) == UnknownFrame(127)


def test_the_largest_frame_is_taken_and_one_more_byte_is_not() -> None:
    chunk = memoryview(bytes(MAX_CHUNK_BYTES))
    data = encode_frame(PayloadFrame(0, 0, 0, MAX_SEGMENT_BYTES, chunk))
    assert len(data) == MAX_FRAME_BYTES == 131_072
    assert decode_frame(data) == PayloadFrame(0, 0, 0, MAX_SEGMENT_BYTES, chunk)
    with pytest.raises(TooLargeError, match="got a frame of 131073 bytes, expected at most 131072"):
        decode_frame(data + b"\x00")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"generation": -1}, "frame.generation: got -1, expected 0 to 4294967295"),
        ({"segment": 2**32}, "frame.segment: got 4294967296, expected 0 to 4294967295"),
        ({"total": 0}, "frame.total: got 0, expected 1 to 67108864"),
        ({"total": 2**27}, "frame.total: got 134217728, expected 1 to 67108864"),
        ({"length": 0}, "frame.length: got 0, expected 1 to 131048"),
        ({"length": 131_049}, "frame.length: got 131049, expected 1 to 131048"),
        ({"offset": -1}, "frame.offset: got -1 with 3 bytes, expected to end within 8"),
        ({"offset": 6}, "frame.offset: got 6 with 3 bytes, expected to end within 8"),
    ],
)
def test_a_frame_that_may_not_be_sent_is_our_own_error(change: dict[str, int], text: str) -> None:
    good = {"generation": 1, "segment": 2, "offset": 5, "total": 8, "length": 3}
    with pytest.raises(InvalidMessageError) as caught:
        frame_header(**{**good, **change})
    assert str(caught.value) == text


@given(
    generation=st.integers(0, 2**32 - 1),
    segment=st.integers(0, 2**32 - 1),
    offset=st.integers(0, 1000),
    rest=st.integers(0, 1000),
    chunk=st.binary(min_size=1, max_size=300),
)
def test_round_trip(generation: int, segment: int, offset: int, rest: int, chunk: bytes) -> None:
    total = offset + len(chunk) + rest
    frame = PayloadFrame(generation, segment, offset, total, memoryview(chunk))
    assert decode_frame(encode_frame(frame)) == frame
    assert frame.last == (rest == 0)


@given(data=st.binary(max_size=60), head=st.sampled_from([b"", LITERAL[:4], LITERAL[:16]]))
def test_random_bytes_give_a_frame_or_a_documented_error(data: bytes, head: bytes) -> None:
    try:
        frame = decode_frame(head + data)
    except DecodeError:
        pass
    else:
        assert isinstance(frame, (PayloadFrame, UnknownFrame))
