"""Fair queues for plans and picks: the client that has used the least CPU time lately goes first.

A plan takes up to several milliseconds, a pick as long, and all clients together may ask for more
than there is time for. Each job is charged to the account of its client with the CPU time that it
took. Usage decays by half every `HALF_LIFE_S`, as in the scheduler of 4.3BSD, so a client that asks
for much all the time waits behind all that do not, and is as good as new a minute later.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from heapq import heappop, heappush
from time import monotonic, thread_time
from typing import Final, Generic, TypeVar

__all__ = ["HEAVY_S", "Account", "Accounts", "FairQueue", "PickQueue", "PlanQueue"]

HALF_LIFE_S: Final = 10.0
"""Time after which CPU usage counts half."""

HEAVY_S: Final = 0.1
"""CPU seconds of recent usage beyond which a client leaves gaps for others: see `PlanQueue`."""

_OVERHEAD_S: Final = 0.0001
"""CPU seconds of a job besides its own: waking, system calls, handing over."""

_MAX_IDLE_ACCOUNTS: Final = 4096
"""Accounts that are kept; of more, those with little recent usage are dropped."""

T = TypeVar("T")


class Account:
    """CPU time that one client has used lately.

    Usage is kept as the logarithm of what it would be had it not decayed, so that accounts compare
    without a look at the clock.

    Examples
    --------
    >>> account = Account()
    >>> account.charge(0.4, now_s=100.0)
    >>> round(account.used_s(now_s=100.0), 3), round(account.used_s(now_s=120.0), 3)
    (0.4, 0.1)
    """

    __slots__ = ("score",)

    def __init__(self) -> None:
        self.score = -math.inf
        """log2(usage) + time / half-life."""

    def charge(self, seconds: float, now_s: float) -> None:
        """Add CPU time."""
        if seconds > 0.0:
            added = math.log2(seconds) + now_s / HALF_LIFE_S
            high, low = max(self.score, added), min(self.score, added)
            self.score = high + math.log2(1.0 + 2.0 ** (low - high))

    def used_s(self, now_s: float) -> float:
        """Return the decayed usage, CPU seconds."""
        return math.exp2(self.score - now_s / HALF_LIFE_S)


class Accounts:
    """Accounts by client; a client that reconnects continues with its usage."""

    def __init__(self) -> None:
        self._accounts: dict[str, Account] = {}

    def of(self, client: str) -> Account:
        """Return the account of a client."""
        account = self._accounts.get(client)
        if account is None:
            if len(self._accounts) >= _MAX_IDLE_ACCOUNTS:
                now_s = monotonic()
                self._accounts = {
                    name: one for name, one in self._accounts.items() if one.used_s(now_s) > 0.001
                }
            account = self._accounts[client] = Account()
        return account


class FairQueue(Generic[T]):
    """Jobs of clients; the caller bounds their number and charges the accounts.

    Examples
    --------
    >>> queue, wide, narrow = FairQueue[str](), Account(), Account()
    >>> wide.charge(1.0, now_s=0.0)
    >>> for account, job in ((wide, "w1"), (wide, "w2"), (narrow, "n1")):
    ...     queue.add(account, job)
    >>> [queue.take()[1] for _ in range(len(queue))]
    ['n1', 'w1', 'w2']
    """

    def __init__(self) -> None:
        self._jobs: list[tuple[float, int, Account, T]] = []
        self._number = 0

    def __len__(self) -> int:
        return len(self._jobs)

    def add(self, account: Account, job: T) -> None:
        """Add a job; an account may have several."""
        self._number += 1
        heappush(self._jobs, (account.score, self._number, account, job))

    def peek(self) -> Account:
        """Return the account of the next job; IndexError where there is none."""
        while True:
            score, number, account, job = self._jobs[0]
            if score >= account.score:
                return account
            # Charged since it was added.
            heappop(self._jobs)
            heappush(self._jobs, (account.score, number, account, job))

    def take(self) -> tuple[Account, T]:
        """Remove and return the next job; IndexError where there is none."""
        self.peek()
        _, _, account, job = heappop(self._jobs)
        return account, job


class PlanQueue:
    """Runs short jobs on the event loop, one per loop iteration where several clients wait.

    After a job of a client with more than `HEAVY_S` of recent usage, such clients wait as long as
    it took: a landing is some twenty iterations, and each would otherwise be as long as the widest
    plan of somebody else.
    """

    def __init__(self) -> None:
        self.accounts = Accounts()
        self._waiting = FairQueue[tuple[Callable[[], None], Callable[[], None]]]()
        self._has_run = False
        """Whether a job was run in this loop iteration."""
        self._gap_ends_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        """Return the number of waiting jobs."""
        return len(self._waiting)

    def ask(self, account: Account, job: Callable[[], None], finished: Callable[[], None]) -> None:
        """Run a job now or in a later iteration, charge it, and call *finished*.

        Both handle their own exceptions.
        """
        self._waiting.add(account, (job, finished))
        if not self._has_run:
            self._run_next()

    def charge(self, account: Account, began_s: float) -> None:
        """Charge the CPU time since a moment of ``thread_time``."""
        now_s, took_s = monotonic(), thread_time() - began_s
        account.charge(took_s, now_s)
        if account.used_s(now_s) > HEAVY_S:
            self._gap_ends_s = now_s + took_s

    def _run_next(self) -> None:
        self._has_run = False
        if not self._waiting:
            return
        now_s = monotonic()
        if now_s < self._gap_ends_s and self._waiting.peek().used_s(now_s) > HEAVY_S:
            if self._timer is None:
                wait_s = self._gap_ends_s - now_s
                self._timer = asyncio.get_running_loop().call_later(wait_s, self._end_gap)
            return
        self._has_run = True
        asyncio.get_running_loop().call_soon(self._run_next)
        account, (job, finished) = self._waiting.take()
        began_s = thread_time()
        job()
        account.charge(_OVERHEAD_S, now_s)
        self.charge(account, began_s)
        finished()

    def _end_gap(self) -> None:
        self._timer = None
        if not self._has_run:
            self._run_next()


class _Pick(Generic[T]):
    """A pick that waits or runs."""

    def __init__(self, work: Callable[[], T], finished: Callable[[], None]) -> None:
        self.work = work
        self.finished = finished
        self.answer: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self.cpu_s = 0.0

    def run(self) -> T:
        """Run in a thread, and note the CPU time."""
        began_s = thread_time()
        try:
            return self.work()
        finally:
            self.cpu_s = thread_time() - began_s


class PickQueue(Generic[T]):
    """Runs picks in threads; used on one event loop.

    Parameters
    ----------
    threads : int
        Picks that run at once.
    """

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="pick")
        self._free = threads
        self._is_open = True
        self._waiting = FairQueue[_Pick[T]]()

    async def run(self, account: Account, work: Callable[[], T], finished: Callable[[], None]) -> T:
        """Run *work* in a thread and return its result; a cancelled pick is not started.

        Parameters
        ----------
        account
            The client's.
        work
            Blocks.
        finished
            Called on the loop when *work* has ended or will not start.

        Raises
        ------
        Exception
            Whatever *work* raises.
        """
        pick = _Pick(work, finished)
        self._waiting.add(account, pick)
        self._start()
        return await pick.answer

    def shutdown(self, *, wait: bool) -> None:
        """Start nothing more; *wait* blocks until the running picks have ended."""
        self._is_open = False
        self._pool.shutdown(wait=wait, cancel_futures=True)

    def _start(self) -> None:
        while self._is_open and self._free and self._waiting:
            account, pick = self._waiting.take()
            if pick.answer.done():
                pick.finished()
                continue
            self._free -= 1
            running = asyncio.get_running_loop().run_in_executor(self._pool, pick.run)
            running.add_done_callback(partial(self._end, account, pick))

    def _end(self, account: Account, pick: _Pick[T], done: asyncio.Future[T]) -> None:
        account.charge(_OVERHEAD_S + pick.cpu_s, monotonic())
        pick.finished()
        error = None if done.cancelled() else done.exception()
        if done.cancelled():
            pick.answer.cancel()
        elif not pick.answer.done():
            if error is None:
                pick.answer.set_result(done.result())
            else:
                pick.answer.set_exception(error)
        self._free += 1
        self._start()
