"""Connections of those who are not let in yet, and which of them goes where there is no room.

Any number of addresses may hold as many as each is allowed; together they would fill the service,
and nobody else came in. So the address that has most gives way, its oldest connection first: an
honest client has one or a few, and is past this within a round trip.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import Counter
from typing import Generic, TypeVar

__all__ = ["Strangers"]

P = TypeVar("P")


class Strangers(Generic[P]):
    """Connections by address, in the order of their coming, and the bytes that each has sent.

    What they sent is in memory until it is whole, understood and answered.

    Examples
    --------
    >>> strangers = Strangers[str]()
    >>> for peer, address in (("a1", "a"), ("b1", "b"), ("a2", "a")):
    ...     strangers.enter(peer, address)
    >>> strangers.in_the_way()
    'a1'
    """

    def __init__(self) -> None:
        # Invariant: _bytes_of[a] sums _of[a]'s values, total_bytes sums _bytes_of; no empty dicts.
        self._of: dict[str, dict[P, int]] = {}
        self._address: dict[P, str] = {}
        self._bytes_of: Counter[str] = Counter()
        self.total_bytes = 0

    def __len__(self) -> int:
        return len(self._address)

    def enter(self, peer: P, address: str) -> None:
        """Count a connection in."""
        self._address[peer] = address
        self._of.setdefault(address, {})[peer] = 0

    def weigh(self, peer: P, count: int) -> int:
        """Note that it sent so many bytes, or that fewer count; return those of its address.

        Nothing where it was counted out.
        """
        address = self._address.get(peer)
        if address is None:
            return 0
        self._of[address][peer] += count
        self._bytes_of[address] += count
        self.total_bytes += count
        return self._bytes_of[address]

    def leave(self, peer: P) -> None:
        """Count it out: it is let in, or gone; may be called again."""
        address = self._address.pop(peer, None)
        if address is None:
            return
        peers = self._of[address]
        count = peers.pop(peer)
        self._bytes_of[address] -= count
        self.total_bytes -= count
        if not peers:
            del self._of[address], self._bytes_of[address]

    def in_the_way(self) -> P | None:
        """Return the oldest connection of the address that has most; None where there is none."""
        if not self._of:
            return None
        crowd = max(self._of.values(), key=len)
        return next(iter(crowd))

    def heaviest(self) -> P | None:
        """Return the connection that sent most, of the address that sent most."""
        if not self._of:
            return None
        return self._heaviest_of(max(self._of, key=lambda address: self._bytes_of[address]))

    def heaviest_beside(self, peer: P) -> P | None:
        """Return the connection that sent most, of the same address; None where it left."""
        address = self._address.get(peer)
        return None if address is None else self._heaviest_of(address)

    def _heaviest_of(self, address: str) -> P:
        peers = self._of[address]
        return max(peers, key=lambda peer: peers[peer])
