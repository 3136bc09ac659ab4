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
import socket
import ssl
from asyncio.transports import BaseTransport
from typing import Any, Final, cast

from starlette.websockets import WebSocketDisconnect
from websockets.http11 import Request
from websockets.protocol import State

from terraport_server.frame_guard import FrameGuard
from terraport_server.peer_limits import FRAMES_PER_MESSAGE, BoundedPeer
from terraport_store import PayloadRange

__all__ = ["EXTENSION", "Connection", "ShortFileError", "connection_of", "protocol_class"]

EXTENSION: Final = "terraport.connection"

TCP_NOTSENT_LOWAT: Final = getattr(socket, "TCP_NOTSENT_LOWAT", 25)
"""Linux has had it since 3.12; Python names it from 3.12."""

_MSG_MORE: Final = getattr(socket, "MSG_MORE", 0)
"""The header waits for its payload, so that both leave in one segment."""


class ShortFileError(OSError):
    """A pack ended before a frame that it had promised was whole; the connection is dropped."""


class Connection(BoundedPeer):
    """One WebSocket connection."""

    notsent_lowat_bytes = 0
    send_buffer_bytes = 0

    heard_s: float = 0.0
    """When bytes last came from the client, pongs included; the event loop's clock."""

    _guard: FrameGuard
    _direct: socket.socket | None = None
    """Our own descriptor of the same socket: the loop refuses to watch the transport's."""
    _may_go_direct = False
    _room: asyncio.Future[None] | None = None

    def connection_made(self, transport: BaseTransport) -> None:
        """Set the socket's buffers."""
        self._guard = FrameGuard(cast("asyncio.Transport", transport))
        super().connection_made(cast("BaseTransport", self._guard))
        self.heard_s = self.loop.time()
        # Empty between two frames: then the next may go past it, straight into the socket.
        self._guard.set_write_buffer_limits(0)
        raw = transport.get_extra_info("socket")
        if raw is None or raw.family not in {socket.AF_INET, socket.AF_INET6}:
            return
        self._may_go_direct = hasattr(os, "sendfile") and not isinstance(
            transport.get_extra_info("ssl_object"), ssl.SSLObject | ssl.SSLSocket
        )
        if self.notsent_lowat_bytes:
            _set_option(raw, socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, self.notsent_lowat_bytes)
        if self.send_buffer_bytes:
            _set_option(raw, socket.SOL_SOCKET, socket.SO_SNDBUF, self.send_buffer_bytes)

    def connection_lost(self, exc: Exception | None) -> None:
        """Let a frame that waits for room know."""
        super().connection_lost(exc)
        self._wake()
        if self._direct is not None and not self._guard.in_frame:
            self._close_direct()

    def data_received(self, data: bytes) -> None:
        """Note the time."""
        self.heard_s = self.loop.time()
        super().data_received(data)

    def handle_connect(self, event: Request) -> None:
        """Add the extension to the scope; the application has not started yet."""
        super().handle_connect(event)
        if hasattr(self, "scope"):
            cast("dict[str, Any]", self.scope["extensions"])[EXTENSION] = self

    @property
    def takes_files(self) -> bool:
        """Whether :meth:`send_file` is possible: not under TLS, not on every system."""
        return self._may_go_direct

    async def send_parts(self, header: bytes, part: memoryview) -> None:
        """Send one binary message of two parts without joining them first.

        Waits until the transport's buffer is empty and then writes without waiting, so at most one
        frame is in it. Not to overlap with another call; safe to cancel: a frame is written whole
        or not at all.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        """
        if await self._is_open():
            self._guard.writelines([_frame_header(len(header) + len(part)), header, part])

    async def send_file(self, header: bytes, part: PayloadRange) -> None:
        """Send one binary message: a header, and bytes of a file that no one copies.

        Returns when the kernel has taken the whole frame. Not to overlap with another call. Safe to
        cancel: the rest of a frame that was begun is handed to the transport, and what others wrote
        meanwhile (pongs) follows it.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        OSError
            When the disk fails, or the file ends too soon (ShortFileError). The connection is
            dropped, because the client was promised more.
        """
        if not await self._is_open():
            return
        if self._guard.get_write_buffer_size():  # a transport that does not keep to our limit
            data = _read(part)
            self._guard.writelines([_frame_header(len(header) + len(data)), header, data])
            return
        if self._direct is None:
            raw = self._guard.get_extra_info("socket")
            self._direct = socket.socket(fileno=os.dup(raw.fileno()))
            self._direct.setblocking(False)
        frame = memoryview(_frame_header(len(header) + part.length) + header)
        self._guard.begin()
        try:
            while frame:
                try:
                    frame = frame[self._direct.send(frame, _MSG_MORE) :]
                except BlockingIOError:
                    await self._until_room()
            while part.length:
                try:
                    sent = os.sendfile(
                        self._direct.fileno(), part.descriptor, part.offset, part.length
                    )
                except BlockingIOError:
                    await self._until_room()
                else:
                    part = _after(part, sent)
        except asyncio.CancelledError:
            self._hand_over(frame, part)
            raise
        except (ConnectionError, WebSocketDisconnect):
            self._guard.abort()
            raise WebSocketDisconnect(1006) from None
        except OSError:  # the disk's, or a pack cut short: the client was promised more
            self._guard.abort()
            raise
        finally:
            self._guard.end()
            if self.disconnected:
                self._close_direct()

    def abort(self) -> None:
        """Drop the connection and everything buffered."""
        self._guard.abort()

    async def _is_open(self) -> bool:
        """Wait for an empty buffer; tell whether frames may still be sent."""
        await self.writable.wait()
        if self.disconnected:
            raise WebSocketDisconnect(1006)
        # What comes after a close is dropped, as uvicorn does.
        return not self.close_sent and self.conn.state is State.OPEN

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

    def _hand_over(self, frame: memoryview, part: PayloadRange) -> None:
        """Leave the rest of a frame to the transport; where it cannot be read, drop the rest."""
        try:
            self._guard.finish(bytes(frame), _read(part))
        except OSError:
            self._guard.abort()

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
) -> type[Connection]:
    """Return a class for uvicorn's ``ws`` option.

    Parameters
    ----------
    notsent_lowat_bytes
        TCP_NOTSENT_LOWAT; 0 = leave the system's.
    send_buffer_bytes
        SO_SNDBUF; 0 = leave it to the system.
    max_messages_per_s
        Bounds control frames and fragments too; see :class:`BoundedPeer`.
    close_timeout_s
        How long a closed client may take to close its side.
    """

    class Bounded(Connection):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            self.close_timeout = close_timeout_s

    Bounded.notsent_lowat_bytes = notsent_lowat_bytes
    Bounded.send_buffer_bytes = send_buffer_bytes
    Bounded.max_frames_per_s = FRAMES_PER_MESSAGE * max_messages_per_s
    return Bounded


def connection_of(scope: Any) -> Connection | None:
    """Return the connection of an ASGI scope, where the server is ours."""
    found = scope.get("extensions", {}).get(EXTENSION)
    return found if isinstance(found, Connection) else None


def _frame_header(length: int) -> bytes:
    """Header of one unmasked, final binary WebSocket frame (RFC 6455, section 5.2)."""
    if length < 126:
        return bytes((0x82, length))
    if length < 1 << 16:
        return b"\x82\x7e" + length.to_bytes(2, "big")
    return b"\x82\x7f" + length.to_bytes(8, "big")


def _after(part: PayloadRange, sent: int) -> PayloadRange:
    """Return what is left of a range; raises ShortFileError where nothing was sent of it."""
    if not sent:
        raise ShortFileError(f"the pack ends {part.length} bytes before its segment")
    return PayloadRange(part.descriptor, part.offset + sent, part.length - sent, part.keeper)


def _read(part: PayloadRange) -> bytes:
    """Read a range; raises ShortFileError where the file is shorter."""
    data = os.pread(part.descriptor, part.length, part.offset)
    if len(data) < part.length:
        raise ShortFileError(f"the pack ends {part.length - len(data)} bytes before its segment")
    return data


def _set_option(raw: socket.socket, level: int, option: int, value: int) -> None:
    try:
        raw.setsockopt(level, option, value)
    except OSError:
        return  # not on this system: credit bounds what is under way all the same
