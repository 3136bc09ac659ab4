"""Fair queues for plans and picks: the client that has used the least CPU time goes first.

A plan takes up to several milliseconds, a pick as long, and all clients together may ask for more
than there is time for. Each job is charged to the account of its client with the CPU time that it
took, so a plan over many segments costs more than one over few. Start-time fair queueing (Goyal,
Vin, Cheng, SIGCOMM 1996): a job's start is the end of its client's last one in virtual time, or the
present if that is later; the earliest start goes first. Idle time earns nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from heapq import heappop, heappush
from time import monotonic, thread_time
from typing import Final, Generic, TypeVar

__all__ = ["Account", "FairQueue", "PickQueue", "PlanQueue"]

LEAD_S: Final = 0.001
"""CPU seconds by which a job may start before the present: the steps of one small landing."""

FREE_SHARE: Final = 0.05
"""Share of CPU time that a client may use without leaving gaps for others: see `PlanQueue`."""

FREE_S: Final = 0.025
"""CPU seconds that it may use at once without: some ten wide plans."""

GAP: Final = 3.0
"""Time between jobs of such clients, in units of the time that the last one took."""

_OVERHEAD_S: Final = 0.0001
"""CPU seconds of a job besides its own: waking, system calls, handing over."""

_MAX_ACCOUNTS: Final = 4096
"""Accounts that are kept before those without recent use are dropped."""

T = TypeVar("T")


class Account:
    """CPU time that one client has used of one queue."""

    __slots__ = ("_charged_s", "_debt_s", "end_s")

    def __init__(self) -> None:
        self.end_s = 0.0
        """End of its last job in the queue's virtual time."""
        self._debt_s = 0.0
        self._charged_s = 0.0

    def charge(self, seconds: float, now_s: float) -> None:
        """Add CPU time."""
        self.end_s += seconds
        self._debt_s = self._debt(now_s) + seconds
        self._charged_s = now_s

    def is_heavy(self, now_s: float) -> bool:
        """Return whether it has used more than is free."""
        return self._debt(now_s) > FREE_S

    def _debt(self, now_s: float) -> float:
        return max(0.0, self._debt_s - FREE_SHARE * (now_s - self._charged_s))


class FairQueue(Generic[T]):
    """Jobs of clients; the caller bounds their number and charges the accounts.

    Examples
    --------
    >>> queue = FairQueue[str]()
    >>> queue.account("wide").charge(1.0, now_s=0.0)
    >>> for client, job in (("wide", "w1"), ("wide", "w2"), ("narrow", "n1")):
    ...     queue.add(client, job)
    >>> [queue.take()[1] for _ in range(len(queue))]
    ['n1', 'w1', 'w2']
    """

    def __init__(self) -> None:
        self._jobs: list[tuple[float, float, int, Account, T]] = []
        self._accounts: dict[str, Account] = {}
        self._now_s = 0.0
        """Virtual time: the latest start of a job."""
        self._number = 0

    def __len__(self) -> int:
        return len(self._jobs)

    def account(self, client: str) -> Account:
        """Return the account of a client; one that reconnects continues with its own."""
        account = self._accounts.get(client)
        if account is None:
            if len(self._accounts) >= _MAX_ACCOUNTS:
                self._accounts = {
                    name: one
                    for name, one in self._accounts.items()
                    if one.end_s > self._now_s - LEAD_S
                }
            account = self._accounts[client] = Account()
        return account

    def add(self, client: str, job: T) -> None:
        """Add a job; a client may have several."""
        account = self.account(client)
        self._number += 1
        start_s = max(self._now_s - LEAD_S, account.end_s)
        heappush(self._jobs, (start_s, account.end_s, self._number, account, job))

    def peek(self) -> Account:
        """Return the account of the next job; IndexError where there is none."""
        while True:
            start_s, _, number, account, job = self._jobs[0]
            if start_s >= account.end_s:
                return account
            # Charged since it was added.
            heappop(self._jobs)
            heappush(self._jobs, (account.end_s, account.end_s, number, account, job))

    def take(self) -> tuple[Account, T]:
        """Remove and return the next job; IndexError where there is none."""
        self.peek()
        start_s, _, _, account, job = heappop(self._jobs)
        self._now_s, account.end_s = max(self._now_s, start_s), start_s
        return account, job


class PlanQueue:
    """Runs short jobs on the event loop, one per loop iteration where several clients wait.

    After a job of a client that has used more than is free, such clients wait for `GAP` times as
    long as it took: a landing takes several iterations, each of which would otherwise be as long
    as the widest plan of another client.
    """

    def __init__(self) -> None:
        self._waiting = FairQueue[tuple[Callable[[], None], Callable[[], None]]]()
        self._has_run = False
        """Whether a job was run in this loop iteration."""
        self._gap_ends_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        """Return the number of waiting jobs."""
        return len(self._waiting)

    def ask(self, client: str, job: Callable[[], None], finished: Callable[[], None]) -> None:
        """Run a job now or in a later iteration, charge it, and call *finished*.

        Both handle their own exceptions.
        """
        self._waiting.add(client, (job, finished))
        if not self._has_run:
            self._run_next()

    def _charge(self, account: Account, took_s: float) -> None:
        now_s = monotonic()
        account.charge(took_s, now_s)
        if account.is_heavy(now_s):
            self._gap_ends_s = now_s + GAP * took_s

    def _run_next(self) -> None:
        self._has_run = False
        if not self._waiting:
            return
        now_s = monotonic()
        if now_s < self._gap_ends_s and self._waiting.peek().is_heavy(now_s):
            if self._timer is None:
                wait_s = self._gap_ends_s - now_s
                self._timer = asyncio.get_running_loop().call_later(wait_s, self._end_gap)
            return
        self._has_run = True
        asyncio.get_running_loop().call_soon(self._run_next)
        account, (job, finished) = self._waiting.take()
        began_s = thread_time()
        job()
        self._charge(account, _OVERHEAD_S + thread_time() - began_s)
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

    async def run(self, client: str, work: Callable[[], T], finished: Callable[[], None]) -> T:
        """Run *work* in a thread and return its result; a cancelled pick is not started.

        Parameters
        ----------
        client
            Who is charged.
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
        self._waiting.add(client, pick)
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
