"""The server's groups as the session corpus has them: one client's seat, and another member.

PURE: no clock, no chance.
"""

from __future__ import annotations

from typing import Any, Final

from terraport_server.groups.groups import Groups
from terraport_server.groups.state import GroupLimits, Place
from terraport_server.session.session import Session
from terraport_wire import Arrived, Gather, Join

__all__ = ["GROUP", "GroupHall"]

GROUP: Final = "tour"
"""Where the other member is."""
SCENE: Final = "toy"
OTHER: Final = "other"


class _Door:
    """One connection's way to the groups; see `terraport_server.session.interface.GroupPort`."""

    def __init__(self, groups: Groups, number: int) -> None:
        self._groups = groups
        self._number = number

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        secret = f"seat-{self._number}"
        return self._groups.join(
            self, SCENE, join, now_s, new_secret=secret, may_guide=True, place=place
        )

    def leave(self, now_s: float) -> None:
        self._groups.leave(self, now_s)

    def gather(self, gather: Gather, now_s: float) -> str | None:
        return self._groups.gather(self, gather, now_s)

    def arrived(self, arrived: Arrived) -> None:
        self._groups.arrived(self, arrived.gathering, arrived.state)

    def landed(self, place: Place, now_s: float) -> None:
        self._groups.landed(self, place, now_s)


class GroupHall:
    """All groups, over all connections of one client."""

    def __init__(self) -> None:
        self.groups = Groups(GroupLimits(group_absence_s=1.0, group_deadline_s=2.0))
        self._doors = 0
        self._door: _Door | None = None

    def door(self) -> _Door:
        """Return the way of a new connection."""
        self._doors += 1
        self._door = _Door(self.groups, self._doors)
        return self._door

    def lost(self, now_s: float) -> None:
        """Note that the connection is gone."""
        if self._door is not None:
            self.groups.lost(self._door, now_s)

    def hand_out(self, server: Session | None) -> None:
        """Tell the client's session what the groups have to say to it."""
        for key, message in self.groups.take_messages():
            if server is not None and key is self._door:
                server.tell_group(message)

    def other(self, now_s: float, what: str, *given: Any) -> None:
        """Let the other member do something; what it is refused does not matter."""
        groups = self.groups
        if what == "join":
            join = Join(request=1, group=GROUP, role=given[0], name="Ada")
            groups.join(OTHER, SCENE, join, now_s, new_secret="of-the-other", may_guide=True)
        elif what == "leave":
            groups.leave(OTHER, now_s)
        elif what == "gather":
            position, radius_m, inner_radius_m = given
            gather = Gather(
                request=2, position=position, radius_m=radius_m, inner_radius_m=inner_radius_m
            )
            groups.gather(OTHER, gather, now_s)
        elif what == "landed":
            groups.landed(OTHER, *given, now_s)
        else:
            groups.arrived(OTHER, *given)
