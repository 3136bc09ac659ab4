"""State machine of groups: members, group landings, and arrivals.

PURE: no I/O, no clock, no randomness; times are seconds on one monotonic clock of the caller.
Section numbers in comments are those of spec/protocol.md.

The caller identifies each connection by a key, calls :meth:`Groups.join` and the other methods, and
then delivers the messages that :meth:`Groups.take_messages` returns. Timeouts are handled by
:meth:`Groups.tick`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_server.groups.state import Barrier, Group, GroupLimits, Place, Seat
from terraport_wire import (
    Gather,
    Gathered,
    Join,
    Joined,
    Message,
)

__all__ = ["Groups"]

_NEWS_PERIOD_S: Final = 0.25
"""Minimum seconds between two rosters and between two gatherings of a group: members that join and
leave repeatedly cause at most four messages per second to each other member."""

_POSITIONS_PERIOD_S: Final = 1.0
"""Minimum seconds to a roster in which only positions changed (10.4)."""


class Groups:
    """All groups of one process.

    Parameters
    ----------
    limits
        Limits.
    """

    def __init__(self, limits: GroupLimits) -> None:
        self._limits = limits
        self._groups: dict[tuple[str, str], Group] = {}
        self._memberships: dict[Hashable, tuple[tuple[str, str], int]] = {}
        """Group id and seat number by connection."""
        self._messages: list[tuple[Hashable, Message]] = []
        self._due_s: dict[tuple[str, str], float] = {}
        """Time of the next timer of each group that has one, so that a message of one member does
        not require a loop over the seats of all groups."""

    @property
    def group_count(self) -> int:
        """Number of groups."""
        return len(self._groups)

    @property
    def member_count(self) -> int:
        """Number of seats of all groups, including those of lost connections."""
        return sum(len(group.seats) for group in self._groups.values())

    def take_messages(self) -> list[tuple[Hashable, Message]]:
        """Return, once, the messages to deliver, each with the key of its connection."""
        messages, self._messages = self._messages, []
        return messages

    def wake_at_s(self) -> float | None:
        """Return the time at which :meth:`tick` must be called; None: never."""
        return min(self._due_s.values(), default=None)

    def join(
        self,
        key: Hashable,
        scene_id: str,
        join: Join,
        now_s: float,
        *,
        new_secret: str,
        may_guide: bool,
        owner: Hashable = None,
        place: Place | None = None,
    ) -> str | None:
        """Take a new seat, or again a kept one (10.1); return the reason of a refusal.

        At a limit, groups and seats kept for lost connections are removed first.

        Parameters
        ----------
        key
            Key of the connection.
        scene_id
            Scene of the session; a group belongs to one scene.
        join
            The request.
        now_s
            Current time.
        new_secret
            Secret of a new seat; at least 128 random bits.
        may_guide
            Whether the client may be the guide.
        owner
            Address and token of the client; its groups and lost seats are counted together.
        place
            Centre of the connection's newest landing, in metres of the scene frame; None before
            its first landing: a kept seat then keeps its position.

        Notes
        -----
        Invariant: a connection has one seat at most, a seat one connection at most, and
        ``_memberships`` is the inverse of the seats' keys.
        """
        # Find the seat of the secret, else check that a new one is allowed.
        group_id = (scene_id, join.group)
        group = self._groups.get(group_id)
        seat = None if group is None else group.seat_of(join.seat)
        if seat is None or self._memberships.get(key) != (group_id, seat.number):
            if seat is None:
                refusal = self._refusal(key, group_id, join, owner, may_guide=may_guide)
                if refusal is not None:
                    return refusal
                self._make_room(key, group_id, owner, now_s)
            self.leave(key, now_s)
        # Assign the seat to the connection.
        if group_id not in self._groups:
            self._groups[group_id] = Group(group_id, owner)
        group = self._groups[group_id]
        if seat is None:
            group.newest += 1
            seat = Seat(group.newest, new_secret, join.name, join.role, key, owner)
            group.seats[seat.number] = seat
        elif seat.key is not None and seat.key != key:
            del self._memberships[seat.key]  # the old connection is dead, but not closed yet
        seat.key = key
        if place is not None:
            seat.place = place
        self._memberships[key] = (group_id, seat.number)
        # Order: joined, roster, gathering.
        self._messages.append(
            (
                key,
                Joined(
                    request=join.request,
                    group=join.group,
                    member=seat.number,
                    role=seat.role,
                    seat=seat.secret,
                ),
            )
        )
        self._changed(group, now_s)
        if group.barrier is not None:
            self._messages.append((key, group.barrier.gathering(now_s)))
        self._update_timer(group)
        return None

    def leave(self, key: Hashable, now_s: float) -> None:
        """Leave the group, if the connection is in one."""
        membership = self._find(key)
        if membership is not None:
            self._remove(*membership, now_s)

    def lost(self, key: Hashable, now_s: float) -> None:
        """Record a lost connection; its seat is kept for ``group_absence_s``."""
        membership = self._find(key)
        if membership is not None:
            group, seat = membership
            del self._memberships[key]
            seat.key, seat.lost_s = None, now_s
            self._changed(group, now_s)
            self._update_timer(group)

    def gather(self, key: Hashable, gather: Gather, now_s: float) -> str | None:
        """Start a group landing (10.2); return the reason of a refusal."""
        membership = self._find(key)
        if membership is None:
            return "got gather without a seat in a group, expected join first"
        group, seat = membership
        if seat.role != "guide":
            return f"got gather from a {seat.role}, expected it from the guide"
        most_s = self._limits.group_deadline_s
        wait_s = most_s if gather.deadline_ms is None else min(most_s, gather.deadline_ms / 1000.0)
        number = 1 if group.barrier is None else group.barrier.number + 1
        group.barrier = Barrier(number, seat.number, gather, now_s + wait_s)
        group.gathering_due_s = max(now_s, group.gathering_sent_s + _NEWS_PERIOD_S)
        if group.gathering_due_s <= now_s:
            self._send_gathering(group, now_s)
        self._update_timer(group)
        return None

    def arrived(self, key: Hashable, number: int, state: str) -> None:
        """Record a member's state in a group landing; ignored once that is over (10.2)."""
        membership = self._find(key)
        if membership is None:
            return
        group, seat = membership
        barrier = group.barrier
        if barrier is not None and barrier.number == number and not barrier.is_open:
            barrier.states[seat.number] = state
            self._open_if_complete(group)

    def landed(self, key: Hashable, place: Place, now_s: float) -> None:
        """Record a member's position and send it to the others within a second (10.1, 10.4)."""
        membership = self._find(key)
        if membership is None or membership[1].place == place:
            return
        group, seat = membership
        seat.place = place
        self._changed(group, now_s, period_s=_POSITIONS_PERIOD_S)
        self._update_timer(group)

    def tick(self, now_s: float) -> None:
        """Handle timers: lost seats, deadlines, rosters."""
        for group in [self._groups[key] for key, due_s in self._due_s.items() if due_s <= now_s]:
            for seat in list(group.seats.values()):
                if seat.key is None and now_s >= seat.lost_s + self._limits.group_absence_s:
                    self._remove(group, seat, now_s)
            barrier = group.barrier
            is_late = barrier is not None and now_s >= barrier.deadline_s
            if group.gathering_due_s is not None and (is_late or now_s >= group.gathering_due_s):
                self._send_gathering(group, now_s)
                self._open_if_complete(group)
            if barrier is not None and is_late and not barrier.is_open:
                self._open(group, barrier)
            if group.roster_due_s is not None and now_s >= group.roster_due_s:
                self._send_roster(group, now_s)
            self._update_timer(group)

    def _refusal(
        self,
        key: Hashable,
        group_id: tuple[str, str],
        join: Join,
        owner: Hashable,
        *,
        may_guide: bool,
    ) -> str | None:
        """Return the reason why a new seat is refused.

        The seat of this key is not counted, nor are seats that `_make_room` can remove.
        """
        limits, group = self._limits, self._groups.get(group_id)
        own = self._find(key)
        if join.role == "guide" and not may_guide:
            return "got role guide with a token that does not allow it, expected role member"
        if group is None:
            present = [one for one in self._staying_groups(key) if not one.is_absent]
            most, of_owner = limits.max_groups, limits.max_groups_per_client
            if len(present) >= most:
                return f"got a new group, expected at most {most} on this server"
            if sum(one.owner == owner for one in present) >= of_owner:
                return f"got a new group, expected at most {of_owner} of one address and token"
            return None
        others = [seat for seat in group.seats.values() if own is None or seat is not own[1]]
        if join.role == "guide" and any(seat.role == "guide" for seat in others):
            return "got role guide in a group that has one, expected role member"
        if sum(seat.key is not None for seat in others) >= limits.max_group_members:
            most = limits.max_group_members
            return f"got member {len(others) + 1} of the group, expected at most {most}"
        return None

    def _staying_groups(self, key: Hashable) -> list[Group]:
        """Return the groups without one that this connection alone is in, oldest first."""
        own = self._find(key)
        left = own[0] if own is not None and len(own[0].seats) == 1 else None
        return [group for group in self._groups.values() if group is not left]

    def _make_room(
        self, key: Hashable, group_id: tuple[str, str], owner: Hashable, now_s: float
    ) -> None:
        """Remove a group or seat kept for lost connections if a new seat needs the room.

        The oldest one of the owner that has most of them, so that a client which connects
        repeatedly loses its own.
        """
        limits, group = self._limits, self._groups.get(group_id)
        if group is None:
            staying = self._staying_groups(key)
            absent = [one for one in staying if one.is_absent]
            own = [one for one in absent if one.owner == owner]
            if own and sum(one.owner == owner for one in staying) >= limits.max_groups_per_client:
                self._dissolve(own[0], now_s)
            elif len(staying) >= limits.max_groups:
                count = Counter(one.owner for one in absent)
                self._dissolve(max(absent, key=lambda one: count[one.owner]), now_s)
            return
        holder = self._find(key)
        others = [seat for seat in group.seats.values() if holder is None or seat is not holder[1]]
        if len(others) >= limits.max_group_members:
            lost = [seat for seat in others if seat.key is None]
            of_owner = Counter(seat.owner for seat in lost)
            self._remove(
                group, max(lost, key=lambda seat: (of_owner[seat.owner], -seat.lost_s)), now_s
            )

    def _dissolve(self, group: Group, now_s: float) -> None:
        for seat in list(group.seats.values()):
            self._remove(group, seat, now_s)

    def _find(self, key: Hashable) -> tuple[Group, Seat] | None:
        membership = self._memberships.get(key)
        if membership is None:
            return None
        group_id, number = membership
        group = self._groups[group_id]
        return group, group.seats[number]

    def _remove(self, group: Group, seat: Seat, now_s: float) -> None:
        del group.seats[seat.number]
        if seat.key is not None:
            del self._memberships[seat.key]
        if not group.seats:
            del self._groups[group.id]
            self._update_timer(group)
            return
        if group.barrier is not None:
            group.barrier.states.pop(seat.number, None)
        self._changed(group, now_s)
        self._open_if_complete(group)
        self._update_timer(group)

    def _open_if_complete(self, group: Group) -> None:
        """End a group landing if all members are ready or declined (10.3)."""
        barrier = group.barrier
        if group.gathering_due_s is not None:
            return  # gathering must be sent before gathered
        if barrier is not None and not barrier.is_open:
            states = [barrier.states.get(number) for number in group.seats]
            if all(state in {"ready", "declined"} for state in states):
                self._open(group, barrier)
                self._update_timer(group)

    def _open(self, group: Group, barrier: Barrier) -> None:
        barrier.is_open = True
        by_state: dict[str, list[int]] = {"ready": [], "degraded": [], "missing": []}
        for number in group.seats:
            state = barrier.states.get(number)
            by_state[state if state in {"ready", "degraded"} else "missing"].append(number)
        message = Gathered(
            gathering=barrier.number,
            ready=_ids(by_state["ready"]),
            degraded=_ids(by_state["degraded"]),
            missing=_ids(by_state["missing"]),
        )
        self._send(group, message)

    def _changed(self, group: Group, now_s: float, *, period_s: float = _NEWS_PERIOD_S) -> None:
        """Send a roster, now or when the period allows."""
        due_s = max(now_s, group.roster_sent_s + period_s)
        if due_s <= now_s:
            self._send_roster(group, now_s)
        elif group.roster_due_s is None or due_s < group.roster_due_s:
            group.roster_due_s = due_s

    def _send_gathering(self, group: Group, now_s: float) -> None:
        assert group.barrier is not None
        group.gathering_due_s, group.gathering_sent_s = None, now_s
        self._send(group, group.barrier.gathering(now_s))

    def _send_roster(self, group: Group, now_s: float) -> None:
        group.roster_due_s, group.roster_sent_s = None, now_s
        self._send(group, group.roster())

    def _update_timer(self, group: Group) -> None:
        """Update the next timer of a group."""
        due_s = group.due_s(self._limits.group_absence_s)
        if due_s is None:
            self._due_s.pop(group.id, None)
        else:
            self._due_s[group.id] = due_s

    def _send(self, group: Group, message: Message) -> None:
        self._messages += [
            (seat.key, message) for seat in group.seats.values() if seat.key is not None
        ]


def _ids(numbers: list[int]) -> AnyArray:
    return np.array(numbers, dtype=np.uint32)
