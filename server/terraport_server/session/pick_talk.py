"""One session's picks: how many are under way, and what the client is told of them.

PURE: no I/O, no clock. spec/wire-protocol.md, section 9.
"""

from __future__ import annotations

from terraport_server.session.actions import RunPick
from terraport_server.session.outbox import Outbox
from terraport_wire import ErrorCode, Hit, Pick, Picked

__all__ = ["INTERNAL_TEXT", "PickTalk"]

INTERNAL_TEXT = "the server failed; the operator's log has the reason"
"""All that a peer learns of an internal failure."""


class PickTalk:
    """Between a session and whoever answers its picks.

    Parameters
    ----------
    out
        The session's outbox.
    most
        Picks that may be under way at once.
    """

    def __init__(self, out: Outbox, most: int) -> None:
        self._out = out
        self._most = most
        self._under_way = 0

    def receive(self, pick: Pick) -> None:
        """Have a pick run, or say that there are too many."""
        if self._under_way >= self._most:
            text = f"got {self._under_way + 1} picks at once, expected at most {self._most}"
            self._out.error(ErrorCode.TOO_MANY, text, request=pick.request)
            return
        self._under_way += 1
        self._out.add(RunPick(pick.request, pick.origin, pick.direction))

    def picked(self, request: int, hit: Hit | None) -> None:
        """Answer a pick."""
        self._under_way -= 1
        if not self._out.closing:
            self._out.say(Picked(request=request, hit=hit))

    def failed(self, request: int) -> None:
        """Say that a pick could not be answered; the session goes on."""
        self._under_way -= 1
        if not self._out.closing:
            self._out.error(ErrorCode.INTERNAL, INTERNAL_TEXT, request=request)
