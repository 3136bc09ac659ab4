"""Groups on the event loop: timers, seat secrets, delivery of messages.

The logic is in :mod:`terraport_server.groups.groups`.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Hashable
from typing import Final, Literal

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits, Place
from terraport_wire import Arrived, Gather, Join, Message

__all__ = ["GroupHub", "GroupMember"]

_SECRET_BYTES: Final = 16
"""128 bits, as the protocol requires (10.1)."""


class GroupHub:
    """All groups of one process, on one event loop.

    Parameters
    ----------
    limits
        Limits.
    routing
        ``"query"``: join is allowed only on a connection whose URL names the group, because a proxy
        routes by it; ``"here"``: on any connection.
    """

    def __init__(self, limits: GroupLimits, routing: Literal["here", "query"]) -> None:
        self.groups = Groups(limits)
        """State machine; read-only."""
        self._routing = routing
        self._timer: asyncio.TimerHandle | None = None
        self._due_s: float | None = None
        """Time of the timer; None: there is none."""

    def member(
        self,
        scene_id: str,
        named_by_url: str | None,
        *,
        may_guide: Callable[[], bool],
        deliver: Callable[[Message], None],
        owner: Callable[[], Hashable],
    ) -> GroupMember:
        """Return the access of one session to the groups.

        Parameters
        ----------
        scene_id
            Scene of the session.
        named_by_url
            Query parameter ``group`` of its connection.
        may_guide
            Returns whether the client may be the guide.
        deliver
            Called on the event loop with messages for the client.
        owner
            Returns the client's address and token.
        """
        return GroupMember(
            self, scene_id, named_by_url, may_guide=may_guide, deliver=deliver, owner=owner
        )

    def refusal(self, join: Join, named_by_url: str | None) -> str | None:
        """Return the reason why a connection with this URL may not join the group."""
        if named_by_url is None and self._routing == "query":
            return "got join on a connection whose URL names no group, expected ?group=NAME in it"
        if named_by_url is not None and named_by_url != join.group:
            return "got join of another group than the connection's URL names, expected that one"
        return None

    def deliver(self) -> None:
        """Deliver pending messages and set the timer."""
        for member, message in self.groups.take_messages():
            assert isinstance(member, GroupMember)
            member.deliver(message)
        due_s = self.groups.wake_at_s()
        if due_s == self._due_s:
            return
        if self._timer is not None:
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        self._due_s = due_s
        self._timer = None if due_s is None else loop.call_at(due_s, self._tick)

    def stop(self) -> None:
        """Cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()

    def _tick(self) -> None:
        self._timer = self._due_s = None
        self.groups.tick(asyncio.get_running_loop().time())
        self.deliver()


class GroupMember:
    """Access of one session to the groups: the ``GroupPort`` of its :class:`Session`."""

    def __init__(
        self,
        hub: GroupHub,
        scene_id: str,
        named_by_url: str | None,
        *,
        may_guide: Callable[[], bool],
        deliver: Callable[[Message], None],
        owner: Callable[[], Hashable],
    ) -> None:
        self._hub = hub
        self._scene_id = scene_id
        self._named_by_url = named_by_url
        self._may_guide = may_guide
        self._owner = owner
        self.deliver = deliver

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        """Join a group; return the reason of a refusal."""
        refusal = self._hub.refusal(join, self._named_by_url)
        if refusal is None:
            refusal = self._hub.groups.join(
                self,
                self._scene_id,
                join,
                now_s,
                new_secret=secrets.token_urlsafe(_SECRET_BYTES),
                may_guide=self._may_guide(),
                owner=self._owner(),
                place=place,
            )
            self._hub.deliver()
        return refusal

    def leave(self, now_s: float) -> None:
        """Leave the group, if the session is in one."""
        self._hub.groups.leave(self, now_s)
        self._hub.deliver()

    def gather(self, gather: Gather, now_s: float) -> str | None:
        """Start a group landing; return the reason of a refusal."""
        refusal = self._hub.groups.gather(self, gather, now_s)
        self._hub.deliver()
        return refusal

    def arrived(self, arrived: Arrived) -> None:
        """Record that this member finished its part of a group landing."""
        self._hub.groups.arrived(self, arrived.gathering, arrived.state)
        self._hub.deliver()

    def landed(self, place: Place, now_s: float) -> None:
        """Record the centre of the client's newest landing."""
        self._hub.groups.landed(self, place, now_s)
        self._hub.deliver()

    def close(self, now_s: float) -> None:
        """Record that the connection is lost; its seat is kept for a while."""
        self._hub.groups.lost(self, now_s)
        self._hub.deliver()
