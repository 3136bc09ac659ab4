"""Good cases: what every decoder must take, and what it must skip."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterator
from typing import Any

import msgpack

import terraport_wire as m
from terraport_wire import HEADER_BYTES, MAX_CLIENT_VALUES, PayloadFrame, encode_frame

from .cases import C2S, S2C, Case, frame, good, pack, unknown
from .wire_samples import FULL, MINIMAL, by_type, plain

# A value of every shape, as a later version might send in a field that we do not know.
STRANGE = {"a": [1, -1, 2.5, None, True, "ü", {"b": [[]]}], "": {}}


def good_cases() -> Iterator[Case]:
    """Yield all good cases."""
    for message in MINIMAL:
        yield good(message, "minimal")
    for message in FULL:
        yield good(message, "full")
        yield from _rearranged(message, plain(message))
    yield from _nested()
    yield from _unknown_types()
    yield from _msgpack_formats()
    yield from _frames()


def _rearranged(message: m.Message, fields: dict[str, Any]) -> Iterator[Case]:
    yield good(message, "unknown_field", pack({"later": STRANGE, **fields, "x": 1}))
    backwards = dict(reversed(fields.items()))
    if backwards != fields or len(fields) > 1:
        yield good(message, "reordered", pack(backwards))
    smallest = by_type(MINIMAL)[message.TYPE]
    absent = set(fields) - set(plain(smallest))
    if absent:
        nulls = plain(smallest) | dict.fromkeys(sorted(absent))
        yield good(smallest, "null_is_absent", pack(nulls))


def _nested() -> Iterator[Case]:
    full = by_type(FULL)
    for type_name, field in (("hello", "budgets"), ("welcome", "scene"), ("picked", "hit")):
        fields = plain(full[type_name])
        fields[field] = {"later": STRANGE, **fields[field]}
        yield good(full[type_name], "unknown_nested_field", pack(fields))
    picked = plain(full["picked"])
    unnamed = {**picked["hit"], "stable_id": None, "label": None}
    met = full["picked"]
    assert isinstance(met, m.Picked)
    assert met.hit is not None
    nameless = dataclasses.replace(met.hit, stable_id=None, label=None)
    without = m.Picked(request=met.request, hit=nameless)
    yield good(without, "null_name_is_absent", pack({**picked, "hit": unnamed}))
    land = plain(full["land"])
    whole = {
        **land,
        "radius_m": 60,
        "inner_radius_m": 20,
        "coarse_radius_m": 180,
        "position": [12, -3, 0],
    }
    numbers = m.Land(
        generation=77,
        position=(12, -3, 0),
        radius_m=60,
        inner_radius_m=20,
        deadline_ms=1500,
        stall_ms=400,
        coarse_radius_m=180,
    )
    yield good(numbers, "integers_as_numbers", pack(whole))
    deepest: Any = 1
    for _ in range(15):
        deepest = [deepest]
    yield good(m.Bye(), "deepest", pack({"type": "bye", "later": deepest}))


def _unknown_types() -> Iterator[Case]:
    yield unknown(C2S, "type", "wave", pack({"type": "wave", "later": STRANGE}))
    yield unknown(S2C, "type_server", "wave", pack({"type": "wave"}))
    yield unknown(C2S, "empty_type", "", pack({"type": ""}))
    yield unknown(C2S, "other_direction", "plan", pack({"type": "plan"}))
    long_name = "x" * 100
    yield unknown(C2S, "long_type", "x" * 64, pack({"type": long_name}))


def _msgpack_formats() -> Iterator[Case]:
    """Wider formats than the shortest: legal, and some encoders write them."""
    full = by_type(FULL)
    credit, aim, evict = m.Credit(bytes=5), by_type(MINIMAL)["aim"], m.Evict(segments=[3, 9])
    key = msgpack.packb
    # As many values as a message may have.
    for message, count in (
        (full["bye"], MAX_CLIENT_VALUES),
        (full["superseded"], 2 * MAX_CLIENT_VALUES),  # a server's are bounded by bytes alone
    ):
        fields = plain(message)
        nils = [None] * (count - 2 * len(fields) - 3)
        yield good(message, "most_values", pack({**fields, "later": nils}))
    # Integers and strings in every width.
    start = b"\x82" + key("type") + key("credit") + key("bytes")
    for feature, token in (
        ("uint8", b"\xcc\x05"),
        ("uint16", b"\xcd\x00\x05"),
        ("uint32", b"\xce\x00\x00\x00\x05"),
        ("uint64", b"\xcf" + bytes(7) + b"\x05"),
        ("int8", b"\xd0\x05"),
        ("int64", b"\xd3" + bytes(7) + b"\x05"),
    ):
        yield good(credit, feature, start + token)
    text = b"\x82" + b"\xd9\x04type" + b"\xda\x00\x06credit" + b"\xdb\x00\x00\x00\x05bytes\x05"
    yield good(credit, "str_formats", text)
    # Maps, byte strings, arrays and floats.
    for feature, head in (("map16", b"\xde\x00\x02"), ("map32", b"\xdf\x00\x00\x00\x02")):
        yield good(credit, feature, head + start[1:] + b"\x05")
    ids = struct.pack("<2I", 3, 9)
    start = b"\x82" + key("type") + key("evict") + key("segments")
    for feature, head in (("bin16", b"\xc5\x00\x08"), ("bin32", b"\xc6\x00\x00\x00\x08")):
        yield good(evict, feature, start + head + ids)
    fields = b"\x84" + key("type") + key("aim") + key("generation") + b"\x00" + key("radius_m")
    float32 = (
        fields + b"\xca" + struct.pack(">f", 0.5) + key("position") + b"\xdc\x00\x03\x00\x00\x00"
    )
    yield good(aim, "float32_array16", float32)
    yield good(
        full["bye"],
        "array32",
        key({"type": "bye"})[:0]
        + b"\x82"
        + key("type")
        + key("bye")
        + key("later")
        + b"\xdd\x00\x00\x00\x01\xc0",
    )


def _frames() -> Iterator[Case]:
    def case(feature: str, data: bytes, *numbers: int, chunk: bytes) -> Case:
        generation, segment, offset, total = numbers
        return frame(
            feature,
            data,
            {
                "frame": {
                    "generation": generation,
                    "segment": segment,
                    "offset": offset,
                    "total": total,
                    "last": offset + len(chunk) == total,
                    "chunk_hex": chunk.hex(),
                }
            },
        )

    # First, middle and last chunks, up to the greatest numbers.
    chunk = b"terraport"
    for feature, numbers in (
        ("whole", (1, 2, 0, 9)),
        ("first", (1, 2, 0, 100)),
        ("middle", (4_294_967_295, 4_294_967_295, 50, 100)),
        ("last", (7, 8, 67_108_855, 67_108_864)),
    ):
        data = encode_frame(PayloadFrame(*numbers, memoryview(chunk)))
        yield case(feature, data, *numbers, chunk=chunk)
    # What a later version may add, and a reader of this one passes over.
    plain_frame = encode_frame(PayloadFrame(1, 2, 0, 9, memoryview(chunk)))
    longer = plain_frame[:2] + b"\x20\x00" + plain_frame[4:24] + b"\xff" * 8 + chunk
    yield case("longer_header", longer, 1, 2, 0, 9, chunk=chunk)
    longest = plain_frame[:2] + b"\x00\x04" + plain_frame[4:24] + bytes(1000) + chunk
    yield case("longest_header", longest, 1, 2, 0, 9, chunk=chunk)
    yield case("flag_bits", b"\x01\xff" + plain_frame[2:], 1, 2, 0, 9, chunk=chunk)
    reserved = plain_frame[:20] + b"\xff" * 4 + chunk
    yield case("reserved_bits", reserved, 1, 2, 0, 9, chunk=chunk)
    yield case(
        "one_byte", plain_frame[:16] + b"\x01\0\0\0" + bytes(4) + b"!", 1, 2, 0, 1, chunk=b"!"
    )
    assert len(plain_frame) == HEADER_BYTES + len(chunk)
    # Kinds of a later version are ignored whole.
    for kind in (0x02, 0x7F):
        facts = {"frame": {"unknown_kind": kind}}
        yield frame(f"unknown_kind_{kind:02x}", bytes([kind]) + b"whatever", facts)
        yield frame(f"unknown_kind_{kind:02x}_alone", bytes([kind]), facts)
