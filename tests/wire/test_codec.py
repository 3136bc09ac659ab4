"""Messages to bytes and back: literal bytes, every truncation, strangers, hostile input."""

from __future__ import annotations

import tracemalloc

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire.samples import SAMPLES

import terraport_wire as m
from terraport_wire import (
    MAX_CLIENT_MESSAGE_BYTES,
    MAX_CLIENT_VALUES,
    DecodeError,
    Direction,
    FieldError,
    MalformedError,
    TooLargeError,
    Unknown,
    decode,
    encode,
    is_payload,
    token_from_subprotocols,
    token_subprotocol,
)

C2S, S2C = Direction.CLIENT_TO_SERVER, Direction.SERVER_TO_CLIENT

LITERALS = [
    (m.Bye(), b"\x81\xa4type\xa3bye"),
    (m.Credit(bytes=65536), b"\x82\xa4type\xa6credit\xa5bytes\xce\x00\x01\x00\x00"),
    (
        m.Prefetch(
            generation=7, position=(1.0, 0.0, -2.0), radius_m=0.5, have=[1, 258], taken_bytes=3
        ),
        (
            b"\x86\xa4type\xa8prefetch\xaageneration\x07\xa8position\x93"
            b"\xcb\x3f\xf0\x00\x00\x00\x00\x00\x00\xcb\x00\x00\x00\x00\x00\x00\x00\x00"
            b"\xcb\xc0\x00\x00\x00\x00\x00\x00\x00\xa8radius_m\xcb\x3f\xe0\x00\x00\x00\x00\x00\x00"
            b"\xa4have\xc4\x10\x01\x00\x00\x00\x00\x00\x00\x00\x02\x01\x00\x00\x00\x00\x00\x00"
            b"\xabtaken_bytes\x03"
        ),
    ),
    (
        m.Ready(generation=1, missing=[0x0807060504030201], hidden=b"bits"),
        (
            b"\x84\xa4type\xa5ready\xaageneration\x01\xa7missing\xc4\x08"
            b"\x01\x02\x03\x04\x05\x06\x07\x08\xa6hidden\xc4\x04bits"
        ),
    ),
    (m.Picked(request=9), b"\x82\xa4type\xa6picked\xa7request\x09"),
]


@pytest.mark.parametrize(("message", "data"), LITERALS, ids=lambda v: getattr(v, "TYPE", ""))
def test_literal_bytes_both_ways(message: m.Message, data: bytes) -> None:
    assert encode(message) == data
    assert decode(data, message.DIRECTION) == message


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: message.TYPE)
def test_every_truncation_is_malformed(message: m.Message) -> None:
    whole = encode(message)
    for length in range(len(whole)):
        with pytest.raises(MalformedError):
            decode(whole[:length], message.DIRECTION)


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: message.TYPE)
def test_bytes_after_the_message_are_malformed(message: m.Message) -> None:
    whole = encode(message)
    for extra in (b"\x00", b"\xc0", whole):
        with pytest.raises(MalformedError):
            decode(whole + extra, message.DIRECTION)


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: message.TYPE)
def test_every_flipped_byte_gives_a_message_or_a_documented_error(message: m.Message) -> None:
    whole = encode(message)
    for position in range(len(whole)):
        for flip in (0x01, 0x80, 0xFF):
            flipped = bytearray(whole)
            flipped[position] ^= flip
            try:
                decode(flipped, message.DIRECTION)
            except DecodeError:
                continue


@settings(max_examples=250)
@given(data=st.data())
def test_round_trip(any_message: st.SearchStrategy[m.Message], data: st.DataObject) -> None:
    message = data.draw(any_message)
    wire = encode(message)
    decoded = decode(wire, message.DIRECTION)
    assert decoded == message
    assert isinstance(decoded, m.Message)
    assert encode(decoded) == wire


@settings(max_examples=300)
@given(data=st.binary(max_size=200), direction=st.sampled_from(Direction))
def test_random_bytes_give_a_documented_error(data: bytes, direction: Direction) -> None:
    try:
        decode(data, direction)
    except DecodeError:
        pass
    else:
        assert isinstance(msgpack.unpackb(data)["type"], str)


_ANY = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=8,
)


@settings(max_examples=300)
@given(data=st.data())
def test_any_value_in_any_field_gives_a_message_or_a_documented_error(data: st.DataObject) -> None:
    message = data.draw(st.sampled_from(SAMPLES))
    plain = msgpack.unpackb(encode(message))
    field = data.draw(st.sampled_from(sorted(plain)))
    plain[field] = data.draw(_ANY | st.binary(max_size=60))
    try:
        decoded = decode(msgpack.packb(plain), message.DIRECTION)
    except (MalformedError, FieldError):
        pass
    except UnicodeEncodeError:  # the test's own packb: a lone surrogate
        return
    else:
        assert isinstance(decoded, (m.Message, Unknown))


BOMBS = {
    "array32": b"\xdd\xff\xff\xff\xff",
    "map32": b"\xdf\xff\xff\xff\xff",
    "bin32": b"\xc6\xff\xff\xff\xff",
    "str32": b"\xdb\xff\xff\xff\xff",
    "ext32": b"\xc9\xff\xff\xff\xff\x01",
    "nested_arrays": b"\xdd\x00\x0f\xff\xff" * 200_000,
    "nested_small_arrays": b"\xdc\x40\x00" * 300_000,
    "deep": b"\x91" * 1_000_000,
    "deep_maps": b"\x81\xa1a" * 300_000,
}


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS)
def test_declared_lengths_reserve_no_memory(bomb: bytes) -> None:
    data = b"\x82\xa4type\xa3bye\xa5later" + bomb
    tracemalloc.start()
    try:
        with pytest.raises(MalformedError):
            decode(data, C2S)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4 * len(data) + 2_000_000


def test_a_message_beyond_the_limit_is_too_large_before_it_is_parsed() -> None:
    data = bytes(MAX_CLIENT_MESSAGE_BYTES + 1)
    with pytest.raises(TooLargeError) as caught:
        decode(data, C2S)
    expected = f"got a message of {len(data)} bytes, expected at most {MAX_CLIENT_MESSAGE_BYTES}"
    assert str(caught.value) == expected
    assert caught.value.close_code == 4413


def test_max_bytes_cannot_raise_the_protocols_own_limit() -> None:
    with pytest.raises(TooLargeError):
        decode(bytes(MAX_CLIENT_MESSAGE_BYTES + 1), C2S, max_bytes=10**9)


def test_a_text_message_is_malformed() -> None:
    with pytest.raises(MalformedError, match="got a text message, expected a binary one"):
        decode('{"type":"bye"}', C2S)


@pytest.mark.parametrize("received", [bytes, bytearray, memoryview])
def test_any_bytes_like_is_taken(received: type) -> None:
    assert decode(received(b"\x81\xa4type\xa3bye"), C2S) == m.Bye()


def test_repeated_keys_are_malformed() -> None:
    with pytest.raises(MalformedError, match="got key 'type' twice, expected each key once"):
        decode(b"\x82\xa4type\xa3bye\xa4type\xa3bye", C2S)


def test_an_unknown_type_is_skipped_whatever_it_holds() -> None:
    data = msgpack.packb({"type": "wave", "generation": "no number", "x": [{"y": b"z"}]})
    assert decode(data, C2S) == Unknown("wave")


def test_field_errors_name_field_value_and_generation() -> None:
    land = {"type": "land", "generation": 12, "position": [0, 0, 0], "radius_m": -3,
            "have": b"", "taken_bytes": 0}  # fmt: skip
    with pytest.raises(FieldError) as caught:
        decode(msgpack.packb(land), C2S)
    error = caught.value
    assert str(error) == "land.radius_m: got -3, expected a number above 0 to 1000000"
    assert (error.message_type, error.field, error.generation, error.request) == (
        "land",
        "radius_m",
        12,
        None,
    )
    assert not error.fatal


def test_an_unreadable_generation_is_not_named() -> None:
    land = {"type": "land", "generation": -1, "position": [0, 0, 0], "radius_m": 3,
            "have": b"", "taken_bytes": 0}  # fmt: skip
    with pytest.raises(FieldError) as caught:
        decode(msgpack.packb(land), C2S)
    assert caught.value.generation is None


def test_error_texts_stay_short_whatever_was_sent() -> None:
    for value in ("x" * 100_000, [1] * 1_000, {str(n): 1 for n in range(500)}, 2**64 - 1):
        data = msgpack.packb({"type": "credit", "bytes": value})
        with pytest.raises(FieldError) as caught:
            decode(data, C2S)
        assert len(str(caught.value)) < 300


def test_payload_frames_and_messages_are_told_apart_by_the_first_byte() -> None:
    assert is_payload(b"\x01")
    assert is_payload(memoryview(b"\x7f\x00"))
    assert not is_payload(b"\x80")
    assert not is_payload(b"")
    assert not is_payload("\x01")
    for message in SAMPLES:
        assert not is_payload(encode(message))


@given(token=st.text(st.characters(exclude_categories=["Cs"]), max_size=80))
def test_tokens_travel_as_a_subprotocol(token: str) -> None:
    entry = token_subprotocol(token)
    assert entry.startswith("terraport.token.")
    assert not set(entry) & set("=/+, ")
    assert token_from_subprotocols(["terraport.v2.msgpack", entry]) == token


def test_a_token_entry_literally() -> None:
    assert token_subprotocol("a?>ü") == "terraport.token.YT8-w7w"


@pytest.mark.parametrize(
    "entry", ["terraport.token.!", "terraport.token._w", "terraport.token.YQ=a"]
)
def test_a_token_entry_that_does_not_decode_is_no_token(entry: str) -> None:
    assert token_from_subprotocols([entry]) is None
    assert token_from_subprotocols(["terraport.v2.msgpack"]) is None


def test_a_client_sends_few_values() -> None:
    """A server looks at each; bytes alone bound nothing."""
    for message in ({"type": "bye"}, {"later": 1, "type": "wave"}):
        nils = MAX_CLIENT_VALUES - 2 * len(message) - 3
        decode(msgpack.packb({**message, "x": [None] * nils}), C2S)
        with pytest.raises(MalformedError, match="got more than 1024 values, expected fewer"):
            decode(msgpack.packb({**message, "x": [None] * (nils + 1)}), C2S)


def test_of_an_unknown_type_that_stands_first_nothing_else_is_looked_at() -> None:
    whole = msgpack.packb({"type": "wave", "x": [None] * 100_000})
    for data in (whole, whole[:40], whole + b"\xc1", b"\x82\xa4type\xa4wave\xc1"):
        for direction in Direction:
            assert decode(data, direction) == Unknown("wave")
    with pytest.raises(TooLargeError):
        decode(whole, C2S, max_bytes=1000)
