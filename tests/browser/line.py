"""The line between page and server, in a thread of its own: Playwright keeps the test's."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from sdk.proxy import Proxy

__all__ = ["Line", "line_to"]


class Line:
    """A proxy that a test cuts, slows and stalls."""

    def __init__(self, proxy: Proxy, loop: asyncio.AbstractEventLoop) -> None:
        self._proxy = proxy
        self._loop = loop
        self.url = proxy.url

    @property
    def down_bytes(self) -> int:
        """Bytes from the server so far."""
        return self._proxy.down_bytes

    def cut(self) -> None:
        """Cut every open connection in the middle of whatever it carries."""
        asyncio.run_coroutine_threadsafe(self._proxy.cut(), self._loop).result(10)

    def refuse(self, refuses: bool) -> None:
        """Let no new connection through, or again."""
        self._proxy.refuse = refuses

    def slow(self, bytes_per_s: float | None) -> None:
        """Let so much through from now on."""
        self._proxy.bytes_per_s = bytes_per_s


@contextmanager
def line_to(url: str) -> Iterator[Line]:
    """A proxy to a server, relaying in a thread of its own until the block ends."""
    started: list[Line] = []
    is_up, is_over = threading.Event(), threading.Event()

    async def relay() -> None:
        async with Proxy(url) as proxy:
            started.append(Line(proxy, asyncio.get_running_loop()))
            is_up.set()
            await asyncio.to_thread(is_over.wait)

    thread = threading.Thread(target=lambda: asyncio.run(relay()))
    thread.start()
    assert is_up.wait(10)
    try:
        yield started[0]
    finally:
        is_over.set()
        thread.join(10)
