"""A transport that keeps others out of a frame which is on its way past it."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, Final

__all__ = ["MAX_HELD_BYTES", "FrameGuard"]

MAX_HELD_BYTES: Final = 128 << 10
"""Control frames that may wait for a frame; a client that makes more is dropped. Pongs stop at half
of it (``peer_limits.py``)."""


class FrameGuard:
    """Wraps a transport; between :meth:`begin` and :meth:`end` what is written waits.

    A frame that is sent past the transport (``sendfile``) takes several steps. uvicorn answers
    pings and closes by timers and events, at any moment; a control frame inside of another frame is
    a broken stream (RFC 6455, section 5.4).

    Parameters
    ----------
    transport
        Its buffer is empty when a frame begins.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._held: list[bytes] = []
        self._held_bytes = 0
        self._close = False
        self.in_frame = False
        """Whether a frame is under way."""

    def __getattr__(self, name: str) -> Any:
        """Return what the transport itself has of that name."""
        return getattr(self._transport, name)

    def begin(self) -> None:
        """Let nobody else write."""
        self.in_frame = True

    def finish(self, *rest: bytes) -> None:
        """Write what is left of the frame; it is not under way any more."""
        self.in_frame = False
        self._transport.writelines(rest)

    def end(self) -> None:
        """Write what has waited."""
        self.in_frame = False
        if self._held:
            held, self._held, self._held_bytes = self._held, [], 0
            self._transport.writelines(held)
        if self._close:
            self._close = False
            self._transport.close()

    def write(self, data: bytes) -> None:
        """Write now, or after the frame."""
        if not self.in_frame:
            self._transport.write(data)
            return
        self._held.append(data)
        self._held_bytes += len(data)
        if self._held_bytes > MAX_HELD_BYTES:
            self._held.clear()
            self._transport.abort()

    def get_write_buffer_size(self) -> int:
        """Bytes that wait, here or in the transport."""
        return self._held_bytes + int(self._transport.get_write_buffer_size())

    def writelines(self, buffers: Iterable[bytes | memoryview]) -> None:
        """Write now; only whole frames, and only by who begins frames."""
        self._transport.writelines(buffers)

    def close(self) -> None:
        """Close now, or after the frame."""
        if self.in_frame:
            self._close = True
        else:
            self._transport.close()

    def is_closing(self) -> bool:
        """Whether it is closed or will be."""
        return self._close or self._transport.is_closing()

    def abort(self) -> None:
        """Drop the connection, frame or not."""
        self._held.clear()
        self._transport.abort()
