"""How much a client's socket may hold, by what its link carries.

What the kernel has taken cannot be taken back: on a link of 100 Mbit/s with 20 ms it takes 736 KiB,
and a newer landing waits behind them. What a link needs to stay busy is rate x round trip; a fixed
small buffer would be too small for one link and too large for the next. So the kernel's own
estimates of both (TCP_INFO) set the buffer's size while payload flows. On loopback and in a local
network, where the round trip is short, nothing is done; and nothing where it is long: there a
connection takes seconds to find its rate, and a buffer that is too small by then keeps it from it.

Measured: ``benchmarks/links.py --only supersede`` and ``--only wire``.
"""

from __future__ import annotations

import socket
import struct
from typing import Final

__all__ = ["LinkBuffer", "buffer_bytes"]

_TCP_INFO: Final = getattr(socket, "TCP_INFO", 11)
_MIN_RTT: Final = struct.Struct("@I")
_RATE: Final = struct.Struct("@Q")
_MIN_RTT_AT: Final = 148
_RATE_AT: Final = 160
_INFO_BYTES: Final = 168
"""Linux, struct tcp_info: tcpi_min_rtt (us) and tcpi_delivery_rate (bytes/s), since 4.9."""

_SHORTEST_RTT_US: Final = 2000
_LONGEST_RTT_US: Final = 50_000
_LEAST_BYTES: Final = 96 << 10
_MOST_BYTES: Final = 4 << 20
_SHARE: Final = 0.95
"""The kernel doubles what it is asked for; its own bookkeeping takes a part of that. So this holds
nearly twice rate x round trip: the estimate can grow where the link has more."""

_FIRST_LOOK_S: Final = 0.2
_FIRST_ROUND_TRIPS: Final = 10
"""Before that the rate is what the connection has found so far, not what the link carries."""
_LOOK_S: Final = 0.05
_REMEMBERED: Final = 10


def buffer_bytes(min_rtt_us: int, rate_bytes_per_s: float) -> int:
    """Return what to set SO_SNDBUF to; 0 = leave it."""
    if not _SHORTEST_RTT_US <= min_rtt_us <= _LONGEST_RTT_US or rate_bytes_per_s <= 0:
        return 0
    wanted = int(_SHARE * rate_bytes_per_s * min_rtt_us / 1e6)
    return max(_LEAST_BYTES, min(_MOST_BYTES, wanted))


class LinkBuffer:
    """Fits one socket's send buffer to its link.

    Parameters
    ----------
    raw
        The socket, or what stands for it.
    now_s
        When it begins to send.
    """

    __slots__ = ("_began_s", "_next_s", "_rates", "_raw", "_size")

    def __init__(self, raw: socket.socket, now_s: float) -> None:
        self._raw = raw
        self._began_s = now_s
        self._next_s = now_s + _FIRST_LOOK_S
        self._rates: list[int] = []
        self._size = 0

    def look(self, now_s: float) -> None:
        """Look at the link again, if it is time to; called while payload flows."""
        if now_s < self._next_s:
            return
        try:
            info = self._raw.getsockopt(socket.IPPROTO_TCP, _TCP_INFO, _INFO_BYTES)
        except OSError:
            self._next_s = float("inf")  # not on this system, or gone
            return
        if len(info) < _INFO_BYTES:
            self._next_s = float("inf")
            return
        min_rtt_us = _MIN_RTT.unpack_from(info, _MIN_RTT_AT)[0]
        if min_rtt_us < _SHORTEST_RTT_US:
            self._next_s = float("inf")  # the shortest round trip will not become longer
            return
        found_s = self._began_s + _FIRST_ROUND_TRIPS * min_rtt_us / 1e6
        self._next_s = max(found_s, now_s + max(_LOOK_S, min_rtt_us / 1e6))
        if now_s < found_s:
            return
        self._rates = [*self._rates[1 - _REMEMBERED :], _RATE.unpack_from(info, _RATE_AT)[0]]
        size = buffer_bytes(min_rtt_us, max(self._rates))
        if size and abs(size - self._size) > size // 8:
            self._size = size
            self._raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, size)
