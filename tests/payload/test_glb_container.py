from __future__ import annotations

import struct

import pytest

from terraport_payload import PayloadError
from terraport_payload.glb_container import MAX_JSON_BYTES, join_glb, split_glb

LITERAL = bytes.fromhex(
    "676c5446 02000000 28000000"  # glTF, 2, 40 bytes
    "08000000 4a534f4e 7b2261223a317d20"  # JSON chunk: {"a":1} and a space
    "04000000 42494e00 07000000"  # BIN chunk: 7 and padding
)


def test_literal_bytes_both_ways() -> None:
    assert join_glb({"a": 1}, b"\x07") == LITERAL
    document, binary, offset = split_glb(LITERAL)
    assert document == {"a": 1}
    assert bytes(binary) == b"\x07\0\0\0"
    assert LITERAL[offset:] == bytes(binary)


def test_every_truncation_and_extra_bytes_fail() -> None:
    for size in range(len(LITERAL)):
        with pytest.raises(PayloadError):
            split_glb(LITERAL[:size])
    with pytest.raises(PayloadError, match="44 bytes, expected 40 by the header"):
        split_glb(LITERAL + bytes(4))


def raw(text: bytes, *, version: int = 2, kind: bytes = b"JSON") -> bytes:
    body = struct.pack("<I4s", len(text), kind) + text + struct.pack("<I4s", 0, b"BIN\0")
    return struct.pack("<4sII", b"glTF", version, 12 + len(body)) + body


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\3\4" + LITERAL[4:], r"magic b'PK\\x03\\x04', expected b'glTF' \(payload offset 0\)"),
        (raw(b"{}", version=1), "glTF version 1, expected 2"),
        (raw(b"{}", kind=b"TEXT"), "chunk type b'TEXT', expected b'JSON'"),
        (raw(b"[]"), "JSON chunk is a list, expected an object"),
        (raw(b"{"), "JSON chunk does not parse"),
        (raw(b"\xff\xfe\x00\x01"), "JSON chunk does not parse"),
        (raw(b'{"a":NaN}'), "constant NaN, expected a finite number"),
        (raw(b'{"a":' + b"9" * 5000 + b"}"), "JSON chunk does not parse"),
        (raw(b"[" * 100_000), "JSON chunk does not parse"),
        (raw(b" " * (MAX_JSON_BYTES + 1)), "expected at most 1048576"),
        (LITERAL[:12] + b"\xff\xff\xff\x7f" + LITERAL[16:], "chunk of 2147483647 bytes"),
        (LITERAL[:32] + b"X" + LITERAL[33:], "expected b'BIN"),
        (LITERAL[:28] + b"\0" + LITERAL[29:], "4 bytes after the BIN chunk, expected none"),
    ],
)
def test_hostile_containers(data: bytes, message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        split_glb(data)
