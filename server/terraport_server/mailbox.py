"""Connections that go from one process to another, whole: an open socket and what was read of it.

A pair of sockets of sequenced packets between a worker and its supervisor: each packet is one
connection, its socket as ancillary data (``SCM_RIGHTS``), its address and the bytes as the rest.
Linux alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

__all__ = ["MAX_HEAD_BYTES", "Mailbox", "Parcel", "mailbox_pair"]

MAX_HEAD_BYTES: Final = 128 << 10
"""Of a request that is passed on; a packet must fit into the socket's buffer as it stands."""

_BUFFER_BYTES: Final = 4 * MAX_HEAD_BYTES
_MAX_PACKET_BYTES: Final = MAX_HEAD_BYTES + 1024
_AT_ONCE: Final = 64
"""Packets taken before others of the loop have their turn."""


@dataclass(frozen=True, slots=True)
class Parcel:
    """A connection under way; whoever gets it closes `connection`."""

    group: str
    head: bytes
    """The request, to be read again."""
    connection: socket.socket


def mailbox_pair() -> tuple[socket.socket, socket.socket]:
    """Return both ends of a mailbox; neither blocks."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setblocking(False)
        with contextlib.suppress(OSError):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
    return ends


class Mailbox:
    """One end. Lives on one event loop.

    Parameters
    ----------
    end
        Of :func:`mailbox_pair`; closed with the mailbox.
    received
        Takes each parcel, and owns its socket.
    """

    def __init__(self, end: socket.socket, received: Callable[[Parcel], None]) -> None:
        self._end = end
        self._received = received
        self._loop = asyncio.get_running_loop()
        self._is_open = True
        self._loop.add_reader(end.fileno(), self._take)

    def send(self, group: str, head: bytes, descriptor: int) -> bool:
        """Send a connection; the descriptor stays the caller's. Never waits.

        Returns
        -------
        bool
            False where it did not go: the other end is gone, does not read, or the head is longer
            than `MAX_HEAD_BYTES`.
        """
        if not self._is_open or len(head) > MAX_HEAD_BYTES:
            return False
        try:
            socket.send_fds(self._end, [json.dumps(group).encode() + b"\n", head], [descriptor])
        except OSError:  # BlockingIOError: it does not read; the others: it is gone
            return False
        return True

    def close(self) -> None:
        """Take nothing more; may be called again."""
        if self._is_open:
            self._is_open = False
            self._loop.remove_reader(self._end.fileno())
            self._end.close()

    def _take(self) -> None:
        for _ in range(_AT_ONCE):
            if not self._is_open:
                return
            try:
                packet, descriptors, _, _ = socket.recv_fds(self._end, _MAX_PACKET_BYTES, 1)
            except BlockingIOError:
                return
            except OSError:
                self.close()
                return
            if not packet:
                self.close()
                return
            if descriptors:
                group, _, head = packet.partition(b"\n")
                # Python 3.11 passes no flags on, MSG_CMSG_CLOEXEC neither.
                os.set_inheritable(descriptors[0], False)
                connection = socket.socket(fileno=descriptors[0])
                self._received(Parcel(json.loads(group), head, connection))
