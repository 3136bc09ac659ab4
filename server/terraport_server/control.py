"""What supervisor and worker say to each other: one JSON object a line over a pair of sockets.

=========== ============ ==========================================================
kind        who          meaning
=========== ============ ==========================================================
``start``   supervisor   settings, slot, everybody's listening sockets; the first line
``ready``   worker       scenes are open, clients are accepted
``alive``   worker       its event loop turns; five times a second from then on
``listen``  supervisor   slots whose new clients to accept from now on: its own and those of
                         workers that are dead, hang or start
``groups``  worker       names of all groups that have members here, whenever they change
``retire``  supervisor   another worker has taken over: accept nobody, drain, end
``measure`` supervisor   asks for the worker's metrics
``page``    worker       its metrics; also once by itself, before it ends
``scrape``  worker       somebody asks it for the metrics of all
``merged``  supervisor   the answer to that
=========== ============ ==========================================================

The end of the stream is a message too: a worker whose supervisor is gone drains and ends, so none
is ever left over.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from typing import Any, Final

__all__ = ["MAX_LINE_BYTES", "Channel"]

MAX_LINE_BYTES: Final = 16 << 20
"""A page of metrics is some 100 KB; a thousand scenes with their labels make a few MB."""


class Channel:
    """One end of the socket pair of supervisor and worker. Lives on one event loop."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    @classmethod
    async def open(cls, end: socket.socket) -> Channel:
        """Take one end of a pair; it is closed with the channel."""
        end.setblocking(False)
        reader, writer = await asyncio.open_connection(sock=end, limit=MAX_LINE_BYTES)
        return cls(reader, writer)

    def say(self, kind: str, **fields: Any) -> None:
        """Send a message; nothing happens where the other end is gone."""
        if not self._writer.is_closing():
            self._writer.write(json.dumps({"kind": kind, **fields}).encode() + b"\n")

    async def hear(self) -> dict[str, Any] | None:
        """Return the next message, ``None`` where the other end is gone."""
        try:
            line = await self._reader.readline()
        except (ConnectionError, ValueError):  # ValueError: a line beyond the limit
            return None
        if not line.endswith(b"\n"):
            return None
        message: dict[str, Any] = json.loads(line)
        return message

    async def close(self) -> None:
        """Send what is left and close."""
        if self._writer.is_closing():  # the other end is gone
            return
        self._writer.transport.set_write_buffer_limits(high=0)
        with contextlib.suppress(ConnectionError):
            await self._writer.drain()
        self._writer.close()
