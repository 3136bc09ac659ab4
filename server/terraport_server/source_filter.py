"""Addresses from which the kernel takes no new connection, for a while.

Who was told often enough to go is told by closing what he opens, and that costs the event loop 50
to 100 us each time: ten addresses that come 1,000 times a second take the whole of it. On Linux a
listening socket may carry a program that looks at whatever opens a connection; what it refuses is
dropped before there is anything to accept. The other side waits and tries again, as with a host
that is away. Elsewhere, and where the system allows no such program, nothing is dropped.

References
----------
S. McCanne, V. Jacobson, "The BSD Packet Filter", USENIX Winter 1993; its instructions and
``SO_ATTACH_FILTER`` as in Linux, Documentation/networking/filter.rst and linux/filter.h.
"""

from __future__ import annotations

import contextlib
import ctypes
import ipaddress
import socket
import struct
import sys
from collections.abc import Iterable
from typing import Final

__all__ = ["MOST_SOURCES", "SourceFilter", "filter_program"]

MOST_SOURCES: Final = 128
"""Dropped at once; whoever is one too many is closed as before. Of IPv6 five instructions each, of
4,096 that a program may have."""

_ATTACH_FILTER: Final = 26
_DETACH_FILTER: Final = 27
"""SO_ATTACH_FILTER and SO_DETACH_FILTER; Python names neither."""

_IS_LINUX: Final = sys.platform == "linux"

_IP_HEADER: Final = 0xFFF0_0000
"""SKF_NET_OFF: from here on positions count from the IP header; without it, from TCP's."""
_V4_SOURCE: Final = _IP_HEADER + 12
_V6_SOURCE: Final = _IP_HEADER + 8

_LOAD_WORD: Final = 0x20
_LOAD_BYTE: Final = 0x30
_SHIFT_RIGHT: Final = 0x74
_JUMP: Final = 0x05
_JUMP_IF_EQUAL: Final = 0x15
_RETURN: Final = 0x06


def filter_program(sources: Iterable[str]) -> bytes:
    """Write the program that drops what comes from these sources.

    Parameters
    ----------
    sources
        As :func:`client_addresses.client_key` has them: an address of IPv4, or the first 64 bits
        of one of IPv6.

    Returns
    -------
    bytes
        Instructions of 8 bytes: code (u16), where to go if so and if not (u8, instructions to
        skip), operand (u32); in the machine's byte order.

    Raises
    ------
    ValueError
        One that is neither.
    """
    v4, v6 = [], []
    for source in sources:
        network = ipaddress.ip_network(source)
        if isinstance(network, ipaddress.IPv4Network):
            v4.append(int(network.network_address))
        else:
            bits = int(network.network_address) >> 64
            v6.append((bits >> 32, bits & 0xFFFF_FFFF))
    of_v4 = [_step(_LOAD_WORD, _V4_SOURCE)]
    for word in v4:
        of_v4 += [_step(_JUMP_IF_EQUAL, word, 0, 1), _step(_RETURN, 0)]
    of_v4.append(_step(_RETURN, 0xFFFF_FFFF))  # all of it is let through
    of_v6 = []
    for first, second in v6:
        of_v6 += [
            _step(_LOAD_WORD, _V6_SOURCE),
            _step(_JUMP_IF_EQUAL, first, 0, 3),
            _step(_LOAD_WORD, _V6_SOURCE + 4),
            _step(_JUMP_IF_EQUAL, second, 0, 1),
            _step(_RETURN, 0),
        ]
    of_v6.append(_step(_RETURN, 0xFFFF_FFFF))
    version = [
        _step(_LOAD_BYTE, _IP_HEADER),
        _step(_SHIFT_RIGHT, 4),
        _step(_JUMP_IF_EQUAL, 4, 1, 0),
        _step(_JUMP, len(of_v4)),  # over what is for version 4: further than a condition reaches
    ]
    return b"".join((*version, *of_v4, *of_v6))


def _step(code: int, operand: int, if_so: int = 0, if_not: int = 0) -> bytes:
    return struct.pack("=HBBI", code, if_so, if_not, operand)


class SourceFilter:
    """What one listening socket drops. A program stays with the socket, whoever has it.

    Parameters
    ----------
    listener
        A program that it has already, of a worker that is gone, is taken off.
    """

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._sources: dict[str, float] = {}
        """And until when; of the caller's clock."""
        self._detach(listener)

    def __contains__(self, source: str) -> bool:
        return source in self._sources

    def drop(self, source: str, until_s: float) -> bool:
        """Drop what comes from there until then, where the system can; return whether it does."""
        if not _IS_LINUX or len(self._sources) >= MOST_SOURCES:
            return False
        self._sources[source] = until_s
        if self._attach():
            return True
        self.clear()  # or those of the program before would be dropped for ever
        return False

    def lift(self, now_s: float) -> float | None:
        """Let those in again whose time is over; return when the next one's is, or None."""
        kept = {source: until_s for source, until_s in self._sources.items() if until_s > now_s}
        if len(kept) != len(self._sources):
            self._sources = kept
            if not (kept and self._attach()):
                self.clear()
        return min(self._sources.values(), default=None)

    def clear(self) -> None:
        """Drop nothing any more."""
        self._sources.clear()
        self._detach(self._listener)

    def let_go(self, connection: socket.socket) -> None:
        """Take the program off a connection that was accepted: it came with it."""
        if self._sources:
            self._detach(connection)

    def _attach(self) -> bool:
        try:
            program = filter_program(self._sources)
            kept = ctypes.create_string_buffer(program)  # copied by the kernel within the call
            option = struct.pack("HP", len(program) // 8, ctypes.addressof(kept))
            self._listener.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, option)
        except (OSError, ValueError):
            return False
        return True

    @staticmethod
    def _detach(of: socket.socket) -> None:
        if _IS_LINUX:
            with contextlib.suppress(OSError):  # there is none
                of.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)
