"""How many connections each address has open, whatever they are used for.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from functools import lru_cache
from typing import Final

__all__ = ["ARRIVALS_S", "ClientAddresses", "client_key", "too_many_of_address"]

ARRIVALS_S: Final = 10.0
"""Arrivals of an address are counted for so long, then from zero again."""

_REMEMBERED: Final = 1024
"""Addresses that are not parsed again: twice for each connection, that was a tenth of its cost."""

_LONGEST_REMEMBERED: Final = 64
"""Characters: an address of IPv6 may end in the name of a network, of any length."""


class ClientAddresses:
    """Counts the open connections of each address, trusted proxies left out.

    Parameters
    ----------
    trusted
        Addresses and networks, comma-separated, as uvicorn's ``forwarded_allow_ips``; "*" = all.
    """

    def __init__(self, trusted: str) -> None:
        self._open: Counter[str] = Counter()
        self._arrived: Counter[str] = Counter()
        self._in_vain: Counter[str] = Counter()
        self._window_ends_s = 0.0
        self._all = "*" in trusted
        self._networks = []
        for word in trusted.split(","):
            try:
                self._networks.append(ipaddress.ip_network(word.strip(), strict=False))
            except ValueError:
                continue  # a name, or a path of a Unix socket: uvicorn compares those itself

    def counted(self, host: str | None) -> str | None:
        """Return what to count a peer under; ``None`` for a proxy, which speaks for many."""
        if host is None or self._all:
            return None
        try:
            address = _parsed(host)
        except ValueError:
            return None
        return None if any(address in network for network in self._networks) else _key(address)

    def enter(self, key: str) -> int:
        """Count a connection of an address in; return how many it has open now."""
        self._open[key] += 1
        return self._open[key]

    def open_of(self, key: str) -> int:
        """Return how many connections an address has open."""
        return self._open[key]

    def arrive(self, key: str, now_s: float) -> int:
        """Count an arrival; return how many there were in this window of `ARRIVALS_S`.

        Who opens and closes at once is never there, and costs a handshake each time.
        """
        self._look_at_clock(now_s)
        self._arrived[key] += 1
        return self._arrived[key]

    def arrived(self, key: str, now_s: float) -> tuple[int, float]:
        """Return how many there were in this window, and when it ends."""
        self._look_at_clock(now_s)
        return self._arrived[key], self._window_ends_s

    def came_in_vain(self, key: str, now_s: float) -> None:
        """Note that a connection ended which was never let in and got nothing but refusals."""
        self._look_at_clock(now_s)
        self._in_vain[key] += 1

    def in_vain(self, key: str, now_s: float) -> int:
        """Return how many did, in this window of `ARRIVALS_S`."""
        self._look_at_clock(now_s)
        return self._in_vain[key]

    def leave(self, key: str) -> None:
        """Count a connection of an address out."""
        self._open[key] -= 1
        if self._open[key] <= 0:
            del self._open[key]

    def _look_at_clock(self, now_s: float) -> None:
        if now_s >= self._window_ends_s:
            self._arrived.clear()
            self._in_vain.clear()
            self._window_ends_s = now_s + ARRIVALS_S


def client_key(host: str) -> str:
    """Return what a client is counted under: its address, of IPv6 the first 64 bits.

    Whoever has one address of IPv6 has 2^64 of them.

    Examples
    --------
    >>> client_key("2001:db8::17"), client_key("::ffff:192.0.2.1"), client_key("somewhere")
    ('2001:db8::/64', '192.0.2.1', 'somewhere')
    """
    try:
        return _key(_parsed(host))
    except ValueError:
        return host


def too_many_of_address(count: int, most: int) -> str:
    """Return what a connection beyond the bound is told."""
    return f"got connection {count} of one address, expected at most {most}"


_Address = ipaddress.IPv4Address | ipaddress.IPv6Address


def _parsed(host: str) -> _Address:
    return _remembered(host) if len(host) <= _LONGEST_REMEMBERED else _address(host)


@lru_cache(_REMEMBERED)
def _remembered(host: str) -> _Address:
    return _address(host)


def _address(host: str) -> _Address:
    address = ipaddress.ip_address(host)
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return address if mapped is None else mapped


def _key(address: _Address) -> str:
    if isinstance(address, ipaddress.IPv6Address):
        return f"{ipaddress.IPv6Address(int(address) >> 64 << 64)}/64"
    return str(address)
