"""GLB's outer form: header, JSON chunk, BIN chunk (glTF 2.0 specification, section 4.4).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Final, NoReturn

import orjson

from terraport_payload.errors import PayloadError

__all__ = ["MAX_JSON_BYTES", "join_glb", "split_glb"]

MAX_JSON_BYTES: Final = 1 << 20
"""Bounds the parser's work on hostile input; our own documents have 2-4 KiB."""

_HEADER: Final = struct.Struct("<4sII")
_CHUNK: Final = struct.Struct("<I4s")


def join_glb(document: dict[str, Any], binary: bytes) -> bytes:
    """Write a GLB.

    Parameters
    ----------
    document : dict
        The glTF document; keys are written in insertion order, so same input gives same bytes.
    binary : bytes
        Contents of the BIN chunk.

    Returns
    -------
    bytes
        Both chunks padded to 4 bytes, JSON by spaces and BIN by zeros, as glTF asks.
    """
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode("ascii")
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    total = _HEADER.size + 2 * _CHUNK.size + len(text) + len(binary)
    return b"".join(
        (
            _HEADER.pack(b"glTF", 2, total),
            _CHUNK.pack(len(text), b"JSON"),
            text,
            _CHUNK.pack(len(binary), b"BIN\0"),
            binary,
        )
    )


def split_glb(data: bytes | memoryview) -> tuple[dict[str, Any], memoryview, int]:
    """Read a GLB's two chunks; safe on hostile bytes.

    Parameters
    ----------
    data : bytes or memoryview
        The whole GLB.

    Returns
    -------
    document : dict
        The parsed JSON chunk; nothing inside it is checked yet.
    binary : memoryview
        The BIN chunk, a view of *data*.
    offset : int
        Where the BIN chunk's contents start in *data*, bytes.

    Raises
    ------
    PayloadError
        With the offset: wrong magic, version or length, a chunk of another type or beyond the end,
        JSON that does not parse to an object, is larger than 1 MiB, or holds NaN or Infinity.
    """
    view = memoryview(data).cast("B")
    size = len(view)
    if size < _HEADER.size + _CHUNK.size:
        raise PayloadError(
            f"{size} bytes, expected a GLB of at least {_HEADER.size + _CHUNK.size}", offset=0
        )
    magic, version, length = _HEADER.unpack_from(view)
    if magic != b"glTF":
        raise PayloadError(f"magic {magic!r}, expected b'glTF'", offset=0)
    if version != 2:
        raise PayloadError(f"glTF version {version}, expected 2", offset=4)
    if length != size:
        raise PayloadError(f"{size} bytes, expected {length} by the header", offset=8)
    text, after = _chunk(view, _HEADER.size, b"JSON")
    if len(text) > MAX_JSON_BYTES:
        raise PayloadError(
            f"JSON chunk of {len(text)} bytes, expected at most {MAX_JSON_BYTES}", offset=12
        )
    binary, end = _chunk(view, after, b"BIN\0")
    if end != size:
        raise PayloadError(f"{size - end} bytes after the BIN chunk, expected none", offset=end)
    try:
        document = _parse_json(bytes(text))
    except (ValueError, RecursionError) as error:
        raise PayloadError(
            f"JSON chunk does not parse: {error}", offset=_HEADER.size + _CHUNK.size
        ) from None
    if not isinstance(document, dict):
        raise PayloadError(
            f"JSON chunk is a {type(document).__name__}, expected an object",
            offset=_HEADER.size + _CHUNK.size,
        )
    return document, binary, after + _CHUNK.size


def _chunk(view: memoryview, at: int, kind: bytes) -> tuple[memoryview, int]:
    if len(view) - at < _CHUNK.size:
        raise PayloadError(f"{len(view) - at} bytes left, expected a {kind!r} chunk", offset=at)
    length, chunk_type = _CHUNK.unpack_from(view, at)
    if chunk_type != kind:
        raise PayloadError(f"chunk type {chunk_type!r}, expected {kind!r}", offset=at + 4)
    start = at + _CHUNK.size
    if length > len(view) - start:
        raise PayloadError(f"chunk of {length} bytes, {len(view) - start} left", offset=at)
    return view[start : start + length], start + length


def _parse_json(text: bytes) -> Any:
    """Parse a JSON chunk: by orjson, a third of the time; what it refuses, the json module judges.

    So what is taken, and the words for what is not, are the json module's.
    """
    try:
        return orjson.loads(text)
    except orjson.JSONDecodeError:
        return json.loads(text, parse_constant=_refuse_constant)


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"constant {text}, expected a finite number")
