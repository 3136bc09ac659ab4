"""How many connections each address has open, whatever they are used for.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from typing import Final

__all__ = ["ARRIVALS_S", "ClientAddresses", "too_many_of_address"]

ARRIVALS_S: Final = 10.0
"""Arrivals of an address are counted for so long, then from zero again."""


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
            address = ipaddress.ip_address(host)
        except ValueError:
            return None
        return None if any(address in network for network in self._networks) else host

    def enter(self, key: str) -> int:
        """Count a connection of an address in; return how many it has open now."""
        self._open[key] += 1
        return self._open[key]

    def arrive(self, key: str, now_s: float) -> int:
        """Count an arrival; return how many there were in this window of `ARRIVALS_S`.

        Who opens and closes at once is never there, and costs a handshake each time.
        """
        if now_s >= self._window_ends_s:
            self._arrived.clear()
            self._window_ends_s = now_s + ARRIVALS_S
        self._arrived[key] += 1
        return self._arrived[key]

    def leave(self, key: str) -> None:
        """Count a connection of an address out."""
        self._open[key] -= 1
        if self._open[key] <= 0:
            del self._open[key]


def too_many_of_address(count: int, most: int) -> str:
    """Return what a connection beyond the bound is told."""
    return f"got connection {count} of one address, expected at most {most}"
