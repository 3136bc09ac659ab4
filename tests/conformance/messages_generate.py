"""Writes the messages corpus: ``python tests/conformance/messages_generate.py [--check]``.

The cases are the same on every run. The README in the folder says what a line holds.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgpack

__all__ = ["CORPUS", "corpus"]

CORPUS: Final = Path(__file__).with_name("messages")

Fields = dict[str, Any]
Line = dict[str, Any]

MAX_CLIENT_BYTES: Final = 1 << 20
MAX_FRAME_BYTES: Final = 128 << 10
MAX_SEGMENT_BYTES: Final = 64 << 20

KEYS: Final = struct.pack("<3Q", 1, 0x0123456789ABCDEF, 2**64 - 1)
ROW: Final = struct.Struct("<Q5I")
SHOW: Final = ROW.pack(0x0123456789ABCDEF, 7, 1000, 2000, 1100, 1) + ROW.pack(
    2**64 - 1, 4_294_967_295, 67_108_864, 20_000, 65_535, 3
)
HIDDEN: Final = gzip.compress(bytes([0b00000101, 0xFF]), mtime=0)
SCENE: Final = {
    "id": "quarry", "name": "Steinbruch Süd 石", "version": "00c0ffee1234",
    "segment_count": 9, "base_faces": 16, "levels": 2,
}  # fmt: skip
LIMITS: Final = {
    "max_radius_m": 500.0, "max_message_bytes": 1_048_576, "max_messages_per_s": 60.0,
    "max_credit_bytes": 67_108_864, "idle_timeout_s": 60.0, "groups": "query",
}  # fmt: skip
HIT: Final = {
    "position": [1.0, 2.5, 3.0], "normal": [0.0, 1.0, 0.0], "height_m": 412.5, "segment": 7,
    "region": 3, "stable_id": 4_294_967_295, "label": "haul road",
    "attributes": {"grade": 1.25, "_NAME 2": -0.5},
}  # fmt: skip
FAR: Final = [12.5, -3.0, 1e-300]
NAME: Final = "Größe ✓ 𝄞"

# Of each message the required fields alone, and those that may be absent.
CLIENT: Final[dict[str, tuple[Fields, Fields]]] = {
    "hello": (
        {"client": "", "budgets": {}, "credit_bytes": 0},
        {
            "client": f"terraport-python/0.1.0 ({NAME})",
            "token": "eyJhbGciOiJIUzI1NiJ9.e30.abc-_",
            "budgets": {
                "max_triangles": 2_000_000, "max_bytes": 40_000_000, "max_segments": 500,
                "max_gpu_bytes": 268_435_456, "gpu_vertex_bytes": 28, "gpu_face_bytes": 12,
            },
            "credit_bytes": 9_007_199_254_740_991,
        },
    ),
    "land": (
        {"generation": 0, "position": [0.0, 0.0, 0.0], "radius_m": 0.5, "have": b"",
         "taken_bytes": 0},
        {"generation": 4_294_967_295, "position": FAR, "radius_m": 60.0, "coarse_radius_m": 180.0,
         "inner_radius_m": 20.0, "have": KEYS, "without": KEYS[8:16], "taken_bytes": 8_388_608},
    ),
    "prefetch": (
        {"generation": 0, "position": [0.0, 0.0, 0.0], "radius_m": 0.5, "have": b"",
         "taken_bytes": 0},
        {"generation": 4_294_967_295, "position": [1e7, -1e7, 0.1], "radius_m": 60.0,
         "coarse_radius_m": 60.0, "have": KEYS, "without": b"", "taken_bytes": 1},
    ),
    "credit": ({"bytes": 1}, {"bytes": 9_007_199_254_740_991}),
    "pick": (
        {"request": 0, "origin": [0.0, 0.0, 0.0]},
        {"request": 4_294_967_295, "origin": [1.0, 2.0, 3.0], "direction": [0.0, -1e7, 0.5]},
    ),
    "bye": ({}, {}),
    "join": (
        {"request": 0, "group": "a", "role": "member"},
        {"request": 4_294_967_295, "group": "Tour-2.a~b_", "role": "guide", "name": NAME,
         "seat": "q9XwT0bW3mZk5cV7nR1uYg"},
    ),
    "leave": ({}, {}),
    "gather": (
        {"request": 0, "position": [0.0, 0.0, 0.0], "radius_m": 60.0},
        {"request": 7, "position": FAR, "radius_m": 60.0, "inner_radius_m": 20.0,
         "deadline_ms": 30_000},
    ),
    "arrived": (
        {"gathering": 1, "state": "ready"}, {"gathering": 4_294_967_295, "state": "degraded"},
    ),
}  # fmt: skip
SERVER: Final[dict[str, tuple[Fields, Fields]]] = {
    "welcome": (
        {"server": "", "session": "", "scene": SCENE, "limits": LIMITS},
        {"server": "terraport/0.1.0", "session": "9f3a", "scene": SCENE, "limits": LIMITS},
    ),
    "plan": (
        {"generation": 0, "show": b"", "hidden": gzip.compress(bytes(2), mtime=0),
         "effective_radius_m": 60.0, "omitted": 0},
        {"generation": 77, "show": SHOW, "hidden": HIDDEN, "inner_count": 1,
         "inner_hidden": gzip.compress(b"\1\0", mtime=0), "effective_radius_m": 41.25,
         "omitted": 12, "omitted_by": "max_triangles", "pack": "segments.pack",
         "offsets": struct.pack("<2Q", 0, 274_877_906_880)},
    ),
    "ready": (
        {"generation": 0},
        {"generation": 77, "missing": KEYS[8:], "hidden": HIDDEN},
    ),
    "picked": ({"request": 0}, {"request": 4_294_967_295, "hit": HIT}),
    "notice": (
        {"kind": "draining"},
        {"kind": "scene_published", "version": "beef", "reconnect_after_ms": 250},
    ),
    "error": (
        {"code": "internal", "message": "", "fatal": True},
        {"code": "a_code_of_tomorrow", "message": "got 5, expected 4", "fatal": False,
         "generation": 4_294_967_295, "request": 0},
    ),
    "joined": (
        {"request": 0, "group": "a", "member": 1, "role": "guide", "seat": "s"},
        {"request": 4_294_967_295, "group": "Tour-2.a~b_", "member": 3, "role": "member",
         "seat": "q9XwT0bW3mZk5cV7nR1uYg"},
    ),
    "roster": (
        {"group": "a", "members": []},
        {"group": "Tour-2.a~b_", "members": [
            {"member": 1, "name": NAME, "role": "guide", "present": True},
            {"member": 3, "role": "member", "present": False, "position": FAR},
        ]},
    ),
    "gathering": (
        {"gathering": 1, "guide": 1, "position": [0.0, 0.0, 0.0], "radius_m": 60.0},
        {"gathering": 4_294_967_295, "guide": 1, "position": FAR, "radius_m": 60.0,
         "inner_radius_m": 20.0, "left_ms": 29_000},
    ),
    "gathered": (
        {"gathering": 1, "ready": b"", "degraded": b"", "missing": b""},
        {"gathering": 2, "ready": struct.pack("<2I", 1, 4), "degraded": struct.pack("<I", 3),
         "missing": struct.pack("<2I", 2, 4_294_967_295)},
    ),
}  # fmt: skip
STRANGE: Final = {"a": [1, -1, 2.5, None, True, "ü", b"\xff", {"b": [[]]}], "": {}}
"""A value of every shape, as a later version might send in a field that is not known."""
REFUSED_ALONE: Final = ("land", "prefetch", "pick", "join", "gather")
USED: Final = {
    "welcome": ("scene", "limits"),
    "plan": ("generation", "show", "hidden", "effective_radius_m", "omitted"),
    "ready": ("generation",),
    "picked": ("request",),
    "notice": ("kind",),
    "error": ("code", "fatal"),
    "joined": ("member", "seat"),
    "roster": ("members",),
    "gathering": ("gathering", "position", "radius_m"),
    "gathered": ("gathering", "missing"),
}
"""Fields without which a client cannot go on; `welcome.server`, say, is for logs."""


def corpus() -> dict[str, list[Line]]:
    """Return the lines of each file by its name."""
    return {
        "good.jsonl": list(_good()),
        "bad_from_client.jsonl": list(_bad_from_client()),
        "bad_from_server.jsonl": list(_bad_from_server()),
        "frames.jsonl": list(_frames()),
    }


# ---- good messages


def _good() -> Iterator[Line]:
    for sender, messages in (("client", CLIENT), ("server", SERVER)):
        for name, (least, most) in messages.items():
            yield _taken(sender, name, "minimal", least)
            # All fields, the last first, between fields of a later version.
            backwards = {
                "later": STRANGE,
                **dict(reversed([("type", name), *most.items()])),
                "x": 1,
            }
            yield _taken(sender, name, "full, unknown fields", most, _pack(backwards))
            if absent := most.keys() - least.keys():
                nils = {"type": name, **least} | dict.fromkeys(sorted(absent))
                yield _taken(sender, name, "nil is absent", least, _pack(nils))
    yield from _good_formats()
    for sender, feature, fields in (
        ("client", "unknown", {"type": "wave", "later": STRANGE}),
        ("client", "other direction", {"type": "plan"}),
        ("client", "empty", {"type": ""}),
        ("server", "unknown", {"type": "wave"}),
        ("server", "other direction", {"type": "land"}),
    ):
        yield {"case": f"type: {feature}", "from": sender, "bytes": _b64(_pack(fields)),
               "skip": True}  # fmt: skip


def _good_formats() -> Iterator[Line]:
    """Wider formats than the shortest, which some writers use."""
    key = msgpack.packb
    start = key("type") + key("credit") + key("bytes")
    for feature, data in (
        ("uint16", b"\x82" + start + b"\xcd\x00\x05"),
        ("uint32", b"\x82" + start + b"\xce\x00\x00\x00\x05"),
        ("uint64", b"\x82" + start + b"\xcf" + bytes(7) + b"\x05"),
        ("int64", b"\x82" + start + b"\xd3" + bytes(7) + b"\x05"),
        ("map16", b"\xde\x00\x02" + start + b"\x05"),
        ("map32", b"\xdf\x00\x00\x00\x02" + start + b"\x05"),
        (
            "str8, str16, str32",
            b"\x82\xd9\x04type\xda\x00\x06credit\xdb\x00\x00\x00\x05bytes\x05",
        ),
    ):
        yield _taken("client", "credit", feature, {"bytes": 5}, data)
    ready = b"\x83" + key("type") + key("ready") + key("generation") + b"\x01" + key("missing")
    for feature, head in (("bin16", b"\xc5\x00\x08"), ("bin32", b"\xc6\x00\x00\x00\x08")):
        fields = {"generation": 1, "missing": KEYS[:8]}
        yield _taken("server", "ready", feature, fields, ready + head + KEYS[:8])
    pick = b"\x83" + key("type") + key("pick") + key("request") + b"\x00" + key("origin")
    for feature, array, origin in (
        ("integers as numbers", b"\x93\x0c\xfd\x00", [12, -3, 0]),
        ("float32, array16", b"\xdc\x00\x03" + (b"\xca" + struct.pack(">f", 0.5)) * 3, [0.5] * 3),
        ("array32", b"\xdd\x00\x00\x00\x03\x01\xd1\xff\x00\xd2\xff\xff\x00\x00", [1, -256, -65536]),
    ):
        fields = {"request": 0, "origin": origin}
        yield _taken("client", "pick", feature, fields, pick + array)
    deepest: Any = 1
    for _ in range(15):
        deepest = [deepest]
    for sender, name, fields in (
        ("client", "bye", {}),
        ("server", "notice", {"kind": "draining"}),
    ):
        data = _pack({"type": name, **fields, "later": deepest})
        yield _taken(sender, name, "16 levels", fields, data)
    nils = [None] * (1024 - 5)  # beside the map, type and its text, "later" and its array
    data = _pack({"type": "bye", "later": nils})
    yield _taken("client", "bye", "1,024 values", {}, data)


# ---- bad messages


def _bad_from_client() -> Iterator[Line]:
    for name, (least, most) in CLIENT.items():
        whole = _pack({"type": name, **most})
        yield _refused("client", f"{name}: cut", whole[:-1], "malformed")
        for field in ("have",) if name == "prefetch" else least:
            yield _bad_field(name, f"without {field}", field, _less(most, field))
    for name, feature, field, change in _BAD_FIELDS:
        yield _bad_field(name, feature, field, CLIENT[name][1] | change)
    fields = _less(CLIENT["land"][1], "have") | {"have": bytes(8 * 4097)}
    many = _bad_field("land", "have of 4,097 keys", "have", fields)
    data = base64.b64decode(many["bytes"])
    yield many | {"bytes": _b64(data.rstrip(b"\0")), "pad_to": len(data)}
    yield from _structure("client", {"type": "bye"})
    bye = _pack({"type": "bye"})
    deep: Any = 1
    for _ in range(16):
        deep = [deep]
    twice = b"\x83" + _pack({"type": "credit", "bytes": 1})[1:] + b"\xa5bytes\x02"
    for feature, data in (
        ("a key twice", twice),
        ("17 levels", _pack({"type": "bye", "later": deep})),
        ("1,025 values", _pack({"type": "bye", "later": [None] * (1025 - 5)})),
        ("text that is not UTF-8", b"\x82" + bye[1:] + b"\xa5later\xa2\xff\xfe"),
        ("text of surrogates", b"\x82" + bye[1:] + b"\xa5later\xa3\xed\xa0\x80"),
        ("a number as key", b"\x82" + bye[1:] + b"\x05\xc0"),
        ("a map as key", b"\x82" + bye[1:] + b"\x80\xc0"),
    ):
        yield _refused("client", f"structure: {feature}", data, "malformed")
    large = _refused("client", "structure: 1 MiB and a byte", bye, "too_large")
    yield large | {"pad_to": MAX_CLIENT_BYTES + 1}


def _bad_from_server() -> Iterator[Line]:
    for name, (_, most) in SERVER.items():
        whole = _pack({"type": name, **most})
        yield _refused("server", f"{name}: cut", whole[:-1])
        for field in USED[name]:
            data = _pack({"type": name, **_less(most, field)})
            yield _refused("server", f"{name}: without {field}", data)
    for name, feature, change in (
        ("welcome", "scene is text", {"scene": "quarry"}),
        ("welcome", "scene without version", {"scene": _less(SCENE, "version")}),
        ("welcome", "scene without faces", {"scene": _less(SCENE, "base_faces")}),
        ("welcome", "limits without credit", {"limits": _less(LIMITS, "max_credit_bytes")}),
        ("plan", "generation is text", {"generation": "77"}),
        ("plan", "show is cut", {"show": SHOW[:-1]}),
        ("plan", "show is a list", {"show": [1, 2]}),
        ("plan", "hidden is text", {"hidden": "none"}),
        ("plan", "effective_radius_m is not a number", {"effective_radius_m": math.nan}),
        ("ready", "missing is cut", {"missing": KEYS[:-1]}),
        ("picked", "hit is a list", {"hit": [1]}),
        ("picked", "position of two", {"hit": HIT | {"position": [1.0, 2.0]}}),
        ("error", "fatal is a number", {"fatal": 1}),
        ("gathered", "ready is cut", {"ready": b"\1\0\0"}),
        ("roster", "members is a map", {"members": {}}),
    ):  # fmt: skip
        data = _pack({"type": name, **SERVER[name][1], **change})
        yield _refused("server", f"{name}: {feature}", data)
    yield from _structure("server", {"type": "notice", "kind": "draining"})


_BAD_FIELDS: Final[list[tuple[str, str, str, Fields]]] = [
    ("hello", "client of 129 characters", "client", {"client": "x" * 129}),
    ("hello", "token of 4,097 characters", "token", {"token": "x" * 4097}),
    ("hello", "negative budget", "budgets.max_triangles", {"budgets": {"max_triangles": -1}}),
    ("hello", "budget with a fraction", "budgets.max_bytes", {"budgets": {"max_bytes": 1.5}}),
    ("hello", "face of 0 bytes", "budgets.gpu_face_bytes", {"budgets": {"gpu_face_bytes": 0}}),
    ("hello", "credit is true", "credit_bytes", {"credit_bytes": True}),
    ("land", "radius of 0", "radius_m", {"radius_m": 0}),
    ("land", "negative radius", "radius_m", {"radius_m": -1.0}),
    ("land", "radius is text", "radius_m", {"radius_m": "60"}),
    ("land", "radius is not a number", "radius_m", {"radius_m": math.nan}),
    ("land", "infinite radius", "radius_m", {"radius_m": math.inf}),
    ("land", "negative generation", "generation", {"generation": -1}),
    ("land", "generation of 33 bits", "generation", {"generation": 2**32}),
    ("land", "generation with a fraction", "generation", {"generation": 1.5}),
    ("land", "position of two", "position", {"position": [0.0, 0.0]}),
    ("land", "position is a map", "position", {"position": {"x": 0, "y": 0, "z": 0}}),
    ("land", "infinite position", "position", {"position": [0.0, 0.0, -math.inf]}),
    ("land", "position beyond 10^7 m", "position", {"position": [0.0, 1e7 + 1, 0.0]}),
    ("land", "inner beyond radius", "inner_radius_m", {"inner_radius_m": 60.5}),
    ("land", "coarse below radius", "coarse_radius_m", {"coarse_radius_m": 59.5}),
    ("land", "have is cut", "have", {"have": KEYS[:-1]}),
    ("land", "have is a list", "have", {"have": [1, 2]}),
    ("land", "without of 65 keys", "without", {"without": bytes(8 * 65)}),
    ("land", "negative taken_bytes", "taken_bytes", {"taken_bytes": -1}),
    ("prefetch", "coarse below radius", "coarse_radius_m", {"coarse_radius_m": 0.25}),
    ("prefetch", "have is text", "have", {"have": "abcdefgh"}),
    ("credit", "of 0", "bytes", {"bytes": 0}),
    ("credit", "beyond 2^53", "bytes", {"bytes": 2**53}),
    ("pick", "no direction", "direction", {"direction": [0, 0, 0]}),
    ("pick", "request of 33 bits", "request", {"request": 2**32}),
    ("join", "group without a name", "group", {"group": ""}),
    ("join", "group with a slash", "group", {"group": "../a"}),
    ("join", "group of 65 characters", "group", {"group": "x" * 65}),
    ("join", "unknown role", "role", {"role": "owner"}),
    ("gather", "radius of 0", "radius_m", {"radius_m": 0}),
    ("gather", "inner beyond radius", "inner_radius_m", {"inner_radius_m": 60.5}),
    ("gather", "deadline beyond 10 min", "deadline_ms", {"deadline_ms": 600_001}),
    ("arrived", "gathering of 0", "gathering", {"gathering": 0}),
    ("arrived", "unknown state", "state", {"state": "soon"}),
]  # fmt: skip


def _structure(sender: str, fields: Fields) -> Iterator[Line]:
    """Bytes that are no message, or that promise more than they hold."""
    whole = _pack(fields)
    start = bytes([whole[0] + 1]) + whole[1:] + b"\xa5later"
    code = "malformed" if sender == "client" else None
    deep = _refused(sender, "structure: 100,000 levels", start, code)
    yield deep | {"pad_to": len(start) + 100_000, "pad_byte": 0x91}
    for feature, data in (
        ("a list", _pack([1, 2])),
        ("nil", _pack(None)),
        ("no type", _pack({"generation": 1})),
        ("type is a number", _pack({"type": 5})),
        ("bytes after the message", whole + b"\xc0"),
        ("array of 2^32", start + b"\xdd\xff\xff\xff\xff"),
        ("map of 2^32", start + b"\xdf\xff\xff\xff\xff"),
        ("bin of 2^32", start + b"\xc6\xff\xff\xff\xff"),
        ("text of 2^32", start + b"\xdb\xff\xff\xff\xff"),
        ("nested arrays of 16,384", start + b"\xdd\x00\x00\x40\x00" * 15),
        ("extension type", start + b"\xd4\x01\x00"),
        ("unused token", start + b"\xc1"),
        ("integer is cut", start + b"\xcf\x00\x00"),
    ):
        yield _refused(sender, f"structure: {feature}", data, code)


# ---- frames


def _frames() -> Iterator[Line]:
    data = b"terraport"

    def frame(*numbers: int, header: int = 24, kind: int = 1, second: int = 0) -> bytes:
        head = struct.pack("<BBHIQII", kind, second, header, *numbers)
        return head + bytes(max(0, header - 24)) + data

    for feature, numbers in (
        ("whole", (1, 2, 0, 9)),
        ("first", (1, 2, 0, 100)),
        ("middle", (2**32 - 1, 2**64 - 1, 50, 100)),
        ("last", (7, 0x0123456789ABCDEF, MAX_SEGMENT_BYTES - 9, MAX_SEGMENT_BYTES)),
    ):
        yield _frame(feature, frame(*numbers), numbers, data)
    numbers = (1, 2, 0, 9)
    for feature, bytes_ in (
        ("header of 32", frame(*numbers, header=32)),
        ("header of 1,024", frame(*numbers, header=1024)),
        ("second byte is set", frame(*numbers, second=255)),
    ):
        yield _frame(feature, bytes_, numbers, data)
    for kind in (0x02, 0x7F):
        line = {"from": "server", "bytes": _b64(bytes([kind]) + b"whatever"), "skip": True}
        yield {"case": f"frame: unknown kind {kind}"} | line
    whole = frame(*numbers)
    for feature, bytes_ in (
        ("empty", b""),
        ("kind 0", b"\0" + whole[1:]),
        *((f"cut at {length}", whole[:length]) for length in (1, 2, 8, 16, 23)),
        ("no payload", whole[:24]),
        ("header of 23", frame(*numbers, header=23)),
        ("header of 0", frame(*numbers, header=0)),
        ("header of 1,025", frame(*numbers, header=1025)),
        ("header beyond the frame", whole[:2] + b"\x22\0" + whole[4:]),
        ("payload beyond total", frame(1, 2, 0, 8)),
        ("offset beyond total", frame(1, 2, 1, 9)),
        ("offset of 2^32 - 1", frame(1, 2, 2**32 - 1, 9)),
        ("total of 0", frame(1, 2, 0, 0)),
        ("total beyond 64 MiB", frame(1, 2, 0, MAX_SEGMENT_BYTES + 1)),
    ):
        yield _refused("server", f"frame: {feature}", bytes_)
    long = _refused("server", "frame: 128 KiB and a byte", frame(1, 2, 0, MAX_SEGMENT_BYTES))
    yield long | {"pad_to": MAX_FRAME_BYTES + 1}


# ---- lines


def _taken(sender: str, name: str, feature: str, fields: Fields, data: bytes | None = None) -> Line:
    message = {"type": name, **fields}
    return {
        "case": f"{name}: {feature}",
        "from": sender,
        "bytes": _b64(_pack(message) if data is None else data),
        "message": _plain(message),
    }


def _frame(feature: str, bytes_: bytes, numbers: tuple[int, ...], data: bytes) -> Line:
    generation, key, offset, total = numbers
    frame = {
        "generation": generation, "key": f"{key:016x}", "offset": offset, "total": total,
        "data": _b64(data),
    }  # fmt: skip
    return {"case": f"frame: {feature}", "from": "server", "bytes": _b64(bytes_), "frame": frame}


def _refused(sender: str, case: str, data: bytes, code: str | None = None) -> Line:
    reader = "server" if sender == "client" else "client"
    line: Line = {"case": case, "from": sender, "bytes": _b64(data), "refused_by": reader}
    if code is not None:
        line["error"] = {"code": code, "fatal": True}
    return line


def _bad_field(name: str, feature: str, field: str, fields: Fields) -> Line:
    line = _refused(
        "client", f"{name}: {feature}", _pack({"type": name, **fields}), "invalid_field"
    )
    line["error"] |= {"fatal": name not in REFUSED_ALONE, "field": field}
    for number in ("generation", "request"):
        value = fields.get(number)
        if type(value) is int and 0 <= value < 2**32:
            line["error"][number] = value
    return line


def _less(fields: Fields, name: str) -> Fields:
    return {each: value for each, value in fields.items() if each != name}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return _b64(value)
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list) else value


def _pack(value: Any) -> bytes:
    return msgpack.packb(value, use_bin_type=True)


def _b64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def main() -> int:
    """Write every file, or compare; return the exit code."""
    is_check, changed = "--check" in sys.argv[1:], 0
    for name, lines in corpus().items():
        texts = [json.dumps(line, ensure_ascii=False, separators=(",", ":")) for line in lines]
        text, path = "\n".join(texts) + "\n", CORPUS / name
        if is_check and path.read_text(encoding="utf-8") != text:
            sys.stderr.write(f"error: {path} is not what messages_generate.py writes\n")
            changed = 1
        elif not is_check:
            path.write_text(text, encoding="utf-8")
    return changed


if __name__ == "__main__":
    sys.exit(main())
