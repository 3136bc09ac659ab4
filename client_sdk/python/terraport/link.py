"""Connection of a session, with reconnecting.

Everything here runs on one event loop; the state is :class:`terraport.core.SessionCore`'s.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
import ssl
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import (
    ConnectionClosed,
    InvalidHandshake,
    InvalidStatus,
    InvalidURI,
)
from websockets.typing import Subprotocol

from terraport.address import Access
from terraport.backoff import Pacer, is_temporary, wait_s, why_unreached
from terraport.core import SessionCore
from terraport.errors import (
    ConnectionFailedError,
    ProtocolViolationError,
    ServerError,
    SessionClosedError,
    TerraportError,
)
from terraport.events import Event, Opened, Refused, Shown
from terraport.options import Timeouts
from terraport_wire import MAX_SERVER_MESSAGE_BYTES, SUBPROTOCOL, CloseCode, ErrorCode, Notice

__all__ = ["Link"]

_AIM_PERIOD_S: Final = 0.1
"""Between two aims: a hand moves faster, but ten plans a second are enough to prefetch by."""
_STABLE_S: Final = 10.0
"""A connection that lived this long, or readied a landing, begins the waits anew when it is
lost."""
_ABNORMAL: Final = 1006
_HTTP_TO_CLOSE: Final = 4000

_log = logging.getLogger("terraport")


@dataclass(frozen=True, slots=True)
class _Lost:
    """Why one connection, or the attempt to make it, has ended."""

    cause: str
    temporary: bool
    error: TerraportError | None = None
    """What to raise where it is final."""
    draining: bool = False
    """The service itself says that it goes away: another one is about to answer."""


class Link:
    """Keeps one session connected. The owner runs :meth:`run` as a task and awaits it.

    Parameters
    ----------
    core : SessionCore
        The state; commands may be given to it at any time, followed by :meth:`pump`.
    url : str
        ``ws(s)://.../stream``.
    access : Access
        Token of each connection.
    timeouts : Timeouts
        Of these: connect_s, reconnect_s, close_s.
    handle : callable
        Takes every event, in order, on the event loop.
    prepare : callable
        Awaited after each welcome, before anything else is read from the connection.
    """

    def __init__(
        self,
        core: SessionCore,
        url: str,
        access: Access,
        timeouts: Timeouts,
        handle: Callable[[Event], None],
        prepare: Callable[[], Awaitable[None]],
    ) -> None:
        self.connections = 0
        """Connections that the server welcomed."""
        self.received_bytes = 0
        """Bytes of WebSocket messages received, payload and headers, over all connections."""
        self.heard_s = 0.0
        """When the newest of them came, on the monotonic clock."""
        self._core = core
        self._url = url
        self._access = access
        self._timeouts = timeouts
        self._handle = handle
        self._prepare = prepare
        self._is_prepared = False
        self._wake = asyncio.Event()
        self._welcomed = asyncio.Event()
        self._leaving = False
        self._attempt = 0
        self._first_wait_s: float | None = None
        self._refusal: Refused | None = None
        self.group: str | None = None
        """Group that the URL names from the next connection on, for proxies that route by it."""
        self._rerouting = False
        self._websocket: ClientConnection | None = None
        self._pacer = Pacer(1.0, now_s=time.monotonic())
        self._next_aim_s = 0.0

    def pump(self) -> None:
        """Hand out events and let the writer send; to be called after every command."""
        for event in self._core.events():
            self._note(event)
            self._handle(event)
        self._wake.set()

    def leave(self) -> None:
        """Send ``bye`` and do not reconnect."""
        self._leaving = True
        self._core.bye()
        self.pump()

    def reroute(self, group: str) -> None:
        """Reconnect immediately, by a URL that names a group."""
        self.group = group
        self._rerouting = True
        if self._websocket is not None:
            self._websocket.transport.abort()

    async def run(self) -> None:
        """Connect, and connect again, until :meth:`leave` or a failure that is final.

        Raises
        ------
        ServerError
            The server refuses, and would again.
        ConnectionFailedError
            The first attempt failed, other than by a service that drains (that is tried again for
            ``connect_s``), or ``reconnect_s`` ran out.
        ProtocolViolationError
            The server broke the protocol.
        """
        lost_at_s = 0.0
        replaced = False
        while True:
            began_s = time.monotonic()
            self._welcomed.clear()
            self._is_prepared = False
            lost = await self._converse()
            now_s = time.monotonic()
            if self._welcomed.is_set() and now_s - began_s >= _STABLE_S:
                self._attempt = 0
            self._core.connection_lost()
            self.pump()
            if self._leaving:
                return
            if self._rerouting:
                self._rerouting = False
                continue
            final = not lost.temporary and not self._has_newer_token(lost)
            if final and lost.error is not None:
                raise lost.error
            if self._attempt == 0:
                lost_at_s = now_s
            pause_s = self._pause_s()
            self._attempt += 1
            limit_s = self._timeouts.reconnect_s
            waited_s = now_s + pause_s - lost_at_s
            late = limit_s is not None and waited_s > limit_s
            # A first connection that fails is not tried again, as the address may be wrong; but one
            # where a service drains is right: the next is about to be there.
            replaced = replaced or lost.draining
            late_for_first = waited_s > (self._timeouts.connect_s or math.inf)
            if late or (self.connections == 0 and (late_for_first or not replaced)):
                raise lost.error or ConnectionFailedError(self._url, self._attempt, lost.cause)
            _log.info("connection lost (%s), next attempt in %.1f s", lost.cause, pause_s)
            await asyncio.sleep(pause_s)

    def _has_newer_token(self, lost: _Lost) -> bool:
        """Return whether the token was refused and the token function now returns another one.

        Only after a first welcome: a service that never knew the token needs no second attempt.
        """
        refused = isinstance(lost.error, ServerError) and lost.error.code == ErrorCode.UNAUTHORISED
        return refused and self.connections > 0 and self._access.has_newer()

    def _pause_s(self) -> float:
        """Return how long to wait before the next attempt."""
        if self._first_wait_s is not None:
            pause_s, self._first_wait_s = self._first_wait_s, None
            return pause_s
        return wait_s(self._attempt, random.random)

    async def _converse(self) -> _Lost:
        """Run one connection."""
        self._refusal = None
        core, timeouts = self._core, self._timeouts
        try:
            async with asyncio.timeout(timeouts.connect_s):
                websocket = await connect(
                    self._url if self.group is None else f"{self._url}?group={self.group}",
                    subprotocols=[Subprotocol(SUBPROTOCOL)],
                    additional_headers=self._access.headers(),
                    user_agent_header=core.options.client,
                    compression=None,
                    max_size=MAX_SERVER_MESSAGE_BYTES,
                    open_timeout=None,
                    close_timeout=timeouts.close_s,
                )
        except (OSError, TimeoutError, InvalidHandshake, InvalidURI, EOFError) as error:
            return _lost_before(error)
        core.connected()
        self.pump()
        self._websocket = websocket
        writer = asyncio.create_task(self._write(websocket), name="terraport-writer")
        patience = asyncio.create_task(self._expect_welcome(websocket), name="terraport-welcome")
        try:
            return await self._read(websocket)
        finally:
            self._websocket = None
            for task in (writer, patience):
                task.cancel()
            await asyncio.gather(writer, patience, return_exceptions=True)
            await websocket.close()

    async def _read(self, websocket: ClientConnection) -> _Lost:
        try:
            while True:
                data = await websocket.recv()
                self.received_bytes += len(data)
                self.heard_s = time.monotonic()
                self._core.receive(data)
                self.pump()
                if self._welcomed.is_set() and not self._is_prepared:
                    self._is_prepared = True
                    await self._prepare()
        except ConnectionClosed as error:
            return self._lost_by(error)
        except ProtocolViolationError as error:
            self.pump()
            await websocket.close(CloseCode.MALFORMED, "malformed")
            return _Lost(str(error), temporary=False, error=error)

    async def _write(self, websocket: ClientConnection) -> None:
        """Send the session's messages within the server's message rate."""
        try:
            while True:
                await self._wake_or_aim()
                if self._core.has_aim and time.monotonic() >= self._next_aim_s:
                    self._next_aim_s = time.monotonic() + _AIM_PERIOD_S
                    self._core.flush_aim()
                for data in self._core.data_to_send():
                    pause_s = self._pacer.take(time.monotonic())
                    if pause_s > 0:
                        await asyncio.sleep(pause_s)
                    await websocket.send(data)
                if self._core.sent():
                    self.pump()
                if self._leaving:
                    await websocket.close()  # behind bye; does not wait for the server's own close
        except ConnectionClosed:
            return  # the reader learns the same, with the reason

    async def _wake_or_aim(self) -> None:
        """Wait for something to send, at most until the next aim may go."""
        pause_s = None
        if self._core.has_aim:
            pause_s = max(0.0, self._next_aim_s - time.monotonic())
        try:
            async with asyncio.timeout(pause_s):
                await self._wake.wait()
        except TimeoutError:
            return
        self._wake.clear()

    async def _expect_welcome(self, websocket: ClientConnection) -> None:
        """Close a connection on which no welcome comes."""
        try:
            async with asyncio.timeout(self._timeouts.connect_s):
                await self._welcomed.wait()
        except TimeoutError:
            await websocket.close(CloseCode.TIMEOUT, "no welcome")

    def _note(self, event: Event) -> None:
        """Take what concerns the connection itself."""
        if isinstance(event, Opened):
            self.connections += 1
            self._welcomed.set()
            self._pacer = Pacer(event.limits.max_messages_per_s, now_s=time.monotonic())
        elif isinstance(event, Shown):
            self._attempt = 0
        elif isinstance(event, Refused) and event.fatal:
            self._refusal = event
        elif isinstance(event, Notice) and event.reconnect_after_ms is not None:
            self._first_wait_s = event.reconnect_after_ms / 1000.0

    def _lost_by(self, closed: ConnectionClosed) -> _Lost:
        code = _ABNORMAL if closed.rcvd is None else closed.rcvd.code
        reason = "" if closed.rcvd is None else closed.rcvd.reason
        if self._refusal is not None:
            refusal = ServerError(self._refusal.code, self._refusal.message, fatal=True)
            draining = refusal.code == ErrorCode.DRAINING
            return _Lost(str(refusal), is_temporary(code), refusal, draining)
        text = reason or str(closed)
        if code == CloseCode.NORMAL:
            ended = SessionClosedError("the server ended it")
            return _Lost(text, temporary=False, error=ended)
        if is_temporary(code):
            return _Lost(text, temporary=True, draining=code == CloseCode.DRAINING)
        return _Lost(text, temporary=False, error=_refused(code, text))


def _lost_before(error: Exception) -> _Lost:
    """Return why no connection came about."""
    if isinstance(error, InvalidStatus):
        status = error.response.status_code
        temporary = status >= 500 or status in {408, 425, 429}
        refusal = _refused(_HTTP_TO_CLOSE + status, f"HTTP status {status}")
        return _Lost(str(refusal), temporary=temporary, error=refusal)
    text = why_unreached(error)
    if isinstance(error, ssl.SSLCertVerificationError | InvalidURI):
        final = ConnectionFailedError("the server", 1, text)
        return _Lost(text, temporary=False, error=final)
    return _Lost(text, temporary=True)


def _refused(close_code: int, text: str) -> ServerError:
    """Return the error of a close code without an error message before it."""
    try:
        code = CloseCode(close_code).name.lower()
    except ValueError:
        code = f"close_{close_code}"
    return ServerError(code, text, fatal=True)
