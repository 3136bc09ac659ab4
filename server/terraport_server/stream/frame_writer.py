"""Writes WebSocket messages to a socket: many with one ``writev``, without a copy in Python.

What the socket does not take waits in the backlog, never more than one frame and some messages. Its
first bytes are given to the transport, which reports when the socket has room again: no second
descriptor is watched. Under TLS, and on systems without ``writev``, all goes through the transport.
"""

from __future__ import annotations

import asyncio
import os
import socket
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Final

__all__ = [
    "MAX_FRAMES", "MAX_UNREAD_BYTES", "ClientDisconnected", "FrameWriter", "message_header",
]  # fmt: skip

MAX_FRAMES: Final = 250
"""Frames of one call: POSIX systems take 1024 buffers, and a frame has two."""

MAX_UNREAD_BYTES: Final = 64 << 10
"""Messages that wait for the socket before :meth:`FrameWriter.send_message` flushes."""

_FIRST_BYTES: Final = 16 << 10
"""Part of the backlog that is given to the transport, to be told when the socket has room."""

Data = bytes | memoryview


class ClientDisconnected(ConnectionError):  # noqa: N818 - a state of the client, not a fault
    """The client is gone: nothing can be sent."""


class FrameWriter:
    """Sending half of one connection.

    Parameters
    ----------
    transport
        Its protocol calls :meth:`pause`, :meth:`resume` and :meth:`lose`.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self.descriptor = -1
        """File descriptor of a plain socket; -1 under TLS, without writev, and after the end."""
        raw: socket.socket | None = transport.get_extra_info("socket")
        is_secure = transport.get_extra_info("sslcontext") is not None
        # resume_writing is called when all was sent. uvloop's TLS transport pauses for ever with a
        # high mark of 0.
        transport.set_write_buffer_limits(MAX_UNREAD_BYTES if is_secure else 0, 0)
        if raw is not None and hasattr(os, "writev") and not is_secure:
            self.descriptor = raw.fileno()
        self.lost = False
        """Whether the connection is over."""
        self.closing = False
        """Whether a close frame was sent: no message may follow."""
        self.ending = False
        """Whether :meth:`close` was called: nothing that is received matters any more."""
        self._backlog: list[Data] = []
        self._backlog_bytes = 0
        self._writable = True
        self._waiters: list[asyncio.Future[None]] = []
        self._on_writable: Callable[[], None] | None = None

    @property
    def is_writable(self) -> bool:
        """Whether :meth:`send_frames` and :meth:`send_message` may be called now."""
        return self._writable and not (self.lost or self.closing)

    @property
    def is_full(self) -> bool:
        """Whether the socket has no room."""
        return not self._writable

    async def until_writable(self) -> bool:
        """Wait until :attr:`is_writable`; False where it never will be, after a close.

        Raises
        ------
        ClientDisconnected
            When the client is gone.
        """
        while not (self._writable or self.lost):
            waiter = asyncio.get_running_loop().create_future()
            self._waiters.append(waiter)
            await waiter
        if self.lost:
            raise ClientDisconnected
        return not self.closing

    def when_writable(self, call: Callable[[], None]) -> None:
        """Call once, when the socket has room or the connection is over."""
        if self._writable:
            asyncio.get_running_loop().call_soon(call)
        else:
            self._on_writable = call

    def send_message(self, data: bytes) -> None:
        """Send one binary message with the next frames or the next :meth:`flush`; never waits."""
        self.append(message_header(len(data)) + data)
        if self._backlog_bytes > MAX_UNREAD_BYTES or len(self._backlog) > MAX_FRAMES:
            self.flush()

    def append(self, data: bytes) -> None:
        """Add frames of the WebSocket library to the backlog."""
        self._backlog.append(data)
        self._backlog_bytes += len(data)

    def flush(self) -> None:
        """Send the backlog as far as the socket takes it."""
        while self._backlog and self._writable and not self.lost:
            if self.descriptor < 0:
                data, self._backlog, self._backlog_bytes = b"".join(self._backlog), [], 0
                self._transport.write(data)
            else:
                self._keep(self._backlog, self._writev(self._backlog))

    def close(self) -> None:
        """Close the transport as soon as the socket has taken the backlog.

        The backlog is not passed to the transport: it may lie in a mapped pack, and a copy of what
        a pack cut short has lost ends the process (SIGBUS), while a system call fails.
        """
        self.closing = self.ending = True
        self.flush()
        self._close_if_sent()

    def send_frames(self, buffers: list[Data], ends: Sequence[int]) -> int:
        """Send binary messages; never waits. Only while :attr:`is_writable`.

        Parameters
        ----------
        buffers
            Two per message: header (with :func:`message_header`) and payload, which must not change
            later.
        ends
            Bytes up to the end of each message; at most `MAX_FRAMES`.

        Returns
        -------
        int
            How many were taken; of the last one a part may still wait here.
        """
        if self.descriptor < 0:
            return self._send_by_transport(buffers, ends)
        before = self._backlog_bytes
        sent = self._writev([*self._backlog, *buffers] if before else buffers) - before
        if sent < 0:
            self._keep(self._backlog, sent + before)
            return 0
        self._backlog, self._backlog_bytes = [], 0
        if sent == ends[-1]:
            return len(ends)
        whole = bisect_right(ends, sent)
        self._keep(buffers[2 * whole : 2 * whole + 2], sent - (ends[whole - 1] if whole else 0))
        return whole + 1

    def pause(self) -> None:
        """Stop writing: the socket is full."""
        self._writable = False

    def resume(self) -> None:
        """Continue with the backlog and with the callers that wait for room."""
        self._writable = True
        self._call_back()
        self.flush()
        if self.ending:
            self._close_if_sent()
        if self._writable:
            self._wake()

    def lose(self) -> None:
        """Send nothing more: the descriptor's number may be reused."""
        self.descriptor, self.lost, self._writable = -1, True, True
        self._backlog, self._backlog_bytes = [], 0
        self._call_back()
        self._wake()

    def _close_if_sent(self) -> None:
        if not (self._backlog or self.lost):
            self._end(self._transport.close)

    def _end(self, how: Callable[[], None]) -> None:
        # Not at once: asyncio's transport ends twice if that happens in its call of resume_writing.
        asyncio.get_running_loop().call_soon(how)

    def _writev(self, buffers: list[Data]) -> int:
        try:
            return os.writev(self.descriptor, buffers)
        except BlockingIOError:
            return 0
        except OSError:
            self.lost = True
            self._end(self._transport.abort)
            return 0

    def _keep(self, buffers: list[Data], sent: int) -> None:
        """Keep the unsent part of buffers as backlog, and wait for room if there is one."""
        number = 0
        while number < len(buffers) and sent >= len(buffers[number]):
            sent -= len(buffers[number])
            number += 1
        rest = buffers[number:]
        if rest and not self.lost:
            first = memoryview(rest[0])[sent:]
            if len(first) > _FIRST_BYTES:
                rest[0] = first[_FIRST_BYTES:]
            else:
                del rest[0]
            self._transport.write(first[:_FIRST_BYTES])
        self._backlog, self._backlog_bytes = rest, sum(map(len, rest))

    def _send_by_transport(self, buffers: list[Data], ends: Sequence[int]) -> int:
        self.flush()
        for number in range(len(ends)):
            if not self.is_writable:
                return number
            self._transport.writelines(buffers[2 * number : 2 * number + 2])
        return len(ends)

    def _call_back(self) -> None:
        call, self._on_writable = self._on_writable, None
        if call is not None:
            call()

    def _wake(self) -> None:
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)


def message_header(length: int) -> bytes:
    """Return the header of an unmasked, final binary message (RFC 6455, section 5.2)."""
    if length < 126:
        return bytes((0x82, length))
    if length < 1 << 16:
        return b"\x82\x7e" + length.to_bytes(2, "big")
    return b"\x82\x7f" + length.to_bytes(8, "big")
