"""Payload frames: one piece of one segment in one binary WebSocket message.

::

    0      1       2         4            8         16       20      24
    +------+-------+---------+------------+---------+--------+-------+----------
    | 0x01 | 0     | 24 u16  | generation | key u64 | offset | total | bytes ...
    +------+-------+---------+------------+---------+--------+-------+----------

All little-endian, counts u32. The third field is the header's own length: a receiver skips to it,
so later versions may add fields. Kinds are below 0x80, so the first byte tells a frame from a
msgpack message.
"""

from __future__ import annotations

import dataclasses
import struct
from typing import Final

from .errors import MalformedError, TooLargeError
from .limits import FRAME_HEADER_BYTES, MAX_FRAME_BYTES, MAX_HEADER_BYTES, MAX_SEGMENT_BYTES

__all__ = ["Frame", "decode_frame", "frame_header"]

_KIND: Final = 0x01
_HEADER: Final = struct.Struct("<BxHIQII")


@dataclasses.dataclass(frozen=True, slots=True)
class Frame:
    """A piece of one segment's payload."""

    generation: int
    key: int
    offset: int
    total: int
    """Bytes of the whole payload."""
    data: memoryview
    """A view of the received message."""


def frame_header(*, generation: int, key: int, offset: int, total: int) -> bytes:
    """Return the 24 bytes before a piece of payload."""
    return _HEADER.pack(_KIND, FRAME_HEADER_BYTES, generation, key, offset, total)


def decode_frame(data: bytes | bytearray | memoryview) -> Frame | None:
    """Return the frame in one WebSocket message; None for a kind that is to be skipped.

    Raises
    ------
    MalformedError
        If it is cut off or contradicts itself.
    TooLargeError
        If it is longer than `MAX_FRAME_BYTES`, or of a segment beyond `MAX_SEGMENT_BYTES`.
    """
    view = memoryview(data).toreadonly()
    if len(view) > MAX_FRAME_BYTES:
        raise TooLargeError(f"got a frame of {len(view)} bytes, expected at most {MAX_FRAME_BYTES}")
    if not view or not 0 < view[0] < 0x80:
        raise MalformedError(
            f"got {bytes(view[:1]).hex() or 'nothing'}, expected a frame", offset=0
        )
    if view[0] != _KIND:
        return None
    if len(view) < FRAME_HEADER_BYTES:
        text = f"got {len(view)} bytes, expected a header of {FRAME_HEADER_BYTES}"
        raise MalformedError(text, offset=len(view))
    _, header_bytes, generation, key, offset, total = _HEADER.unpack_from(view)
    if total > MAX_SEGMENT_BYTES:
        text = f"got a segment of {total} bytes, expected at most {MAX_SEGMENT_BYTES}"
        raise TooLargeError(text, offset=20)
    if not FRAME_HEADER_BYTES <= header_bytes <= MAX_HEADER_BYTES:
        expected = f"expected {FRAME_HEADER_BYTES} to {MAX_HEADER_BYTES}"
        raise MalformedError(f"got a header of {header_bytes}, {expected}", offset=2)
    payload = view[header_bytes:]
    if not 0 < len(payload) <= total - offset:
        text = f"got {len(payload)} bytes at {offset}, expected some within {total}"
        raise MalformedError(text, offset=16)
    return Frame(generation, key, offset, total, payload)
