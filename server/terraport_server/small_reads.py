"""Reads of a few kilobytes for connections that nobody has vouched for.

An event loop reads what there is, up to 256 KiB at once, and hands it on as an object of that size:
a thousand strangers that send ahead hold as many of them. Here a read fills one small buffer, which
all connections share: what is handed on is copied out of it before the next.
"""

from __future__ import annotations

import asyncio
from asyncio.transports import BaseTransport
from typing import Final

__all__ = ["READ_BYTES", "ReadRoom", "SmallReads"]

READ_BYTES: Final = 8 << 10

ReadRoom = memoryview
"""What reads of one event loop go into."""


class SmallReads(asyncio.BufferedProtocol):
    """Reads for a protocol, in pieces of `READ_BYTES` at most.

    Parameters
    ----------
    reader
        Whose connection it is. To read for itself again it makes itself the transport's protocol.
    room
        Of `READ_BYTES`, shared by all on one event loop.
    """

    __slots__ = ("_room", "reader")

    def __init__(self, reader: asyncio.Protocol, room: ReadRoom) -> None:
        self.reader = reader
        self._room = room

    def connection_made(self, transport: BaseTransport) -> None:
        """Hand on."""
        self.reader.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Hand on."""
        self.reader.connection_lost(exc)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - ours is as large as it gets
        """Return where the next read goes."""
        return self._room

    def buffer_updated(self, nbytes: int) -> None:
        """Hand what was read on, copied."""
        self.reader.data_received(bytes(self._room[:nbytes]))

    def eof_received(self) -> bool | None:
        """Hand on."""
        return self.reader.eof_received()

    def pause_writing(self) -> None:
        """Hand on."""
        self.reader.pause_writing()

    def resume_writing(self) -> None:
        """Hand on."""
        self.reader.resume_writing()
