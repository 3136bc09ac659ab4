"""Picks wait in line for a thread: the client's goes next whose picks have used the least.

All clients together may have thousands under way, of some milliseconds each, and answers are
waited for by people. A pick nobody waits for any more is not begun.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Final, Generic, TypeVar

from terraport_server.stream.priced_queue import Account, PricedQueue

__all__ = ["PickLine"]

_LEAST_S: Final = 0.0002
"""Of a pick, beside its thread's time: handing it over and back."""

T = TypeVar("T")


class _Entry(Generic[T]):
    """A pick that waits or is under way."""

    def __init__(self, work: Callable[[], T], over: Callable[[], None]) -> None:
        self.work = work
        self.over = over
        self.answer: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self.cpu_s = 0.0

    def run(self) -> T:
        """Do it, in a thread, and note what it took."""
        began_s = time.thread_time()
        try:
            return self.work()
        finally:
            self.cpu_s = time.thread_time() - began_s


class PickLine(Generic[T]):
    """Threads, and who waits for one. Lives on one event loop.

    Parameters
    ----------
    threads : int
        Picks under way at once.
    """

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="pick")
        self._free = threads
        self._is_open = True
        self._waiting = PricedQueue[_Entry[T]]()

    async def run(self, account: Account, work: Callable[[], T], over: Callable[[], None]) -> T:
        """Do *work* in a thread when it is its client's turn; return what it returns.

        Cancelling it gives the place up, or leaves the thread to end by itself.

        Parameters
        ----------
        account
            Of the client, in this line.
        work
            Blocks.
        over
            Called, on the loop, when *work* has ended or is not begun any more.

        Raises
        ------
        Exception
            Whatever *work* raises.
        """
        entry = _Entry(work, over)
        self._waiting.add(account, entry)
        self._begin()
        return await entry.answer

    def shutdown(self, *, wait: bool) -> None:
        """Begin nothing more; where it is asked for, wait for what is under way. Blocks then."""
        self._is_open = False
        self._pool.shutdown(wait=wait, cancel_futures=True)

    def _begin(self) -> None:
        while self._is_open and self._free and self._waiting:
            account, entry = self._waiting.take()
            if entry.answer.done():  # given up
                entry.over()
                continue
            self._free -= 1
            running = asyncio.get_running_loop().run_in_executor(self._pool, entry.run)
            running.add_done_callback(partial(self._end, account, entry))

    def _end(self, account: Account, entry: _Entry[T], done: asyncio.Future[T]) -> None:
        account.pay(_LEAST_S + entry.cpu_s)
        entry.over()
        if done.cancelled():
            entry.answer.cancel()
        elif (error := done.exception()) is None:
            if not entry.answer.done():
                entry.answer.set_result(done.result())
        elif not entry.answer.done():
            entry.answer.set_exception(error)
        self._free += 1
        self._begin()
