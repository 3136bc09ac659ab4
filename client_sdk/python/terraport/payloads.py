"""Payload bytes to arrays, by the name of their encoding.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from terraport.cache import SegmentFacts
from terraport.errors import ProtocolViolationError, UsageError
from terraport_payload import PayloadError, SegmentMesh, decode_arrays, decode_glb

__all__ = ["ENCODINGS", "decode_payload", "facts_of_payload"]

ENCODINGS: Final[Mapping[str, Callable[[bytes | memoryview], SegmentMesh]]] = {
    "glb": decode_glb,
    "arrays": decode_arrays,
}
"""Decoder by encoding name."""


def decode_payload(payload: bytes, encoding: str) -> SegmentMesh:
    """Decode one segment.

    Parameters
    ----------
    payload : bytes
        As received.
    encoding : {"glb", "arrays"}
        How it was encoded.

    Returns
    -------
    SegmentMesh
        Scene frame, metres.

    Raises
    ------
    PayloadError
        The bytes are not such a payload; says at which offset.
    UsageError
        No such encoding.
    """
    decode = ENCODINGS.get(encoding)
    if decode is None:
        raise UsageError(f"encoding is {encoding!r}, expected one of: {', '.join(ENCODINGS)}")
    return decode(payload)


def facts_of_payload(segment: int, payload: bytes, encoding: str, xxh3: int) -> SegmentFacts:
    """Read from a payload what a plan would have said of it.

    Needed for the one case where only the hash is known: a segment that the disk cache held and
    lost.

    Raises
    ------
    ProtocolViolationError
        The payload has the right hash and yet cannot be decoded.
    """
    try:
        mesh = decode_payload(payload, encoding)
    except PayloadError as error:
        raise ProtocolViolationError(f"segment {segment}: {error}") from error
    low, high = mesh.positions.min(axis=0).tolist(), mesh.positions.max(axis=0).tolist()
    return SegmentFacts(
        segment=segment,
        length=len(payload),
        xxh3=xxh3,
        faces=len(mesh.faces),
        vertices=len(mesh.positions),
        bounds=(*low, *high),
    )
