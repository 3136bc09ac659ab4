"""Whose turn it is among clients: to have a message taken, or a landing planned.

A message costs a tenth of a millisecond, or one with a table of 32,768 rows nearly a whole one; a
plan as much as the landing is wide, up to several. All clients together may ask for far more than
there is time for. Here each asks for a turn and pays for it by what it cost, and between two looks
at the network one is taken. So who asks for much all the time waits behind everybody who does not,
and never holds them up for more than the one turn that is being taken (:mod:`priced_queue`).

A landing is some twenty steps of the event loop, most of them payload to a socket that was full. So
a turn of who has taken much lately is followed by a rest as long as it was, in which only those are
served who have not: else each of these steps would be as long as the widest plan.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from time import monotonic, thread_time
from typing import Final

from terraport_server.stream.priced_queue import Account, PricedQueue

__all__ = ["LEAST_COST", "ClientTurns", "Work"]

LEAST_COST: Final = 500
"""Of a turn, in segments that a plan looks at (0.15 us each): parsing, tasks that are woken and
system calls cost about as much."""

_LEAD_COST: Final = 16 * LEAST_COST
"""What whoever asked for little has free: the four turns of a landing, and as many again."""

_FREE_SHARE: Final = 0.05
"""Of the loop's time that one client may take without being among those who wait for rests."""

_FREE_S: Final = 0.025
"""And so much at once: some ten wide landings."""

_MOST_LEFT: Final = 1024
"""Accounts of clients that left which are kept, the newest."""

Work = Callable[[], int | None]
"""Takes a turn without waiting; returns what it cost beside `LEAST_COST`, in segments looked at, or
``None`` where nobody wants it any more."""


class ClientTurns:
    """Gives the clients of one event loop their turns."""

    def __init__(self) -> None:
        self._waiting = PricedQueue[Work](_LEAD_COST)
        self._of_address: Counter[str | None] = Counter()
        """Turns that are waited for, by address."""
        self._left: deque[Account] = deque(maxlen=_MOST_LEFT)
        """Of clients that are gone and had used more than others; the newest last."""
        self._running = False
        """Whether a turn was taken in this step, and the next step looks for another."""
        self._rests_until_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        """Return how many turns are waited for, given up ones among them."""
        return len(self._waiting)

    def ask(self, account: Account, work: Work) -> None:
        """Take a turn: now where nobody else did in this step, or else in a later one.

        An exception of *work* is the caller's, or the event loop's where it comes later.
        """
        if self._running or (self._waiting and (self._timer is None or account.is_in_debt)):
            self._waiting.add(account, work)
            self._of_address[account.address] += 1
            return
        # Nobody waits, or only who rests: no need to go round the loop first.
        self._running = True
        asyncio.get_running_loop().call_soon(self._turn)
        self._waiting.skip(account)
        self._do(account, work)

    async def take(self, account: Account, make: Callable[[], int]) -> None:
        """Call *make* when it is this client's turn, and return then.

        Cancelling it gives the place up.

        Parameters
        ----------
        account
            The client's.
        make
            As :data:`Work`.

        Raises
        ------
        Exception
            Whatever *make* raises.
        """
        done = asyncio.get_running_loop().create_future()

        def work() -> int | None:
            if done.done():
                return None
            try:
                cost = make()
            except Exception as error:  # noqa: BLE001 - handed to who asked for the turn
                done.set_exception(error)
                return 0
            done.set_result(None)
            return cost

        self.ask(account, work)
        if done.done():  # without a step of the loop
            done.result()
        else:
            await done

    def leave(self, account: Account) -> None:
        """Keep the account of a client that is gone, where it has used more than a new one."""
        if account.address is not None and (account.is_in_debt or self._waiting.is_behind(account)):
            self._left.append(account)

    def come(self, account: Account) -> None:
        """Let a new client go on with the account of one that left its address, if there is one.

        Else whoever comes anew for each landing has every time what newcomers have free.
        """
        for left in reversed(self._left):
            if left.address == account.address:
                account.go_on_from(left)
                self._left.remove(left)
                return

    def book(self, account: Account, began_s: float) -> None:
        """Book what was done for a client since then, in a turn or with what it brought.

        By the thread's own clock: what other programs took meanwhile is nobody's debt.
        """
        now_s, took_s = monotonic(), thread_time() - began_s
        if account.owe(took_s, now_s, _FREE_SHARE, _FREE_S):
            self._rests_until_s = now_s + took_s

    def _turn(self) -> None:
        self._running = False
        if not self._waiting:
            return
        rest_s = self._rests_until_s - monotonic()
        if rest_s > 0.0 and self._waiting.head.is_in_debt:
            if self._timer is None:
                self._timer = asyncio.get_running_loop().call_later(rest_s, self._go_on)
            return
        self._running = True
        try:
            while self._waiting and not self._do(*self._take()):
                pass  # given up
        finally:
            # Last: who is woken by it may ask for the next turn.
            asyncio.get_running_loop().call_soon(self._turn)

    def _go_on(self) -> None:
        self._timer = None
        if not self._running:
            self._turn()

    def _take(self) -> tuple[Account, Work]:
        account, work = self._waiting.take()
        self._of_address[account.address] -= 1
        if not self._of_address[account.address]:
            del self._of_address[account.address]
        return account, work

    def _do(self, account: Account, work: Work) -> bool:
        """Do it, where anybody wants it still, and have it paid for.

        As often as others of its address wait, too: eight of one have together what one has.
        """
        times = 1 if account.address is None else 1 + self._of_address[account.address]
        account.pay(times * LEAST_COST)  # also where it raises
        began_s = thread_time()
        cost = work()
        account.pay(times * (-LEAST_COST if cost is None else cost))
        if cost is None:
            return False
        self.book(account, began_s)
        return True
