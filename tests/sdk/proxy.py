"""A small TCP proxy that cuts, corrupts or stalls what a server says."""

from __future__ import annotations

import asyncio
import contextlib
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit


class Proxy:
    """An async context manager between a client and one server.

    Parameters
    ----------
    target
        Address of the server, ``http://HOST:PORT``.
    """

    def __init__(self, target: str) -> None:
        url = urlsplit(target)
        self._target = (url.hostname, url.port)
        self.cuts: list[int] = []
        """Bytes from the server after which to cut a connection; one entry is used up by each."""
        self.flip_at: int | None = None
        """Flip one bit of that byte from the server, once."""
        self.connections = 0
        self.down_bytes = 0
        """Bytes from the server so far, over all connections."""
        self.refuse = False
        """Close new connections at once."""
        self.bytes_per_s: float | None = None
        """How fast each connection may be from the server; None: as it comes."""
        self.flows = asyncio.Event()
        """Cleared: nothing from the server goes through, as on a line that stalls."""
        self.flows.set()
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def url(self) -> str:
        """Address that clients use instead of the server's."""
        return f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"

    async def cut(self) -> None:
        """Cut every connection now, as a pulled cable would be noticed."""
        for writer in list(self._writers):
            writer.transport.abort()

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self.cut()
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(self._relay(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.refuse:
            writer.transport.abort()
            return
        try:
            up_reader, up_writer = await asyncio.open_connection(*self._target)
        except (OSError, asyncio.CancelledError):
            writer.transport.abort()
            return
        self.connections += 1
        both = {writer, up_writer}
        self._writers |= both
        try:
            up = asyncio.create_task(self._copy(reader, up_writer))
            down = asyncio.create_task(self._copy_down(up_reader, writer))
            await asyncio.wait({up, down}, return_when=asyncio.FIRST_COMPLETED)
            for task in (up, down):
                task.cancel()
            await asyncio.gather(up, down, return_exceptions=True)
        finally:
            self._writers -= both
            for end in both:
                end.transport.abort()

    async def _copy(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(1 << 16):
                writer.write(data)
                await writer.drain()

    async def _copy_down(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        sent = 0
        with contextlib.suppress(OSError):
            while data := await reader.read(1 << 16 if self.bytes_per_s is None else 1 << 12):
                await self.flows.wait()
                if self.bytes_per_s is not None:
                    await asyncio.sleep(len(data) / self.bytes_per_s)
                if self.flip_at is not None and self.flip_at < self.down_bytes + len(data):
                    spoilt = bytearray(data)
                    spoilt[self.flip_at - self.down_bytes] ^= 1
                    data, self.flip_at = bytes(spoilt), None
                self.down_bytes += len(data)
                sent += len(data)
                writer.write(data)
                await writer.drain()
                if self.cuts and sent >= self.cuts[0]:
                    self.cuts.pop(0)
                    return
