"""A line of a given rate and delay between a browser and a server, in a thread of its own.

All connections share one rate in each direction, as they share a household's line. What is sent
waits for its turn and then for the delay; a new connection waits a round trip before anything of it
is answered. TCP's own slow start and losses are not modelled: both sides of a comparison lack them.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from typing import Final

__all__ = ["ShapedLine", "shaped_line"]

PIECE_BYTES: Final = 1 << 13
"""Sent at once: 1.3 ms at 50 Mbit/s, so that connections take turns."""
AHEAD_BYTES: Final = 1 << 18
"""Of one connection on the line; more is not read from its sender."""


class ShapedLine:
    """A TCP relay; started by :func:`shaped_line`.

    Parameters
    ----------
    target
        Host and port of the server.
    mbit
        Megabits a second, each way; of all connections together.
    round_trip_ms
        Twice the delay of one way.
    """

    def __init__(self, target: tuple[str, int], mbit: float, round_trip_ms: float) -> None:
        self.target = target
        self.bytes_per_s = mbit * 125_000
        self.delay_s = round_trip_ms / 2000
        self.port = 0
        self.down_bytes = 0
        """From the server so far."""
        self.connections = 0
        self._free_at_s = {"up": 0.0, "down": 0.0}

    async def start(self) -> asyncio.Server:
        """Listen on a free port of this machine."""
        server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        return server

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Cancelled when the block ends: Python 3.11's streams would log that as an error.
        with contextlib.suppress(asyncio.CancelledError):
            await self._relay(reader, writer)

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        await asyncio.sleep(2 * self.delay_s)
        try:
            up_reader, up_writer = await asyncio.open_connection(*self.target)
        except OSError:
            writer.transport.abort()
            return
        ways = [
            asyncio.create_task(self._carry(reader, up_writer, "up")),
            asyncio.create_task(self._carry(up_reader, writer, "down")),
        ]
        # Half-closed connections of HTTP are not told apart: either end closes both.
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
        for end in (writer, up_writer):
            end.transport.abort()

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: str
    ) -> None:
        on_line: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(AHEAD_BYTES // PIECE_BYTES)
        arrivals = asyncio.create_task(self._arrive(on_line, writer))
        clock = asyncio.get_running_loop().time
        try:
            while piece := await reader.read(PIECE_BYTES):
                begins_s = max(clock(), self._free_at_s[way])
                self._free_at_s[way] = begins_s + len(piece) / self.bytes_per_s
                if way == "down":
                    self.down_bytes += len(piece)
                await on_line.put((self._free_at_s[way] + self.delay_s, piece))
            await on_line.join()
        except OSError:
            pass
        finally:
            arrivals.cancel()

    @staticmethod
    async def _arrive(
        on_line: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter
    ) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            at_s, piece = await on_line.get()
            await asyncio.sleep(max(0.0, at_s - clock()))
            writer.write(piece)
            await writer.drain()
            on_line.task_done()


@contextlib.contextmanager
def shaped_line(target: tuple[str, int], mbit: float, round_trip_ms: float) -> Iterator[ShapedLine]:
    """Relay to a server until the block ends."""
    line = ShapedLine(target, mbit, round_trip_ms)
    is_up, is_over = threading.Event(), threading.Event()

    async def relay() -> None:
        async with await line.start():
            is_up.set()
            await asyncio.to_thread(is_over.wait)
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

    thread = threading.Thread(target=lambda: asyncio.run(relay()))
    thread.start()
    if not is_up.wait(10):
        raise RuntimeError("the line did not come up within 10 s, expected a free port")
    try:
        yield line
    finally:
        is_over.set()
        thread.join(10)
