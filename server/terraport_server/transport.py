"""uvicorn's WebSocket protocol with small socket buffers, a look at the clock, and fewer copies.

A subclass of uvicorn's sans-I/O implementation, whose minor version pyproject.toml pins. It adds to
the ASGI scope an extension, ``terraport.connection``, by which the sender reaches the connection.
Under another server, or if uvicorn changes, the extension is missing and the sender does without:
everything works, with larger buffers and one copy more per chunk.
"""

from __future__ import annotations

import socket
from asyncio.transports import BaseTransport
from typing import Any, Final, cast

from starlette.websockets import WebSocketDisconnect
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request
from websockets.protocol import State

__all__ = ["EXTENSION", "Connection", "connection_of", "protocol_class"]

EXTENSION: Final = "terraport.connection"

TCP_NOTSENT_LOWAT: Final = getattr(socket, "TCP_NOTSENT_LOWAT", 25)
"""Linux has had it since 3.12; Python names it from 3.12."""


class Connection(WebSocketsSansIOProtocol):
    """One WebSocket connection."""

    notsent_lowat_bytes = 0
    send_buffer_bytes = 0

    heard_s: float = 0.0
    """When bytes last came from the client, pongs included; the event loop's clock."""

    def connection_made(self, transport: BaseTransport) -> None:
        """Set the socket's buffers."""
        super().connection_made(transport)
        self.heard_s = self.loop.time()
        raw = transport.get_extra_info("socket")
        if raw is None or raw.family not in {socket.AF_INET, socket.AF_INET6}:
            return
        if self.notsent_lowat_bytes:
            _set_option(raw, socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, self.notsent_lowat_bytes)
        if self.send_buffer_bytes:
            _set_option(raw, socket.SOL_SOCKET, socket.SO_SNDBUF, self.send_buffer_bytes)

    def data_received(self, data: bytes) -> None:
        """Note the time."""
        self.heard_s = self.loop.time()
        super().data_received(data)

    def handle_connect(self, event: Request) -> None:
        """Add the extension to the scope; the application has not started yet."""
        super().handle_connect(event)
        if hasattr(self, "scope"):
            cast("dict[str, Any]", self.scope["extensions"])[EXTENSION] = self

    async def send_parts(self, header: bytes, part: memoryview) -> None:
        """Send one binary message of two parts without joining them first.

        Like uvicorn's own ``send`` it waits until the transport's buffer is below its mark (64 KiB)
        and then writes without waiting, so at most the mark and one frame are in it. Not to overlap
        with another call; safe to cancel: a frame is written whole or not at all.

        Raises
        ------
        WebSocketDisconnect
            When the client is gone.
        """
        await self.writable.wait()
        if self.disconnected:
            raise WebSocketDisconnect(1006)
        if self.close_sent or self.conn.state is not State.OPEN:
            return  # what comes after a close is dropped, as uvicorn does
        self.transport.writelines([_frame_header(len(header) + len(part)), header, part])

    def abort(self) -> None:
        """Drop the connection and everything buffered."""
        self.transport.abort()


def protocol_class(*, notsent_lowat_bytes: int, send_buffer_bytes: int) -> type[Connection]:
    """Return a class for uvicorn's ``ws`` option.

    Parameters
    ----------
    notsent_lowat_bytes
        TCP_NOTSENT_LOWAT; 0 = leave the system's.
    send_buffer_bytes
        SO_SNDBUF; 0 = leave it to the system.
    """
    return type(
        "Connection",
        (Connection,),
        {"notsent_lowat_bytes": notsent_lowat_bytes, "send_buffer_bytes": send_buffer_bytes},
    )


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


def _set_option(raw: socket.socket, level: int, option: int, value: int) -> None:
    try:
        raw.setsockopt(level, option, value)
    except OSError:
        return  # not on this system: credit bounds what is under way all the same
