"""Groups of one process, on its event loop: timers, secrets, and whom a message is for.

What a group is and does is decided in :mod:`terraport_server.groups.groups`.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Hashable
from typing import Final, Literal

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits, Place
from terraport_wire import Arrived, Gather, Join, Message

__all__ = ["GroupDesk", "GroupDoor"]

_SECRET_BYTES: Final = 16
"""128 bits, as the protocol asks (16.1)."""


class GroupDesk:
    """All groups of one process. Lives on one event loop.

    Parameters
    ----------
    limits
        Bounds.
    routing
        ``"query"``: a join counts only on a connection whose URL names the group, because several
        servers stand behind one address; ``"here"``: on any.
    """

    def __init__(self, limits: GroupLimits, routing: Literal["here", "query"]) -> None:
        self.groups = Groups(limits)
        """The state; to look at only."""
        self.changed: Callable[[frozenset[str]], None] | None = None
        """Told the names of all groups that have members, when one comes or goes."""
        self._routing = routing
        self._names: frozenset[str] = frozenset()
        self._timer: asyncio.TimerHandle | None = None
        self._due_s: float | None = None
        """When that fires; None = there is none."""

    def door(
        self,
        scene_id: str,
        named_by_url: str | None,
        *,
        may_guide: Callable[[], bool],
        deliver: Callable[[Message], None],
        owner: Callable[[], Hashable],
    ) -> GroupDoor:
        """Return one session's way to the groups.

        Parameters
        ----------
        scene_id
            Scene of the session.
        named_by_url
            Query parameter ``group`` of its connection.
        may_guide
            Asked when the client wants to be guide.
        deliver
            Takes messages for the client, on the event loop.
        owner
            Asked for the client's address and token when it joins.
        """
        return GroupDoor(
            self, scene_id, named_by_url, may_guide=may_guide, deliver=deliver, owner=owner
        )

    def refusal(self, join: Join, named_by_url: str | None) -> str | None:
        """Return why a connection with such a URL does not come to that group."""
        if named_by_url is None and self._routing == "query":
            return "got join on a connection whose URL names no group, expected ?group=NAME in it"
        if named_by_url is not None and named_by_url != join.group:
            return "got join of another group than the connection's URL names, expected that one"
        return None

    def hand_out(self) -> None:
        """Deliver what the groups have to say, and see to it that time is looked at."""
        for door, message in self.groups.take_messages():
            assert isinstance(door, GroupDoor)  # the keys that doors pass are themselves
            door.deliver(message)
        if self.changed is not None and (names := self.groups.names) is not self._names:
            self._names = names
            self.changed(names)
        due_s = self.groups.wake_at_s()
        if due_s == self._due_s:
            return
        if self._timer is not None:
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        self._due_s = due_s
        self._timer = None if due_s is None else loop.call_at(due_s, self._tick)

    def stop(self) -> None:
        """Let no timer outlive the service."""
        if self._timer is not None:
            self._timer.cancel()

    def _tick(self) -> None:
        self._timer = self._due_s = None
        self.groups.tick(asyncio.get_running_loop().time())
        self.hand_out()


class GroupDoor:
    """One session's way to the groups: ``GroupPort`` of its :class:`Session`."""

    def __init__(
        self,
        desk: GroupDesk,
        scene_id: str,
        named_by_url: str | None,
        *,
        may_guide: Callable[[], bool],
        deliver: Callable[[Message], None],
        owner: Callable[[], Hashable],
    ) -> None:
        self._desk = desk
        self._scene_id = scene_id
        self._named_by_url = named_by_url
        self._may_guide = may_guide
        self._owner = owner
        self.deliver = deliver

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        """Take a seat, standing at that place if at any; return why not."""
        refusal = self._desk.refusal(join, self._named_by_url)
        if refusal is None:
            refusal = self._desk.groups.join(
                self,
                self._scene_id,
                join,
                now_s,
                new_secret=secrets.token_urlsafe(_SECRET_BYTES),
                may_guide=self._may_guide(),
                owner=self._owner(),
                place=place,
            )
            self._desk.hand_out()
        return refusal

    def leave(self, now_s: float) -> None:
        """Give up the seat, if there is one."""
        self._desk.groups.leave(self, now_s)
        self._desk.hand_out()

    def gather(self, gather: Gather, now_s: float) -> str | None:
        """Land the group; return why not."""
        refusal = self._desk.groups.gather(self, gather, now_s)
        self._desk.hand_out()
        return refusal

    def arrived(self, arrived: Arrived) -> None:
        """Note that this member's part of a group landing is over."""
        self._desk.groups.arrived(self, arrived.gathering, arrived.state)
        self._desk.hand_out()

    def landed(self, place: Place, now_s: float) -> None:
        """Note where the client lands; nothing where it has no seat."""
        self._desk.groups.landed(self, place, now_s)
        self._desk.hand_out()

    def close(self, now_s: float) -> None:
        """Note that the connection is gone; the seat is kept for a while."""
        self._desk.groups.lost(self, now_s)
        self._desk.hand_out()
