"""Payload frames: one chunk of one segment in one binary WebSocket message.

::

    byte  0       1       2       4            8          12         16         20         24
          +-------+-------+-------+------------+----------+----------+----------+----------+------
          | kind  | flags | header| generation | segment  | offset   | total    | reserved | chunk
          | u8    | u8    | u16   | u32        | u32      | u32      | u32      | u32 = 0  | bytes
          +-------+-------+-------+------------+----------+----------+----------+----------+------

All little-endian.  ``header`` is the header's own length, 24 in this version; a receiver skips to
it, so later versions may add fields.  Kinds are below 0x80, so the first byte tells a frame from a
msgpack message.
"""

from __future__ import annotations

import dataclasses
import struct

from .errors import InvalidMessageError, MalformedError, TooLargeError
from .limits import (
    HEADER_BYTES,
    MAX_CHUNK_BYTES,
    MAX_FRAME_BYTES,
    MAX_HEADER_BYTES,
    MAX_SEGMENT_BYTES,
)

__all__ = [
    "FLAG_LAST",
    "KIND_SEGMENT_CHUNK",
    "PayloadFrame",
    "UnknownFrame",
    "decode_frame",
    "encode_frame",
    "frame_header",
]

KIND_SEGMENT_CHUNK = 0x01
"""The one kind of version 1. 0x00 is never used; 0x02..0x7F are reserved for later versions."""

FLAG_LAST = 0x01
"""The chunk ends the segment: offset + chunk length = total. Other flags are reserved."""

_HEADER = struct.Struct("<BBHIIIII")
_U32 = 2**32 - 1


@dataclasses.dataclass(frozen=True, slots=True)
class PayloadFrame:
    """One chunk of a segment's payload.

    Attributes
    ----------
    generation : int
        Generation of the plan or prefetch that it is sent for.
    segment : int
        Segment id.
    offset : int
        Place of the chunk in the segment's payload, in bytes.
    total : int
        Length of the whole payload, in bytes.
    chunk : memoryview
        The bytes; a view of the received message, not a copy.
    """

    generation: int
    segment: int
    offset: int
    total: int
    chunk: memoryview

    @property
    def last(self) -> bool:
        """True if the chunk ends the segment."""
        return self.offset + len(self.chunk) == self.total


@dataclasses.dataclass(frozen=True, slots=True)
class UnknownFrame:
    """A frame of a kind that this version does not know: skip it."""

    kind: int


def frame_header(*, generation: int, segment: int, offset: int, total: int, length: int) -> bytes:
    """Return the 24-byte header of a frame whose chunk has `length` bytes.

    The sender writes it before the chunk, so that a chunk is sent from a mapped file uncopied.

    Raises
    ------
    InvalidMessageError
        If a number is out of range or the chunk lies outside the segment.
    """
    # One comparison for all, because it is made for every chunk.
    if not (
        0 <= generation <= _U32
        and 0 <= segment <= _U32
        and 0 < length <= MAX_CHUNK_BYTES
        and 0 <= offset <= total - length
        and total <= MAX_SEGMENT_BYTES
    ):
        raise _header_error(generation, segment, offset, total, length)
    flags = FLAG_LAST if offset + length == total else 0
    return _HEADER.pack(
        KIND_SEGMENT_CHUNK, flags, HEADER_BYTES, generation, segment, offset, total, 0
    )


def _header_error(
    generation: int, segment: int, offset: int, total: int, length: int
) -> InvalidMessageError:
    for name, value in (("generation", generation), ("segment", segment)):
        if not 0 <= value <= _U32:
            return InvalidMessageError("frame", name, f"got {value}, expected 0 to {_U32}")
    if not 1 <= total <= MAX_SEGMENT_BYTES:
        return InvalidMessageError(
            "frame", "total", f"got {total}, expected 1 to {MAX_SEGMENT_BYTES}"
        )
    if not 1 <= length <= MAX_CHUNK_BYTES:
        return InvalidMessageError(
            "frame", "length", f"got {length}, expected 1 to {MAX_CHUNK_BYTES}"
        )
    text = f"got {offset} with {length} bytes, expected to end within {total}"
    return InvalidMessageError("frame", "offset", text)


def encode_frame(frame: PayloadFrame) -> bytes:
    """Return a frame as one byte string (header and a copy of the chunk)."""
    header = frame_header(
        generation=frame.generation,
        segment=frame.segment,
        offset=frame.offset,
        total=frame.total,
        length=len(frame.chunk),
    )
    return header + bytes(frame.chunk)


def decode_frame(data: bytes | bytearray | memoryview) -> PayloadFrame | UnknownFrame:
    """Return the frame that one binary WebSocket message holds.

    Raises
    ------
    MalformedError
        If it is cut off, its header or chunk contradict each other, or it is no frame.
    TooLargeError
        If it is longer than `MAX_FRAME_BYTES`, or announces a segment beyond `MAX_SEGMENT_BYTES`.
    """
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    if len(view) > MAX_FRAME_BYTES:
        raise TooLargeError(f"got a frame of {len(view)} bytes, expected at most {MAX_FRAME_BYTES}")
    if len(view) == 0:
        raise MalformedError("got an empty message, expected a frame", offset=0)
    if view[0] == 0 or view[0] >= 0x80:
        raise MalformedError(f"got frame kind 0x{view[0]:02x}, expected 0x01 to 0x7f", offset=0)
    if view[0] != KIND_SEGMENT_CHUNK:
        return UnknownFrame(view[0])
    if len(view) < HEADER_BYTES:
        text = f"got {len(view)} bytes, expected a header of {HEADER_BYTES}"
        raise MalformedError(text, offset=len(view))
    _, flags, header_bytes, generation, segment, offset, total, _ = _HEADER.unpack_from(view)
    if not HEADER_BYTES <= header_bytes <= MAX_HEADER_BYTES:
        text = f"got a header of {header_bytes}, expected {HEADER_BYTES} to {MAX_HEADER_BYTES}"
        raise MalformedError(text, offset=2)
    if total > MAX_SEGMENT_BYTES:
        text = f"got a segment of {total} bytes, expected at most {MAX_SEGMENT_BYTES}"
        raise TooLargeError(text, offset=16)
    chunk = view[header_bytes:].toreadonly()
    if len(chunk) == 0:
        raise MalformedError("got no payload bytes, expected at least one", offset=len(view))
    if offset + len(chunk) > total:
        text = f"got {len(chunk)} bytes at {offset}, expected to end within {total}"
        raise MalformedError(text, offset=12)
    frame = PayloadFrame(generation, segment, offset, total, chunk)
    if bool(flags & FLAG_LAST) != frame.last:
        text = f"got last = {bool(flags & FLAG_LAST)}, expected {frame.last} by offset and total"
        raise MalformedError(text, offset=1)
    return frame
