"""The shape of a corpus file, and how Python makes and reads one."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgpack

from terraport_wire import (
    DecodeError,
    Direction,
    FieldError,
    Message,
    PayloadFrame,
    Unknown,
    decode,
    decode_frame,
    encode,
)
from terraport_wire.frames import UnknownFrame

from .wire_samples import readable

C2S = Direction.CLIENT_TO_SERVER
S2C = Direction.SERVER_TO_CLIENT


@dataclasses.dataclass(frozen=True)
class Case:
    """One pair of files: `data` in NAME.bin, `facts` in NAME.json (see the spec, section 15)."""

    name: str
    data: bytes
    facts: dict[str, Any]


def pack(value: Any) -> bytes:
    """Return a plain value as msgpack, whatever it is."""
    return msgpack.packb(value, use_bin_type=True)


def good(message: Message, feature: str, data: bytes | None = None) -> Case:
    """Return a good case; without `data` the canonical bytes of the message."""
    canonical = encode(message)
    facts = {
        "kind": "message",
        "direction": message.DIRECTION.value,
        "features": [feature],
        "message": readable(message),
    }
    if data is None or data == canonical:
        facts["canonical"] = True
    return Case(f"message-{message.TYPE}-{feature}", data or canonical, facts)


def unknown(direction: Direction, feature: str, type_name: str, data: bytes) -> Case:
    """Return a good case that is to be skipped."""
    facts = {
        "kind": "message",
        "direction": direction.value,
        "features": [feature],
        "unknown": type_name,
    }
    return Case(f"message-unknown-{feature}", data, facts)


def frame(feature: str, data: bytes, facts: dict[str, Any]) -> Case:
    """Return a payload frame's case; `facts` holds "frame" or "error"."""
    head = {"kind": "frame", "direction": S2C.value, "features": [feature]}
    return Case(f"frame-{feature}", data, {**head, **facts})


def bad(
    direction: Direction, feature: str, data: bytes, error: dict[str, Any], **more: int
) -> Case:
    """Return a case that is to be refused with `error`."""
    facts = {
        "kind": "message",
        "direction": direction.value,
        "features": [feature],
        "error": error,
        **more,
    }
    return Case(f"message-{feature}", data, facts)


def observe(data: bytes, facts: dict[str, Any]) -> dict[str, Any]:
    """Decode a case as this package does, and say what came out in the corpus's terms."""
    data = data + bytes([facts.get("pad_byte", 0)]) * (facts.get("pad_to", 0) - len(data))
    try:
        if facts["kind"] == "frame":
            return {"frame": _frame_facts(decode_frame(data))}
        message = decode(data, Direction(facts["direction"]))
    except DecodeError as error:
        return {"error": _error_facts(error)}
    if isinstance(message, Unknown):
        return {"unknown": message.type}
    observed: dict[str, Any] = {"message": readable(message)}
    if encode(message) == data:
        observed["canonical"] = True
    return observed


def _frame_facts(frame: PayloadFrame | UnknownFrame) -> dict[str, Any]:
    if isinstance(frame, UnknownFrame):
        return {"unknown_kind": frame.kind}
    return {
        "generation": frame.generation,
        "segment": frame.segment,
        "offset": frame.offset,
        "total": frame.total,
        "last": frame.last,
        "chunk_hex": frame.chunk.hex(),
    }


def _error_facts(error: DecodeError) -> dict[str, Any]:
    facts: dict[str, Any] = {"code": error.code.value, "fatal": error.fatal}
    if isinstance(error, FieldError):
        facts["field"] = error.field
        for name in ("generation", "request"):
            if getattr(error, name) is not None:
                facts[name] = getattr(error, name)
    return facts
