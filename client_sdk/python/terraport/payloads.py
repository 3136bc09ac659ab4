"""The form in which payloads come, and what decoding them needs.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from terraport.cache import SegmentFacts
from terraport.errors import ProtocolViolationError, TerraportError
from terraport_payload import AttributeScale, PayloadError, decode_segment

__all__ = ["ENCODING", "Scales", "facts_of_payload", "scales_of"]

ENCODING: Final = "segment-2"
"""Payload encoding requested in ``hello``, and file name extension of stored payloads."""

Scales = Mapping[str, AttributeScale] | TerraportError
"""Scales of a scene version's attributes, or the error of the request for them."""


def scales_of(manifest: Mapping[str, Any]) -> dict[str, AttributeScale]:
    """Return the scales of the attributes, in the manifest's order.

    Raises
    ------
    ProtocolViolationError
        The manifest's ``attributes`` are not as the format says.
    """
    try:
        return {
            str(row["name"]): AttributeScale(float(row["offset"]), float(row["step"]))
            for row in manifest.get("attributes", ())
        }
    except (KeyError, TypeError, ValueError, PayloadError) as error:
        raise ProtocolViolationError(f"manifest: wrong attributes ({error!r})") from None


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
        mesh = decode_segment(payload, scales=None)
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
