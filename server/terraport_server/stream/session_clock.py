"""Tells one session the time, by a timer and no task: a task takes 2 KB of every session."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from time import monotonic
from typing import Final

from terraport_server.session.session import Session
from terraport_server.transport import Connection

__all__ = ["SessionClock"]

_SHORTEST_TICK_S: Final = 0.002


class SessionClock:
    """Ticks when something is due, and drops a client that takes too long to close.

    Parameters
    ----------
    session
    connection
        None where it cannot be reached.
    close_timeout_s
        What the client has once the session closes.
    wake
        Called after each tick: the session may want something.
    """

    __slots__ = (
        "_close_timeout_s", "_connection", "_due_s", "_leaves", "_session", "_timer", "_wake",
        "fault",
    )  # fmt: skip

    def __init__(
        self,
        session: Session,
        connection: Connection | None,
        close_timeout_s: float,
        wake: Callable[[], None],
    ) -> None:
        self._session = session
        self._connection = connection
        self._close_timeout_s = close_timeout_s
        self._wake = wake
        self._timer: asyncio.TimerHandle | None = None
        self._due_s = 0.0
        self._leaves = False
        """Whether the timer ends the connection."""
        self.fault: Exception | None = None
        """What a tick raised; the session ends with it."""

    def look(self) -> None:
        """Set the timer, where something is due sooner; or to the end, where the session closes."""
        if self._leaves:
            return
        now_s = monotonic()
        if self._session.closing or self.fault is not None:
            self._leaves = True
            due_s = now_s + self._close_timeout_s
        else:
            due_s = self._session.wake_at_s()
            if self._timer is not None and due_s >= self._due_s:
                return
        if self._timer is not None:
            self._timer.cancel()
        self._due_s = due_s
        wait_s = max(_SHORTEST_TICK_S, due_s - now_s)
        self._timer = asyncio.get_running_loop().call_later(wait_s, self._tick)

    def stop(self) -> None:
        """Tick no more, whatever is told to the session."""
        self._leaves = True
        self._wake = _nobody
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _tick(self) -> None:
        self._timer = None
        if self._leaves:
            if self._connection is not None:
                self._connection.abort()
            return
        if self._connection is not None:
            self._session.heard(self._connection.heard_s)
        try:
            self._session.tick(monotonic())
        except Exception as error:  # noqa: BLE001 - raised where the session's end is noted
            self.fault = error
        self._wake()
        self.look()


def _nobody() -> None:
    """Wake none: the session is over."""
