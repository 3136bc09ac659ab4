"""A faulty line between a client that is a program and the service."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from sdk.proxy import Proxy

__all__ = ["ThreadedProxy"]


class ThreadedProxy:
    """`sdk.proxy.Proxy` on a thread of its own, for clients that are programs."""

    def __init__(self, target: str) -> None:
        self.proxy = Proxy(target)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)

    @property
    def url(self) -> str:
        return self.proxy.url

    def cut(self) -> None:
        """Cut every connection now."""
        self._call(self.proxy.cut)

    def __enter__(self) -> Self:
        self._thread.start()
        self._call(self.proxy.__aenter__)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._call(lambda: self.proxy.__aexit__(None, None, None))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _call(self, work: Callable[[], Any]) -> None:
        asyncio.run_coroutine_threadsafe(work(), self._loop).result(30)
