"""What tasks wait on, a tenth of the size of asyncio's.

An ``asyncio.Event`` takes 0.8 KB, most of it an empty deque, and an ``asyncio.Queue`` 3 KB. An idle
session had five and one of them, a sixth of its memory.
"""

from __future__ import annotations

import asyncio
from typing import Generic, TypeVar

__all__ = ["Inbox", "Signal"]

T = TypeVar("T")


class Signal:
    """As ``asyncio.Event``: set or not, and waited for by any number of tasks of one loop."""

    __slots__ = ("_is_set", "_waiters")

    def __init__(self, *, is_set: bool = False) -> None:
        self._is_set = is_set
        self._waiters: tuple[asyncio.Future[None], ...] = ()

    def is_set(self) -> bool:
        """Whether it is set."""
        return self._is_set

    def set(self) -> None:
        """Let everybody go on who waits."""
        self._is_set = True
        for waiter in self._waiters:
            if not waiter.done():
                waiter.set_result(None)

    def clear(self) -> None:
        """Let those wait who come from now on."""
        self._is_set = False

    async def wait(self) -> None:
        """Wait until it is set; safe to cancel."""
        if self._is_set:
            return
        waiter = asyncio.get_running_loop().create_future()
        self._waiters = (*self._waiters, waiter)
        try:
            await waiter
        finally:
            self._waiters = tuple(other for other in self._waiters if other is not waiter)


class Inbox(Generic[T]):
    """As ``asyncio.Queue`` without a bound, for one reader: whoever puts in bounds it."""

    __slots__ = ("_items", "_something")

    def __init__(self) -> None:
        self._items: list[T] = []
        self._something = Signal()

    def empty(self) -> bool:
        """Whether nothing waits."""
        return not self._items

    def put_nowait(self, item: T) -> None:
        """Put an item last."""
        self._items.append(item)
        self._something.set()

    async def get(self) -> T:
        """Wait for the first item and take it out; safe to cancel."""
        while not self._items:
            self._something.clear()
            await self._something.wait()
        return self._items.pop(0)
