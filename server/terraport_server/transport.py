"""uvicorn's WebSocket protocol with small socket buffers, a look at the clock, and no copies.

A subclass of uvicorn's sans-I/O implementation, whose minor version pyproject.toml pins. It adds to
the ASGI scope an extension, ``terraport.connection``, by which the sender reaches the connection.
Under another server, or if uvicorn changes, the extension is missing and the sender does without:
everything works, with larger buffers and more copies per chunk.

A chunk goes from the page cache to the socket by ``sendfile`` where it can (a plain socket, a pack
that is a file); otherwise header and payload go to the transport as they are, without being joined.
Measured: ``docs/decisions/0017-payload-by-sendfile.md``.
"""

from __future__ import annotations

import asyncio
import os
import select
import socket
from asyncio.transports import BaseTransport
from collections.abc import Callable, Sequence
from typing import Any, Final, cast

from starlette.websockets import WebSocketDisconnect
from websockets.http11 import Request
from websockets.protocol import State

from terraport_server.frame_guard import FrameGuard
from terraport_server.link_buffer import LinkBuffer
from terraport_server.peer_limits import FRAMES_PER_MESSAGE, BoundedPeer
from terraport_store import PayloadRange

__all__ = ["EXTENSION", "Connection", "ShortFileError", "connection_of", "protocol_class"]

EXTENSION: Final = "terraport.connection"

TCP_NOTSENT_LOWAT: Final = getattr(socket, "TCP_NOTSENT_LOWAT", 25)
"""Linux has had it since 3.12; Python names it from 3.12."""

TCP_CONGESTION: Final = getattr(socket, "TCP_CONGESTION", 13)
"""Linux alone has it."""

_MSG_MORE: Final = getattr(socket, "MSG_MORE", 0)
"""The header waits for its payload, so that both leave in one segment."""


class ShortFileError(OSError):
    """A pack ended before a frame that it had promised was whole; the connection is dropped."""


class Connection(BoundedPeer):
    """One WebSocket connection."""

    notsent_lowat_bytes = 0
    send_buffer_bytes = 0
    congestion_control: str | None = None

    heard_s: float = 0.0
    """When bytes last came from the client, pongs included; the event loop's clock."""

    frames_begun = 0
    """Of the last call of :meth:`send_frames`."""

    _guard: FrameGuard
    _direct: socket.socket | None = None
    """Our own descriptor of the same socket: the loop refuses to watch the transport's."""
    _number = -1
    _poll_client: Callable[[int], list[Any]] = staticmethod(lambda _ms: [])
    """Whether bytes of the client wait to be read, as far as that can be told."""
    _may_go_direct = False
    _frame: tuple[bytes, PayloadRange] | None = None
    """What is left of the frame that is under way past the transport."""
    _room: asyncio.Future[None] | None = None
    _buffer: LinkBuffer | None = None

    def connection_made(self, transport: BaseTransport) -> None:
        """Set the socket's buffers."""
        self._guard = FrameGuard(cast("asyncio.Transport", transport))
        super().connection_made(cast("BaseTransport", self._guard))
        self.heard_s = self.loop.time()
        secret = transport.get_extra_info("ssl_object") is not None
        if not secret:
            # Empty between two frames: then the next may go past it, straight into the socket.
            # Under TLS nothing may go past, and uvloop's transport, asked for this, tells that its
            # buffer is empty only when the client sends something.
            self._guard.set_write_buffer_limits(0)
        raw = transport.get_extra_info("socket")
        if raw is None or raw.family not in {socket.AF_INET, socket.AF_INET6}:
            return
        self._may_go_direct = hasattr(os, "sendfile") and not secret
        if hasattr(select, "poll"):
            poll = select.poll()
            poll.register(raw.fileno(), select.POLLIN)
            self._poll_client = poll.poll
        if self.notsent_lowat_bytes:
            _set_option(raw, socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, self.notsent_lowat_bytes)
        if self.send_buffer_bytes:
            _set_option(raw, socket.SOL_SOCKET, socket.SO_SNDBUF, self.send_buffer_bytes)
        if self.congestion_control:
            name = self.congestion_control.encode("ascii")
            _set_option(raw, socket.IPPROTO_TCP, TCP_CONGESTION, name)

    def connection_lost(self, exc: Exception | None) -> None:
        """Let a frame that waits for room know."""
        super().connection_lost(exc)
        self._wake()
        if self._direct is not None and not self._guard.in_frame:
            self._close_direct()

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
    def takes_files(self) -> bool:
        """Whether :meth:`send_frames` takes ranges of files: not under TLS, not on every system."""
        return self._may_go_direct

    @property
    def is_clear(self) -> bool:
        """Whether :meth:`send_frames` may be called now."""
        return self.writable.is_set() and self._frame is None and self._is_open()

    async def until_clear(self) -> bool:
        """Wait until :meth:`send_frames` may be called; False where it never may, after a close.

        Sends the rest of a frame that was begun. Safe to cancel: the rest of a frame is handed to
        the transport, and what others wrote meanwhile (pongs) follows it.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        OSError
            When the disk fails, or the file ends too soon (ShortFileError). The connection is
            dropped, because the client was promised more.
        """
        try:
            while self._frame is not None:
                await self._until_room()
                self._push()
            await self.writable.wait()
        except asyncio.CancelledError:
            self.hand_over()
            raise
        except WebSocketDisconnect:
            self._drop_frame()
            raise
        if self.disconnected:
            raise WebSocketDisconnect(1006)
        return self._is_open()

    def send_frames(self, frames: Sequence[tuple[bytes, PayloadRange | memoryview]]) -> int:
        """Send binary messages, each of a header and payload that no one joins; never waits.

        Only while :attr:`is_clear`. Ends before the next frame when the client says something, or
        when the socket is full: at most one frame is then under way, as bytes in the transport, or
        as a range of the file (:meth:`until_clear` sends it).

        Parameters
        ----------
        frames
            Header and payload; a range of a file only where :attr:`takes_files`.

        Returns
        -------
        int
            How many were sent, the last one perhaps in part.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        OSError
            As :meth:`until_clear`.
        """
        now_s = self.loop.time()
        if self._may_go_direct and not self.send_buffer_bytes:
            if self._buffer is None:
                self._buffer = LinkBuffer(self._own_socket(), now_s)
            self._buffer.look(now_s)
        poll = self._poll_client
        for number, (header, payload) in enumerate(frames, start=1):
            self.frames_begun = number
            if isinstance(payload, PayloadRange):
                self._frame = (_frame_header(len(header) + payload.length) + header, payload)
                if not self._push():
                    return number
            else:
                head = _frame_header(len(header) + len(payload))
                self._guard.writelines([head, header, payload])
                if self._guard.get_write_buffer_size():
                    return number
            if poll(0):
                return number
        return len(frames)

    def abort(self) -> None:
        """Drop the connection and everything buffered."""
        self._guard.abort()

    def _is_open(self) -> bool:
        # What comes after a close is dropped, as uvicorn does.
        return not (self.disconnected or self.close_sent) and self.conn.state is State.OPEN

    def _push(self) -> bool:
        """Hand the socket what it takes of the frame; tell whether that was all."""
        assert self._frame is not None
        direct, (head, file_range) = self._direct or self._own_socket(), self._frame
        try:
            while head:
                head = head[direct.send(head, _MSG_MORE) :]
            while file_range.length:
                sent = os.sendfile(
                    self._number, file_range.descriptor, file_range.offset, file_range.length
                )
                if sent == file_range.length:
                    break
                file_range = _after(file_range, sent)
        except BlockingIOError:
            self._frame = (head, file_range)
            self._guard.begin()
            return False
        except ConnectionError:
            self._drop_frame()
            raise WebSocketDisconnect(1006) from None
        except OSError:  # the disk's, or a pack cut short: the client was promised more
            self._drop_frame()
            raise
        self._frame = None
        if self._guard.in_frame:
            self._guard.end()
            self.answer_ping()
        return True

    def _own_socket(self) -> socket.socket:
        if self._direct is None:
            raw = self._guard.get_extra_info("socket")
            self._direct = socket.socket(fileno=os.dup(raw.fileno()))
            self._direct.setblocking(False)
            self._number = self._direct.fileno()
        return self._direct

    async def _until_room(self) -> None:
        """Wait until the socket takes more."""
        assert self._direct is not None
        if self.disconnected:
            raise WebSocketDisconnect(1006)
        self._room = self.loop.create_future()
        descriptor = self._direct.fileno()
        self.loop.add_writer(descriptor, self._wake)
        try:
            await self._room
        finally:
            self._room = None
            self.loop.remove_writer(descriptor)
        if self.disconnected:
            raise WebSocketDisconnect(1006)

    def hand_over(self) -> None:
        """Leave the rest of a frame, if one is under way, to the transport.

        Where it cannot be read, the connection is dropped.
        """
        if self._frame is None:
            return
        (head, file_range), self._frame = self._frame, None
        try:
            self._guard.finish(head, _read(file_range))
        except OSError:
            self._guard.abort()
        self._end_frame()

    def _drop_frame(self) -> None:
        if self._frame is not None:
            self._frame = None
            self._guard.abort()
            self._end_frame()

    def _end_frame(self) -> None:
        self._guard.end()
        if self.disconnected:
            self._close_direct()

    def _wake(self) -> None:
        if self._room is not None and not self._room.done():
            self._room.set_result(None)

    def _close_direct(self) -> None:
        if self._direct is not None:
            self._direct.close()
            self._direct = None


def protocol_class(
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


def _after(file_range: PayloadRange, sent: int) -> PayloadRange:
    """Return what is left of a range; raises ShortFileError where nothing was sent of it."""
    if not sent:
        raise ShortFileError(f"the pack ends {file_range.length} bytes before its segment")
    return PayloadRange(
        file_range.descriptor, file_range.offset + sent, file_range.length - sent, file_range.keeper
    )


def _read(file_range: PayloadRange) -> bytes:
    """Read a range; raises ShortFileError where the file is shorter."""
    data = os.pread(file_range.descriptor, file_range.length, file_range.offset)
    if len(data) < file_range.length:
        raise ShortFileError(
            f"the pack ends {file_range.length - len(data)} bytes before its segment"
        )
    return data


def _set_option(raw: socket.socket, level: int, option: int, value: int | bytes) -> None:
    try:
        raw.setsockopt(level, option, value)
    except OSError:
        return  # not on this system: credit bounds what is under way all the same
