"""Group membership of a client: its seat, the group's state, and open requests.

PURE: no I/O, no clock. ``spec/protocol.md``, section 10.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from terraport.events import Event, GroupRefused
from terraport.options import checked, point
from terraport_wire import (
    Arrived,
    Error,
    Gather,
    Gathered,
    Gathering,
    Join,
    Joined,
    Leave,
    Message,
    Roster,
)

__all__ = ["Seat"]

_MOST_GATHERS: Final = 16
"""Maximum unanswered gathers; then the oldest is refused by the client."""


class Seat:
    """The seat of one session, over all its connections. Not thread-safe.

    Parameters
    ----------
    say : callable
        Takes messages to send; called only while the connection is open.
    report : callable
        Takes events.
    is_open : callable
        Whether the server has said welcome on the present connection.
    take_request : callable
        Returns a new request number.
    """

    def __init__(
        self,
        *,
        say: Callable[[Message], None],
        report: Callable[[Event], None],
        is_open: Callable[[], bool],
        take_request: Callable[[], int],
    ) -> None:
        self._say = say
        self._report = report
        self._is_open = is_open
        self._take_request = take_request
        self._join: Join | None = None
        self._seated = False
        self._gathers: dict[int, Gather] = {}
        self._newest = 0
        self._arrived: Arrived | None = None

    def join(self, group: str, role: str, name: str | None = None) -> int:
        """Ask for a seat; the one held before is left. Return the request's number in the events.

        Raises
        ------
        UsageError
            A name or role that the protocol does not allow.
        """
        join = checked(lambda: Join(request=0, group=group, role=role, name=name))
        self.leave()  # also where the new seat is refused: the caller has given the old one up
        self._join = join = replace(join, request=self._take_request())
        if self._is_open():
            self._say(join)
        return join.request

    def leave(self) -> None:
        """Give the seat up."""
        if self._join is not None and self._is_open():
            self._say(Leave())
        self._reset()

    def gather(
        self,
        position: Sequence[float],
        radius_m: float,
        *,
        inner_radius_m: float | None = None,
        deadline_ms: int | None = None,
    ) -> int:
        """Land the group, now or as soon as the seat is taken again; return the request's number.

        Raises
        ------
        UsageError
            A number that the protocol does not allow.
        """
        gather = checked(
            lambda: Gather(
                request=0,
                position=point(position),
                radius_m=radius_m,
                inner_radius_m=inner_radius_m,
                deadline_ms=deadline_ms,
            )
        )
        request = self._take_request()
        self._gathers[request] = gather = replace(gather, request=request)
        if len(self._gathers) > _MOST_GATHERS:
            oldest = next(iter(self._gathers))
            del self._gathers[oldest]
            text = f"{_MOST_GATHERS} gathers wait for an answer already"
            self._report(GroupRefused(oldest, "too_many", text))
        if self._seated:
            self._say(gather)
        return request

    def arrived(self, gathering: int, state: str) -> None:
        """Say that this member's part is over, and again where a lost connection cut it off."""
        arrived = checked(lambda: Arrived(gathering=gathering, state=state))
        if gathering != self._newest:
            return  # a newer one has come: nobody waits for this one
        self._arrived = arrived
        if self._seated:
            self._say(arrived)

    def connected(self, groups: str | None) -> None:
        """Take the seat again, on a connection that is open; `groups` is what its limits say."""
        join = self._join
        if join is None:
            return
        if groups in {"here", "query"}:
            self._say(join)
            return
        self._reset()
        text = "no groups are served at this address"
        self._report(GroupRefused(join.request, "group_refused", text))

    def connection_lost(self) -> None:
        """Note that the connection is gone; the seat is taken again on the next one."""
        self._seated = False

    def refused(self, error: Error) -> bool:
        """Take an error; return whether it was one of a group's."""
        request = error.request
        if request is None:
            return False
        if self._join is not None and request == self._join.request:
            self._reset()
        elif self._gathers.pop(request, None) is None:
            return False
        self._report(GroupRefused(request, error.code, error.message))
        return True

    def receive(self, message: Message) -> None:
        """Take a message of the group; skip others, and what crossed a leave."""
        join = self._join
        if join is None:
            return
        if isinstance(message, Joined):
            if message.request == join.request:
                self._on_joined(message, join)
        elif not self._seated:
            return
        elif isinstance(message, Roster) and message.group == join.group:
            self._report(message)
        elif isinstance(message, Gathering):
            self._on_gathering(message)
        elif isinstance(message, Gathered) and message.gathering == self._newest:
            self._report(message)

    def _on_joined(self, joined: Joined, join: Join) -> None:
        self._seated = True
        if joined.seat != join.seat:
            # A new seat, perhaps on a new server: its gatherings count from 1 again.
            self._newest, self._arrived = 0, None
        self._join = Join(
            request=join.request,
            group=join.group,
            role=join.role,
            name=join.name,
            seat=joined.seat,
        )
        self._report(joined)
        # What was asked while the connection was away.
        for gather in self._gathers.values():
            self._say(gather)

    def _on_gathering(self, message: Gathering) -> None:
        # The guide's own request is answered by its gathering: requests are answered in order.
        if message.gathering == self._newest:
            if self._arrived is not None and message.left_ms is not None:
                self._say(self._arrived)
            return
        self._newest, self._arrived = message.gathering, None
        self._gathers.clear()
        self._report(message)

    def _reset(self) -> None:
        self._join, self._seated = None, False
        self._gathers.clear()
        self._newest, self._arrived = 0, None
