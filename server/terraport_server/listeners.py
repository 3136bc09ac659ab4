"""Listening sockets for several workers behind one port.

On Linux each worker has a socket of its own (``SO_REUSEPORT``), among which the kernel deals new
connections by a hash of their addresses; elsewhere all share one. Either way the supervisor opens
and keeps them: what waits in a socket's queue while its worker is replaced is accepted by the
successor. Why, with figures: ``docs/decisions/0019-a-socket-for-each-worker.md``.
"""

from __future__ import annotations

import socket
import sys
from typing import Any, Final

from terraport_server.errors import ServerError

__all__ = ["Listeners"]

_BACKLOG: Final = 2048


class Listeners:
    """The sockets of all workers, on every address of a host and one port.

    Parameters
    ----------
    host, port
        Where; port 0 = any free one.
    slots
        Number of workers.

    Raises
    ------
    ServerError
        When an address cannot be had, also where another service listens there that would share.
    """

    def __init__(self, host: str, port: int, slots: int) -> None:
        self._is_dealt = sys.platform == "linux"
        self._addresses: list[tuple[int, str]] = []
        self._sockets: dict[int, list[socket.socket]] = {}
        self.port = port
        """The port, also where any free one was asked for."""
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
            for family, _, _, _, address in dict.fromkeys(found):
                # Not to be shared: a second service on this port must fail, not take half.
                with socket.create_server((str(address[0]), self.port), family=family) as probe:
                    self.port = probe.getsockname()[1]
                self._addresses.append((family, str(address[0])))
            for slot in range(slots):
                self.of(slot)
        except OSError:
            self.close()
            text = f"could not listen on {host}:{port}, expected a free address and port"
            raise ServerError(text) from None

    def of(self, slot: int) -> list[socket.socket]:
        """Return the sockets of one worker; opened again where they were given up.

        Raises
        ------
        OSError
            When they cannot be opened again.
        """
        slot = slot if self._is_dealt else 0
        if slot not in self._sockets:
            self._sockets[slot] = [self._open(*address) for address in self._addresses]
        return self._sockets[slot]

    def give_up(self, slot: int) -> None:
        """Let the other workers have what this one, which does not come up, would be dealt."""
        if self._is_dealt and len(self._sockets) > 1:
            for one in self._sockets.pop(slot, []):
                one.close()

    def close(self) -> None:
        """Listen no more."""
        for sockets in self._sockets.values():
            for one in sockets:
                one.close()
        self._sockets.clear()

    def _open(self, family: int, address: str) -> socket.socket:
        options: dict[str, Any] = {"reuse_port": True} if self._is_dealt else {}
        made = socket.create_server(
            (address, self.port), family=family, backlog=_BACKLOG, **options
        )
        made.setblocking(False)
        return made
