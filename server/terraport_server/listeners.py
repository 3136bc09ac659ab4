"""Listening sockets behind one port, for one worker or for several.

They are opened before anybody is told the address: what is said of a port is true. On Linux each of
several workers has a socket of its own (``SO_REUSEPORT``), among which the kernel deals new
connections by a hash of their addresses; elsewhere all share one. Either way the supervisor opens
and keeps them, and every worker inherits all: what waits in a socket's queue while its worker is
replaced, dead or hangs is accepted by the others. Why, with figures:
``docs/decisions/0019-a-socket-for-each-worker.md``, ``0047-who-takes-over-for-a-dead-worker.md``.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import sys
from typing import Any, Final

from terraport_server.errors import ServerError
from terraport_server.port_holder import port_holder

__all__ = ["Listeners", "host_in_url"]

_BACKLOG: Final = 2048

_RECEIVE_BUFFER_BYTES: Final = 64 << 10
"""SO_RCVBUF of what is accepted: what the kernel keeps for a connection that is not read, and so
what one read brings. By itself it lets a client send megabytes ahead; ours send little."""

_NEAR_PORTS: Final = 20
"""Ports above a taken one that are tried before a free one is named: near numbers are kept in
mind more easily."""

_NO_FAMILY: Final = (errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL)
"""What a machine without IPv6 answers for the ``::1`` of a name like localhost."""


def host_in_url(host: str) -> str:
    """Write a host as addresses have it: IPv6 in brackets.

    Examples
    --------
    >>> host_in_url("::1"), host_in_url("pit.example")
    ('[::1]', 'pit.example')
    """
    return f"[{host}]" if ":" in host else host


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
        When an address cannot be had, also where another service listens there that would share:
        which, why, and for a taken port who holds it, where that can be told, and one that is free.
    """

    def __init__(self, host: str, port: int, slots: int) -> None:
        self.is_dealt = slots > 1 and sys.platform == "linux"
        """Whether each worker has sockets of its own."""
        self._sockets: list[list[socket.socket]] = []
        self.port = port
        """The port, also where any free one was asked for."""
        try:
            addresses, self.port = _probe(host, port)
            for _ in range(slots if self.is_dealt else 1):
                self._sockets.append([self._open(*address) for address in addresses])
        except OSError as error:
            self.close()
            raise ServerError(_refusal(host, port, error)) from None

    def of(self, slot: int) -> list[socket.socket]:
        """Return the sockets of one worker."""
        return self._sockets[slot if self.is_dealt else 0]

    def close(self) -> None:
        """Listen no more."""
        for sockets in self._sockets:
            for one in sockets:
                one.close()
        self._sockets.clear()

    def _open(self, family: int, address: str) -> socket.socket:
        options: dict[str, Any] = {"reuse_port": True} if self.is_dealt else {}
        listener = socket.create_server(
            (address, self.port), family=family, backlog=_BACKLOG, **options
        )
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        listener.setblocking(False)
        return listener


def _probe(host: str, port: int) -> tuple[list[tuple[int, str]], int]:
    """Take a port on every address of a host, without sharing, and let it go again.

    Without sharing: a second service on this port must fail, not take half.

    Returns
    -------
    addresses : list of (int, str)
        Family and address of each that this machine has.
    port : int
        The port, also where any free one was asked for.

    Raises
    ------
    OSError
        When it is taken, or there is no such address here.
    """
    candidates = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    addresses: list[tuple[int, str]] = []
    absent: OSError | None = None
    for family, _, _, _, address in dict.fromkeys(candidates):
        try:
            with socket.create_server((str(address[0]), port), family=family) as probe:
                port = probe.getsockname()[1]
        except OSError as error:
            if error.errno not in _NO_FAMILY:
                raise
            absent = error
        else:
            addresses.append((family, str(address[0])))
    if absent is not None and not addresses:
        raise absent
    return addresses, port


def _refusal(host: str, port: int, error: OSError) -> str:
    """Say which address cannot be had, why, and what to do."""
    text = f"could not listen on {host_in_url(host)}:{port}"
    if error.errno == errno.EADDRINUSE:
        free = _free_port(host, port)
        advice = "--port 0 for any free one" if free is None else f"--port {free}, which is free"
        holder = port_holder(port) or "another program"
        return f"{text}: {holder} does; stop it, or choose another port: {advice}"
    if error.errno == errno.EACCES:
        return f"{text}: not allowed; expected a port from 1024 on, or the right to use lower ones"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        what = "expected an address or a name of this machine, e.g. 127.0.0.1, or 0.0.0.0 for all"
        return f"{text}: {error.strerror}; {what}"
    return f"{text}: {error.strerror or error}; expected a free address and port"


def _free_port(host: str, port: int) -> int | None:
    """Find a port that is free now, near by if there is one."""
    near = range(port + 1, min(port + 1 + _NEAR_PORTS, 65_536))
    for candidate in (*near, 0):
        with contextlib.suppress(OSError):
            return _probe(host, candidate)[1]
    return None
