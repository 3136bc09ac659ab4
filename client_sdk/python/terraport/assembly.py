"""Chunks to payloads.

A segment comes in chunks, in order, without gap or overlap (wire protocol, section 4). A newer
landing may carry on where an older one stopped; what it does not need is forgotten by both sides
(section 6.5, rule 3).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Collection

from terraport.errors import ProtocolViolationError
from terraport_wire import PayloadFrame

__all__ = ["Assembler"]


class Assembler:
    """The parts of segments that are on their way. Not thread-safe.

    Memory is bounded by what the server may send: each part's length is checked against the plan's,
    and a new plan forgets the rest.
    """

    __slots__ = ("_chunks", "_received")

    def __init__(self) -> None:
        self._chunks: dict[int, list[memoryview]] = {}
        self._received: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self._chunks)

    def received(self, segment: int) -> int:
        """Bytes of one segment that are here already."""
        return self._received.get(segment, 0)

    def take(self, frame: PayloadFrame, length: int | None) -> bytes | None:
        """Take one chunk.

        Parameters
        ----------
        frame : PayloadFrame
            Its chunk is kept, not copied, until the segment is whole.
        length : int or None
            The payload's length by the load table; None when only its hash is known.

        Returns
        -------
        bytes or None
            The payload when this was its last chunk.

        Raises
        ------
        ProtocolViolationError
            On a gap, an overlap, or a total that is not the plan's.
        """
        segment = frame.segment
        if length is not None and frame.total != length:
            raise ProtocolViolationError(
                f"segment {segment} announces {frame.total} bytes, expected {length} by the plan"
            )
        at = self._received.get(segment, 0)
        if frame.offset != at:
            raise ProtocolViolationError(
                f"segment {segment} continues at byte {frame.offset}, expected {at}"
            )
        if frame.last and at == 0:
            return bytes(frame.chunk)
        self._chunks.setdefault(segment, []).append(frame.chunk)
        self._received[segment] = at + len(frame.chunk)
        if not frame.last:
            return None
        payload = b"".join(self._chunks[segment])
        self.forget(segment)
        return payload

    def forget(self, segment: int) -> None:
        """Forget the parts of one segment."""
        self._chunks.pop(segment, None)
        self._received.pop(segment, None)

    def keep_only(self, segments: Collection[int]) -> None:
        """Forget every part of a segment that is not among these."""
        for segment in [segment for segment in self._chunks if segment not in segments]:
            self.forget(segment)

    def clear(self) -> None:
        """Forget everything: the connection is gone."""
        self._chunks.clear()
        self._received.clear()
