"""Whose turn is next, where a turn costs what it turns out to cost: the one's that has used least.

PURE: no I/O, no clock.

References
----------
P. Goyal, H. M. Vin, H. Cheng, "Start-time fair queueing", SIGCOMM 1996: an entry's *start* is the
asker's *finish* of before, or where the queue is now if that is later; the earliest start goes
first. The cost may be unknown until it is paid.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Generic, TypeVar

__all__ = ["Account", "PricedQueue"]

T = TypeVar("T")


class Account:
    """What one client has used of one queue."""

    __slots__ = ("_debt_s", "_owed_s", "address", "finish", "is_in_debt")

    def __init__(self) -> None:
        self.finish = 0.0
        """On the queue's scale."""
        self.address: str | None = None
        """What it is counted under with others who come from there; None: with nobody."""
        self.is_in_debt = False
        """Whether it had taken more time than is free, when it last took some."""
        self._debt_s = 0.0
        self._owed_s = 0.0
        """When that was looked at."""

    def pay(self, cost: float) -> None:
        """Book what a turn cost."""
        self.finish += cost

    def go_on_from(self, other: Account) -> None:
        """Have used, and owe, what another account has and does."""
        self.finish, self.is_in_debt = other.finish, other.is_in_debt
        self._debt_s, self._owed_s = other._debt_s, other._owed_s

    def owe(self, took_s: float, now_s: float, free_share: float, free_s: float) -> bool:
        """Book the time that a turn took; return whether it is more than is free by now.

        A share of all time is free, and so much at once.
        """
        earned_s = free_share * (now_s - self._owed_s)
        self._debt_s = max(0.0, self._debt_s - earned_s) + took_s
        self._owed_s, self.is_in_debt = now_s, self._debt_s > free_s
        return self.is_in_debt


class PricedQueue(Generic[T]):
    """Entries of clients, each of whom has an account. Idle time earns so much and no more.

    It is as long as what was put in; the caller bounds that.

    Parameters
    ----------
    lead : float
        Cost that whoever asked for little has free: so far his start may lie before the newest
        turn's. Without it, each of several turns that are taken one after the other waits until
        all who ask without end have had one.

    Examples
    --------
    >>> queue, wide, narrow = PricedQueue[str](), Account(), Account()
    >>> for account, item in ((wide, "w1"), (narrow, "n1")):
    ...     queue.add(account, item)
    >>> account, item = queue.take()
    >>> account.pay(10), queue.add(account, "w2")
    (None, None)
    >>> [queue.take()[1] for _ in range(len(queue))]
    ['n1', 'w2']
    """

    def __init__(self, lead: float = 0.0) -> None:
        self._lead = lead
        self._entries: list[tuple[float, float, int, Account, T]] = []
        self._number = 0
        """Of equal starts the one that has used less goes first, then the one that asked first."""
        self._now = 0.0
        """Latest start of a turn."""

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, account: Account, item: T) -> None:
        """Put an entry in; an account may have several."""
        start = max(self._now - self._lead, account.finish)
        self._number += 1
        heappush(self._entries, (start, account.finish, self._number, account, item))

    def take(self) -> tuple[Account, T]:
        """Take the next entry out; whose it is pays for it afterwards.

        Raises
        ------
        IndexError
            When there is none.
        """
        while True:
            start, _, number, account, item = heappop(self._entries)
            if start >= account.finish:
                self._now, account.finish = max(self._now, start), start
                return account, item
            # Its account has paid for another since: it goes where it would be put in now.
            entry = (account.finish, account.finish, number, account, item)
            heappush(self._entries, entry)

    @property
    def head(self) -> Account:
        """Whose turn is next as things stand; IndexError where nobody waits.

        It may turn out to be another's, where that account has paid since it was put in.
        """
        return self._entries[0][3]

    def is_behind(self, account: Account) -> bool:
        """Return whether an account has used more than a new one would start with."""
        return account.finish > self._now - self._lead

    def skip(self, account: Account) -> None:
        """Note that an account's turn is now, where nobody waits."""
        account.finish = max(self._now - self._lead, account.finish)
        self._now = max(self._now, account.finish)
