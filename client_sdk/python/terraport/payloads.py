"""Payload bytes to arrays: the one place that knows in which form payloads come.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

from terraport.cache import SegmentFacts
from terraport.errors import ProtocolViolationError
from terraport_payload import PayloadError, SegmentMesh, decode_glb

__all__ = ["ENCODING", "decode_payload", "facts_of_payload"]

ENCODING: Final = "glb"
"""What is asked for in ``hello``, and what files of payloads end in."""


def decode_payload(payload: bytes) -> SegmentMesh:
    """Decode one segment.

    Parameters
    ----------
    payload : bytes
        As received.

    Returns
    -------
    SegmentMesh
        Scene frame, metres.

    Raises
    ------
    PayloadError
        The bytes are no payload; says at which offset.
    """
    return decode_glb(payload)


def facts_of_payload(segment: int, payload: bytes, xxh3: int) -> SegmentFacts:
    """Read from a payload what a plan would have said of it.

    Needed for the one case where only the hash is known: a segment that the disk cache held and
    lost.

    Raises
    ------
    ProtocolViolationError
        The payload has the right hash and yet cannot be decoded.
    """
    try:
        mesh = decode_payload(payload)
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
