"""uvicorn's WebSocket protocol with small socket buffers, timestamps, and few system calls.

A subclass of uvicorn's sans-I/O implementation, whose minor version pyproject.toml pins. It adds to
the ASGI scope an extension, ``terraport.connection``, through which the sender accesses the
connection. Under another server, or if uvicorn changes, the extension is missing; everything still
works, with larger buffers and more copies per chunk.

On a plain socket many frames are written in one call, headers and payloads together, bypassing the
transport while its buffer is empty: by ``os.writev`` to the transport's descriptor. The rest of a
frame that the socket does not accept goes through the transport, which keeps the order: a pong or a
close is sent after it.
Measured: ``docs/decisions/0049-many-frames-a-call.md``.
"""

from __future__ import annotations

import os
import socket
from asyncio.transports import BaseTransport
from collections.abc import Callable, Sequence
from typing import Any, Final, cast

from starlette.websockets import WebSocketDisconnect
from websockets.http11 import Request
from websockets.protocol import State

from terraport_server.link_buffer import LinkBuffer
from terraport_server.peer_limits import FRAMES_PER_MESSAGE, BoundedPeer
from terraport_server.stream.client_turns import ClientTurns

__all__ = ["EXTENSION", "MAX_FRAMES", "Connection", "connection_of", "protocol_class"]

EXTENSION: Final = "terraport.connection"

TCP_NOTSENT_LOWAT: Final = getattr(socket, "TCP_NOTSENT_LOWAT", 25)
"""Linux has had it since 3.12; Python names it from 3.12."""

TCP_CONGESTION: Final = getattr(socket, "TCP_CONGESTION", 13)
"""Linux alone has it."""

MAX_FRAMES: Final = 512
"""Of one call: POSIX systems take 1024 buffers, and a frame has two."""

_MOST_UNSENT_BYTES: Final = 64 << 10


class Connection(BoundedPeer):
    """One WebSocket connection."""

    notsent_lowat_bytes = 0
    send_buffer_bytes = 0
    congestion_control: str | None = None

    heard_s: float = 0.0
    """When bytes last came from the client, pongs included; the event loop's clock."""

    _raw: Any = None
    """The transport's socket, while it is open."""
    _may_go_direct = False
    _buffer: LinkBuffer | None = None
    _when_clear: Callable[[], None] | None = None
    _unsent = b""
    """Messages that go out with the next payload, or at the next flush."""

    def connection_made(self, transport: BaseTransport) -> None:
        """Set the socket's buffers."""
        super().connection_made(transport)
        self.heard_s = self.loop.time()
        # Empty between two frames: then the next may go past it, straight into the socket.
        self.transport.set_write_buffer_limits(
            0 if transport.get_extra_info("sslcontext") is None else 65536
        )
        raw = transport.get_extra_info("socket")
        if raw is None or raw.family not in {socket.AF_INET, socket.AF_INET6}:
            return
        self._raw = raw
        is_secure = transport.get_extra_info("sslcontext") is not None
        self._may_go_direct = not is_secure and hasattr(os, "writev")
        if self.notsent_lowat_bytes:
            _set_option(raw, socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, self.notsent_lowat_bytes)
        if self.send_buffer_bytes:
            _set_option(raw, socket.SOL_SOCKET, socket.SO_SNDBUF, self.send_buffer_bytes)
        if self.congestion_control:
            name = self.congestion_control.encode("ascii")
            _set_option(raw, socket.IPPROTO_TCP, TCP_CONGESTION, name)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop writing to the socket: its descriptor number may be reused by another connection."""
        super().connection_lost(exc)
        self._raw = None
        self._tell_clear()

    def data_received(self, data: bytes) -> None:
        """Note when the client was last heard, and read on."""
        self.heard_s = self.loop.time()
        super().data_received(data)

    def handle_connect(self, event: Request) -> None:
        """Add the extension to the scope; the application has not started yet."""
        super().handle_connect(event)
        if hasattr(self, "scope"):
            cast("dict[str, Any]", self.scope["extensions"])[EXTENSION] = self

    @property
    def is_direct(self) -> bool:
        """Whether :meth:`send_frames` is done with its buffers when it returns."""
        return self._may_go_direct

    @property
    def is_clear(self) -> bool:
        """Whether :meth:`send_frames` and :meth:`send_message` may be called now."""
        return self.writable.is_set() and self._is_open()

    async def until_clear(self) -> bool:
        """Wait until :attr:`is_clear`; False where it never will be, after a close.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        """
        await self.writable.wait()
        if self.disconnected:
            raise WebSocketDisconnect(1006)
        return self._is_open()

    def when_clear(self, call: Callable[[], None]) -> None:
        """Call once, when the socket took all that was sent, or the connection is over."""
        if self.writable.is_set():
            self.loop.call_soon(call)
        else:
            self._when_clear = call

    def resume_writing(self) -> None:
        """Go on with what waits for room."""
        super().resume_writing()
        self._tell_clear()

    def send_message(self, data: bytes) -> None:
        """Send one binary message, with what follows or by :meth:`flush`: never waits.

        Only while :attr:`is_clear`; the caller flushes before it waits for anything.
        """
        self._unsent += _frame_header(len(data)) + data
        if len(self._unsent) > _MOST_UNSENT_BYTES:
            self.flush()

    def flush(self) -> None:
        """Send the messages that were not sent yet."""
        if self._unsent:
            data, self._unsent = self._unsent, b""
            if self._is_open():
                self.transport.write(data)

    def send_frames(self, frames: Sequence[tuple[bytes, memoryview]]) -> int:
        """Send binary messages, each of a header and payload that no one joins; never waits.

        Only while :attr:`is_clear`; where it is not any more afterwards, the socket is full: one
        frame at most is then under way, in the transport.

        Parameters
        ----------
        frames
            Header and payload; at most :data:`MAX_FRAMES`. The payload may change after the call
            where :attr:`is_direct`.

        Returns
        -------
        int
            How many were sent, the last one perhaps in part.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        """
        if self._may_go_direct and not self.transport.get_write_buffer_size():
            return self._send_direct(frames)
        self.flush()
        for number, (header, payload) in enumerate(frames, start=1):
            head = _frame_header(len(header) + len(payload)) + header
            if self._may_go_direct:  # what the transport keeps must not change
                self.transport.write(head + payload)
            else:
                self.transport.writelines((head, payload))
            if self.transport.get_write_buffer_size():
                return number
        return len(frames)

    def _send_direct(self, frames: Sequence[tuple[bytes, memoryview]]) -> int:
        if self._raw is None:
            raise WebSocketDisconnect(1006)
        before, self._unsent = self._unsent, b""
        heads: list[bytes] = []
        buffers: list[bytes | memoryview] = []
        total = 0
        for header, payload in frames:
            head = before + _frame_header(len(header) + len(payload)) + header
            before = b""
            heads.append(head)
            buffers += (head, payload)
            total += len(head) + len(payload)
        try:
            if not self.send_buffer_bytes:
                self._fit_buffer()
            sent = os.writev(self._raw.fileno(), buffers)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.transport.abort()
            raise WebSocketDisconnect(1006) from None
        if sent == total:
            return len(frames)
        # The frame that did not fit goes on through the transport, which waits for room.
        number = 0
        while sent >= (length := len(heads[number]) + len(frames[number][1])):
            sent, number = sent - length, number + 1
        head, payload = heads[number], frames[number][1]
        if sent < len(head):
            self.transport.write(head[sent:] + payload)
        else:
            self.transport.write(bytes(payload[sent - len(head) :]))
        return number + 1

    def _fit_buffer(self) -> None:
        now_s = self.loop.time()
        if self._buffer is None:
            self._buffer = LinkBuffer(self._raw, now_s)
        self._buffer.look(now_s)

    def _tell_clear(self) -> None:
        call, self._when_clear = self._when_clear, None
        if call is not None:
            call()

    def abort(self) -> None:
        """Drop the connection and everything buffered."""
        self.transport.abort()

    def _is_open(self) -> bool:
        # What comes after a close is dropped, as uvicorn does.
        return not (self.disconnected or self.close_sent) and self.conn.state is State.OPEN


def protocol_class(
    turns: ClientTurns,
    *,
    notsent_lowat_bytes: int,
    send_buffer_bytes: int,
    max_messages_per_s: float = 60.0,
    close_timeout_s: float = 5.0,
    congestion_control: str | None = None,
) -> type[Connection]:
    """Return a class for uvicorn's ``ws`` option.

    Parameters
    ----------
    turns
        Of all clients of the event loop.
    notsent_lowat_bytes
        TCP_NOTSENT_LOWAT; 0 = leave the system's.
    send_buffer_bytes
        SO_SNDBUF; 0 = fitted to the link while payload flows.
    max_messages_per_s
        Bounds control frames and fragments too; see :class:`BoundedPeer`.
    close_timeout_s
        How long a closed client may take to close its side.
    congestion_control
        TCP_CONGESTION, where the system has and allows it; None = the system's default.
    """

    class Bounded(Connection):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            self.close_timeout = close_timeout_s

    Bounded.turns = turns
    Bounded.notsent_lowat_bytes = notsent_lowat_bytes
    Bounded.send_buffer_bytes = send_buffer_bytes
    Bounded.congestion_control = congestion_control
    Bounded.max_frames_per_s = FRAMES_PER_MESSAGE * max_messages_per_s
    return Bounded


def connection_of(scope: Any) -> Connection | None:
    """Return the connection of an ASGI scope, where the server is ours."""
    connection = scope.get("extensions", {}).get(EXTENSION)
    return connection if isinstance(connection, Connection) else None


def _frame_header(length: int) -> bytes:
    """Header of one unmasked, final binary WebSocket frame (RFC 6455, section 5.2)."""
    if length < 126:
        return bytes((0x82, length))
    if length < 1 << 16:
        return b"\x82\x7e" + length.to_bytes(2, "big")
    return b"\x82\x7f" + length.to_bytes(8, "big")


def _set_option(raw: socket.socket, level: int, option: int, value: int | bytes) -> None:
    try:
        raw.setsockopt(level, option, value)
    except OSError:
        return  # not on this system: credit bounds what is under way all the same
