"""Bad cases: what every decoder must refuse, with which code and at which field."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import Any

import msgpack

import terraport_wire as m
from terraport_wire import (
    MAX_CLIENT_MESSAGE_BYTES,
    MAX_CLIENT_VALUES,
    MAX_FRAME_BYTES,
    MAX_SEGMENT_BYTES,
    MAX_SERVER_MESSAGE_BYTES,
    PayloadFrame,
    encode_frame,
)
from terraport_wire.kinds import Flag
from terraport_wire.message import fields_of

from .cases import C2S, S2C, Case, bad, frame, pack
from .wire_samples import FULL, MINIMAL, by_type, plain

MALFORMED = {"code": "malformed", "fatal": True}
TOO_LARGE = {"code": "too_large", "fatal": True}


def bad_cases() -> Iterator[Case]:
    """Yield all bad cases."""
    for message in FULL:
        yield from _truncated(message)
        yield from _fields(message)
    yield from _values()
    yield from _structure()
    yield from _oversized()
    yield from _msgpack_bytes()
    yield from _frames()


def _refused(message: m.Message, fields: dict[str, Any], field: str) -> dict[str, Any]:
    error = {
        "code": "invalid_field",
        "fatal": message.TYPE not in ("aim", "land", "pick", "join", "gather"),
        "field": field,
    }
    field_names = {item.name for item in fields_of(type(message))}
    for name in ("generation", "request"):
        value = fields.get(name)
        if name in field_names and type(value) is int and 0 <= value < 2**32:
            error[name] = value
    return error


def _truncated(message: m.Message) -> Iterator[Case]:
    """Cut in the first key, in the middle, and before the last byte."""
    whole = pack(plain(message))
    for feature, length in (("start", 3), ("middle", len(whole) // 2), ("end", len(whole) - 1)):
        name = f"{message.TYPE}-truncated_{feature}"
        yield bad(message.DIRECTION, name, whole[:length], MALFORMED)


def _fields(message: m.Message) -> Iterator[Case]:
    """Leave out each required field; give each field a value of a wrong type."""
    whole = plain(message)
    for field in fields_of(type(message)):
        if field.required:
            fields = {name: value for name, value in whole.items() if name != field.name}
            error = _refused(message, fields, field.name)
            name = f"{message.TYPE}-missing_{field.name}"
            yield bad(message.DIRECTION, name, pack(fields), error)
        fields = {**whole, field.name: 1 if isinstance(field.kind, Flag) else True}
        error = _refused(message, fields, field.name)
        name = f"{message.TYPE}-mistyped_{field.name}"
        yield bad(message.DIRECTION, name, pack(fields), error)


def _values() -> Iterator[Case]:
    """Values out of range, and fields that contradict each other."""
    messages = by_type(FULL) | {
        "small": by_type(MINIMAL)["land"],
        "plan0": by_type(MINIMAL)["plan"],
    }
    for type_name, feature, field, change in _CHANGES + _PACKED + _NOT_FINITE:
        message = messages[type_name]
        fields = {**plain(message), **change}
        error = _refused(message, fields, field)
        name = f"{message.TYPE}-{feature}"
        yield bad(message.DIRECTION, name, pack(fields), error)


def _packed_row(segment: int = 1, length: int = 5, *bounds: float) -> bytes:
    return struct.pack("<IIQII6f", segment, length, 0, 3, 4, *(bounds or (0, 0, 0, 1, 1, 1)))


_SCENE = plain(by_type(FULL)["welcome"])["scene"]
_HIT = plain(by_type(FULL)["picked"])["hit"]
_LIMITS = plain(by_type(FULL)["welcome"])["limits"]
_MEMBER = {"member": 1, "role": "guide", "present": True}
_SUMS = {"load_bytes": 5, "load_triangles": 3, "total_bytes": 5, "total_triangles": 3}

# (message, feature, refused field, fields that replace the good ones)
_CHANGES: list[tuple[str, str, str, dict[str, Any]]] = [
    ("small", "radius_negative", "radius_m", {"radius_m": -1.0}),
    ("small", "radius_zero", "radius_m", {"radius_m": 0}),
    ("small", "radius_too_large", "radius_m", {"radius_m": 1_000_000.5}),
    ("small", "radius_text", "radius_m", {"radius_m": "60"}),
    ("small", "generation_negative", "generation", {"generation": -1}),
    ("small", "generation_too_large", "generation", {"generation": 2**32}),
    ("small", "generation_fraction", "generation", {"generation": 1.5}),
    ("small", "position_of_two", "position", {"position": [0.0, 0.0]}),
    ("small", "position_of_four", "position", {"position": [0.0, 0.0, 0.0, 0.0]}),
    ("small", "position_text", "position", {"position": [0.0, "0", 0.0]}),
    ("small", "position_map", "position", {"position": {"x": 0, "y": 0, "z": 0}}),
    ("small", "position_too_far", "position", {"position": [0.0, 1e7 + 1, 0.0]}),
    ("small", "inner_beyond_radius", "inner_radius_m", {"inner_radius_m": 60.5}),
    ("small", "coarse_below_radius", "coarse_radius_m", {"coarse_radius_m": 59.5}),
    ("small", "deadline_without_inner", "deadline_ms", {"deadline_ms": 100}),
    ("small", "deadline_zero", "deadline_ms", {"inner_radius_m": 1.0, "deadline_ms": 0}),
    ("small", "deadline_too_long", "deadline_ms", {"inner_radius_m": 1.0, "deadline_ms": 600_001}),
    ("small", "stall_without_inner", "stall_ms", {"stall_ms": 100}),
    ("small", "stall_zero", "stall_ms", {"inner_radius_m": 1.0, "stall_ms": 0}),
    ("aim", "radius_negative", "radius_m", {"radius_m": -1.0}),
    ("aim", "coarse_below_radius", "coarse_radius_m", {"coarse_radius_m": 0.25}),
    ("join", "group_empty", "group", {"group": ""}),
    ("join", "group_too_long", "group", {"group": "x" * 65}),
    ("join", "group_with_slash", "group", {"group": "../a"}),
    ("join", "group_with_space", "group", {"group": "a b"}),
    ("join", "role_unknown", "role", {"role": "owner"}),
    ("join", "name_too_long", "name", {"name": "x" * 65}),
    ("join", "seat_too_long", "seat", {"seat": "x" * 65}),
    ("gather", "radius_zero", "radius_m", {"radius_m": 0}),
    ("gather", "position_of_two", "position", {"position": [0.0, 0.0]}),
    ("gather", "inner_beyond_radius", "inner_radius_m", {"inner_radius_m": 60.5}),
    ("gather", "deadline_too_long", "deadline_ms", {"deadline_ms": 600_001}),
    ("arrived", "gathering_zero", "gathering", {"gathering": 0}),
    ("arrived", "state_unknown", "state", {"state": "soon"}),
    ("roster", "member_incomplete", "members.0.role", {"members": [{"member": 1}]}),
    (
        "roster",
        "position_of_two",
        "members.0.position",
        {"members": [{**_MEMBER, "position": [1.0, 2.0]}]},
    ),
    (
        "roster",
        "position_nan",
        "members.0.position",
        {"members": [{**_MEMBER, "position": [1.0, math.nan, 2.0]}]},
    ),
    ("roster", "members_of_numbers", "members.1", {"members": [_MEMBER, 5]}),
    (
        "roster",
        "too_many_members",
        "members",
        {"members": [_MEMBER] * 1025},
    ),
    ("gathering", "left_negative", "left_ms", {"left_ms": -1}),
    ("welcome", "groups_unknown", "limits.groups", {"limits": {**_LIMITS, "groups": "maybe"}}),
    ("credit", "zero", "bytes", {"bytes": 0}),
    ("credit", "negative", "bytes", {"bytes": -5}),
    ("credit", "too_large", "bytes", {"bytes": 2**53}),
    ("pick", "direction_zero", "direction", {"direction": [0, 0, 0]}),
    ("pick", "request_too_large", "request", {"request": 2**32}),
    ("reject", "reason_too_long", "reason", {"reason": "x" * 65}),
    ("hello", "client_too_long", "client", {"client": "x" * 129}),
    ("hello", "token_too_long", "token", {"token": "x" * 4097}),
    ("hello", "encoding_unknown", "encoding", {"encoding": "obj"}),
    ("hello", "protocol_of_one", "protocol", {"protocol": [1]}),
    ("hello", "protocol_negative", "protocol", {"protocol": [1, -1]}),
    ("hello", "budget_negative", "budgets.max_triangles", {"budgets": {"max_triangles": -1}}),
    ("hello", "budget_fraction", "budgets.max_bytes", {"budgets": {"max_bytes": 1.5}}),
    ("hello", "release_factor_below_one", "release_factor", {"release_factor": 0.99}),
    ("hello", "release_factor_too_large", "release_factor", {"release_factor": 4.01}),
    (
        "welcome",
        "scene_incomplete",
        "scene.version",
        {"scene": {name: _SCENE[name] for name in ("id", "name", "segment_count")}},
    ),
    ("welcome", "scene_empty_id", "scene.id", {"scene": {**_SCENE, "id": ""}}),
    ("notice", "kind_with_capitals", "kind", {"kind": "Draining"}),
    ("error", "message_too_long", "message", {"message": "x" * 1025}),
    ("error", "protocols_of_numbers", "protocols", {"protocols": [1, 0]}),
    (
        "picked",
        "attribute_text",
        "hit.attributes.grade",
        {"hit": {**_HIT, "attributes": {"grade": "1"}}},
    ),
    ("picked", "label_too_long", "hit.label", {"hit": {**_HIT, "label": "x" * 257}}),
    ("picked", "stable_id_fraction", "hit.stable_id", {"hit": {**_HIT, "stable_id": 1.5}}),
    ("picked", "stable_id_too_large", "hit.stable_id", {"hit": {**_HIT, "stable_id": 2**32}}),
    ("plan", "sum_of_bytes", "load_bytes", {"load_bytes": 67_109_866}),
    ("plan", "sum_of_triangles", "load_triangles", {"load_triangles": 21_999}),
    ("plan", "total_below_load", "total_bytes", {"total_bytes": 67_109_864}),
    ("plan", "omitted_without_reason", "omitted_by", {"omitted_by": None}),
    ("plan", "reason_without_omitted", "omitted_by", {"omitted_segments": 0}),
    ("plan", "omitted_by_unknown", "omitted_by", {"omitted_by": "max_patience"}),
    ("prefetch", "sum_of_bytes", "bytes", {"bytes": 1_000}),
]
_ID = struct.Struct("<I").pack
_PACKED: list[tuple[str, str, str, dict[str, Any]]] = [
    ("evict", "ids_twice", "segments", {"segments": _ID(3) + _ID(1) + _ID(3)}),
    ("evict", "ids_cut", "segments", {"segments": b"\x01\x00\x00"}),
    ("evict", "ids_as_array", "segments", {"segments": [1, 2]}),
    ("evict", "ids_as_text", "segments", {"segments": "abcd"}),
    ("evict", "too_many_ids", "segments", {"segments": b"".join(map(_ID, range(32_769)))}),
    ("hello", "held_cut", "held", {"held": bytes(23)}),
    ("hello", "held_twice", "held", {"held": bytes(24)}),
    ("held", "held_cut", "segments", {"segments": bytes(23)}),
    ("held", "held_twice", "segments", {"segments": bytes(24)}),
    ("gathered", "member_twice", "ready", {"ready": _ID(3) + _ID(3)}),
    ("plan0", "load_cut", "load", {**_SUMS, "load": _packed_row()[:-1]}),
    ("plan0", "load_twice", "load", {**_SUMS, "load": _packed_row() * 2}),
    ("plan0", "load_length_zero", "load.length", {**_SUMS, "load": _packed_row(1, 0)}),
    (
        "plan0",
        "load_length_too_large",
        "load.length",
        {**_SUMS, "load": _packed_row(1, MAX_SEGMENT_BYTES + 1)},
    ),
    (
        "plan0",
        "box_inverted",
        "load.bounds",
        {**_SUMS, "load": _packed_row(1, 5, 0, 2, 0, 1, 1, 1)},
    ),
    (
        "plan0",
        "box_nan",
        "load.bounds",
        {**_SUMS, "load": _packed_row(1, 5, math.nan, 0, 0, 1, 1, 1)},
    ),
    (
        "plan0",
        "box_infinite",
        "load.bounds",
        {**_SUMS, "load": _packed_row(1, 5, 0, 0, 0, 1, math.inf, 1)},
    ),
    (
        "plan0",
        "box_too_far",
        "load.bounds",
        {**_SUMS, "load": _packed_row(1, 5, 0, 0, 0, 1, 1e8, 1)},
    ),
    ("plan0", "load_and_keep", "load", {**_SUMS, "load": _packed_row(), "keep": _ID(1)}),
    ("plan0", "keep_and_nearby", "nearby", {"keep": _ID(2), "nearby": _ID(2)}),
]
_NOT_FINITE: list[tuple[str, str, str, dict[str, Any]]] = [
    ("small", "radius_nan", "radius_m", {"radius_m": math.nan}),
    ("small", "radius_infinite", "radius_m", {"radius_m": math.inf}),
    ("small", "position_nan", "position", {"position": [0.0, math.nan, 0.0]}),
    ("small", "position_infinite", "position", {"position": [0.0, 0.0, -math.inf]}),
    ("hello", "release_factor_nan", "release_factor", {"release_factor": math.nan}),
    ("pick", "direction_nan", "direction", {"direction": [math.nan, 0.0, 1.0]}),
]


def _structure() -> Iterator[Case]:
    for feature, value in (
        ("top_level_array", [1, 2]),
        ("top_level_number", 5),
        ("top_level_text", "hello"),
        ("top_level_nil", None),
        ("no_type", {"generation": 1}),
        ("type_number", {"type": 5}),
        ("type_nil", {"type": None}),
    ):
        yield bad(C2S, feature, pack(value), MALFORMED)
    bye = pack({"type": "bye"})
    yield bad(C2S, "empty", b"", MALFORMED)
    yield bad(C2S, "two_messages", bye + bye, MALFORMED)
    deep: Any = 1
    for _ in range(16):
        deep = [deep]
    yield bad(C2S, "too_deep", pack({"type": "bye", "later": deep}), MALFORMED)
    inner = b"\x91" * 100_000 + b"\xc0"
    yield bad(C2S, "far_too_deep", b"\x82" + bye[1:] + b"\xa5later" + inner, MALFORMED)


def _oversized() -> Iterator[Case]:
    for direction, limit, data in (
        (C2S, MAX_CLIENT_MESSAGE_BYTES, pack({"type": "bye"})),
        (S2C, MAX_SERVER_MESSAGE_BYTES, pack({"type": "wave"})),
    ):
        name = f"oversized_{direction.value}"
        yield bad(direction, name, data, TOO_LARGE, pad_to=limit + 1, pad_byte=32)


# Beside them: the map, the key and text of its type, the key and array around them.
_NILS = MAX_CLIENT_VALUES + 1 - 5


def _msgpack_bytes() -> Iterator[Case]:
    """Bytes that promise more than they hold, and bytes that no message uses."""
    start = b"\x82\xa4type\xa3bye\xa5later"
    for feature, data in (
        ("bomb_array32", start + b"\xdd\xff\xff\xff\xff"),
        ("bomb_map32", start + b"\xdf\xff\xff\xff\xff"),
        ("bomb_bin32", start + b"\xc6\xff\xff\xff\xff"),
        ("bomb_str32", start + b"\xdb\xff\xff\xff\xff"),
        ("bomb_top_level_map", b"\xdf\xff\xff\xff\xff\xa4type"),
        ("bomb_nested_arrays", start + b"\xdd\x00\x00\x40\x00" * 15),
        ("too_many_items", start + b"\xdc\x40\x01" + b"\xc0" * 16_385),
        ("too_many_values", start + b"\xdc" + struct.pack(">H", _NILS) + b"\xc0" * _NILS),
        ("extension", start + b"\xd4\x01\x00"),
        ("extension8", start + b"\xc7\x01\x05\x00"),
        ("timestamp", start + b"\xd6\xff\x00\x00\x00\x00"),
        ("unused_token", start + b"\xc1"),
        ("text_not_utf8", start + b"\xa2\xff\xfe"),
        ("text_surrogate", start + b"\xa3\xed\xa0\x80"),
        ("key_number", b"\x82\xa4type\xa3bye\x05\xc0"),
        ("key_binary", b"\x82\xa4type\xa3bye\xc4\x01a\xc0"),
        ("key_array", b"\x82\xa4type\xa3bye\x90\xc0"),
        ("key_map", b"\x82\xa4type\xa3bye\x80\xc0"),
        ("bytes_after", msgpack.packb({"type": "bye"}) + b"\xc0"),
        ("length_cut", start + b"\xda\x00"),
        ("integer_cut", start + b"\xcf\x00\x00"),
    ):
        yield bad(C2S, feature, data, MALFORMED)


def _frames() -> Iterator[Case]:
    whole = encode_frame(PayloadFrame(1, 2, 0, 9, memoryview(b"terraport")))

    def changed(offset: int, *values: int) -> bytes:
        return whole[:offset] + bytes(values) + whole[offset + len(values) :]

    for feature, data in (
        ("empty", b""),
        ("kind_zero", changed(0, 0)),
        ("kind_80", changed(0, 0x80)),
        ("kind_ff", b"\xff"),
        *((f"header_cut_{length:02d}", whole[:length]) for length in (1, 2, 4, 8, 12, 16, 20, 23)),
        ("no_chunk", whole[:24]),
        ("no_chunk_not_last", changed(1, 0)[:24]),
        ("chunk_cut", whole[:-1]),
        ("header_too_short", changed(2, 23, 0)),
        ("header_zero", changed(2, 0, 0)),
        ("header_beyond_frame", changed(2, 34, 0)),
        ("header_to_the_end", changed(2, 33, 0)),
        ("header_too_long", changed(2, 1, 4)),
        ("chunk_beyond_total", changed(16, 8)),
        ("chunk_beyond_total_not_last", whole[:1] + b"\0" + changed(16, 8)[2:]),
        ("offset_beyond_total", changed(12, 1)),
        ("offset_overflows", changed(12, 0xFF, 0xFF, 0xFF, 0xFF)),
        ("total_zero", changed(16, 0)),
        ("last_not_marked", changed(1, 0)),
        ("last_marked_early", changed(16, 10)),
    ):
        yield frame(feature, data, {"error": MALFORMED})
    huge = changed(16, *struct.pack("<I", MAX_SEGMENT_BYTES + 1))
    yield frame("total_too_large", huge, {"error": TOO_LARGE})
    error = {"error": TOO_LARGE, "pad_to": MAX_FRAME_BYTES + 1, "pad_byte": 0}
    yield frame("oversized", whole, error)
