"""Where connections are accepted: a few in a step of the loop, and who is turned away cheaply.

The event loop's own servers accept whatever waits in one step, and make transport and protocol for
each: a flood of connections kept everybody else waiting for as long as 2,048 of them take, 0.1 to
0.2 ms each. Here whoever is turned away unheard costs an accept and a close, and whoever is not
gets them when it is his turn among strangers. A TLS handshake counts for its address from the
beginning, takes the same turns, and has come for nothing where it fails.
"""

from __future__ import annotations

import asyncio
import functools
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, cast

from terraport_server.entrance import PROXIES, Entrance
from terraport_server.source_filter import SourceFilter

if TYPE_CHECKING:
    from terraport_server.secure_context import SecureContext

__all__ = ["Doorway"]

_ACCEPTED_AT_ONCE: Final = 16
_LET_IN_AT_ONCE: Final = 8
"""Of them: each then waits for its turn among strangers, to get a transport and a protocol."""

_PAUSE_S: Final = 0.1
"""Until it is tried again where no descriptor was left."""


class Doorway:
    """Accepts from one listening socket, which is closed with it; in the form of a server.

    Parameters
    ----------
    listener
        Not blocking.
    make_connection
        Makes the protocol of a connection.
    entrance
        Says who is turned away.
    refused
        Told reason, text and client of each who is.
    tls
        Spoken with everybody, if given.
    handshake_timeout_s
        Of TLS.
    max_coming
        TLS handshakes under way; for one more the address with most of them gives one up.
    """

    def __init__(
        self,
        listener: socket.socket,
        make_connection: Callable[[], asyncio.BaseProtocol],
        entrance: Entrance,
        refused: Callable[[str, str, str], None],
        *,
        tls: SecureContext | None,
        handshake_timeout_s: float,
        max_coming: int,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._make_connection = make_connection
        self._entrance = entrance
        self._refused = refused
        self._tls = tls
        self._timeout_s = handshake_timeout_s
        self._max_coming = max_coming
        self._dropped = SourceFilter(listener)
        """Who came so often that he is not even turned away any more."""
        self._lifting: asyncio.TimerHandle | None = None
        self._coming: dict[asyncio.Task[None], str | None] = {}
        """And what each that can be given up counts under; the oldest first."""
        self._accepting = self._loop.create_task(self._accept())

    def close(self) -> None:
        """Accept no more; may be called again."""
        self._accepting.cancel()
        if self._lifting is not None:
            self._lifting.cancel()
        self._dropped.clear()  # the socket may be another process's, too
        self._listener.close()

    async def wait_closed(self) -> None:
        """Wait for those who are on their way in."""
        if self._coming:
            await asyncio.wait(self._coming)

    async def _accept(self) -> None:
        """Accept until cancelled."""
        while True:
            try:
                self._greet(*await self._loop.sock_accept(self._listener))
                self._greet_waiting()
            except BlockingIOError:
                continue  # nobody else waits
            except ConnectionError:
                continue  # who waited is gone
            except OSError:  # no file descriptor is free
                if not (self._entrance.make_room() or self._make_room(None)):
                    await asyncio.sleep(_PAUSE_S)
            await asyncio.sleep(0)

    def _greet_waiting(self) -> None:
        most_coming = len(self._coming) + _LET_IN_AT_ONCE
        for _ in range(_ACCEPTED_AT_ONCE):
            self._greet(*self._listener.accept())
            if len(self._coming) >= most_coming:
                return

    def _greet(self, connection: socket.socket, address: Any) -> None:
        """Turn somebody away, or begin to let him in."""
        host = str(address[0])
        key = self._entrance.addresses.counted(host)
        refused = None if key is None else self._entrance.turns_away(key, self._loop.time())
        if refused is None and len(self._coming) >= self._max_coming and not self._make_room(key):
            refused = f"got more than {self._max_coming} connections that are not made yet"
        if refused is not None:
            connection.close()
            self._refused("connections", refused, host)
            if key is not None:
                self._drop_where_often(key)
            return
        self._dropped.let_go(connection)
        task = self._loop.create_task(self._let_in(connection, key))
        self._coming[task] = key
        task.add_done_callback(self._coming.pop)

    def _drop_where_often(self, key: str) -> None:
        """Have the kernel drop what else comes of an address that is turned away until a time."""
        until_s = self._entrance.turned_away_until(key, self._loop.time())
        if until_s is None or key in self._dropped or not self._dropped.drop(key, until_s):
            return
        if self._lifting is None:
            self._lifting = self._loop.call_at(until_s, self._lift)

    def _lift(self) -> None:
        next_s = self._dropped.lift(self._loop.time())
        self._lifting = None if next_s is None else self._loop.call_at(next_s, self._lift)

    def _make_room(self, key: str | None) -> bool:
        """End the oldest handshake of the address that has most, unless that is this one."""
        heaviest = self._entrance.heaviest_coming()
        if heaviest is None or heaviest == key:
            return False
        for task, of_address in self._coming.items():
            if of_address == heaviest and not task.cancelling():
                task.cancel()
                return True
        return False

    async def _let_in(self, connection: socket.socket, key: str | None) -> None:
        connection.setblocking(False)
        try:
            with self._entrance.coming(key):
                if self._tls is None:
                    if key is not None:
                        await self._entrance.turn(key)
                    # Given up from here on, uvloop's transport would end without telling the
                    # protocol, which counts already: for ever.
                    self._coming[cast("asyncio.Task[None]", asyncio.current_task())] = None
                    await self._loop.connect_accepted_socket(self._make_connection, connection)
                else:
                    turns = functools.partial(self._entrance.wait, key or PROXIES)
                    make, timeout_s = self._make_connection, self._timeout_s
                    await self._tls.accept(connection, make, timeout_s, turns)
        except asyncio.CancelledError:  # to make room
            connection.close()
            raise
        except OSError:  # gone, or no TLS
            connection.close()
            if key is not None:
                self._entrance.addresses.came_in_vain(key, self._loop.time())
