"""Data of groups: seats, group landings, limits.

PURE: no I/O, no clock, no randomness. The logic is in :mod:`terraport_server.groups.groups`.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from terraport_wire import Gather, Gathering, Member, Roster

__all__ = ["Barrier", "Group", "GroupLimits", "Place", "Seat"]

Place = tuple[float, float, float]
"""Centre of a member's newest landing: x, y, z in metres of the scene frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupLimits:
    """Limits of the groups of one process. Some are settings: docs/topics/settings.md."""

    max_groups: int = 64
    max_groups_per_client: int = 8
    """Maximum open groups created from one address with one token."""
    max_group_members: int = 32
    group_absence_s: float = 30.0
    """Seconds for which the seat of a lost connection is kept."""
    group_deadline_s: float = 60.0
    """Maximum and default seconds to wait for all members of a group landing."""


@dataclass(slots=True)
class Seat:
    """Membership in a group."""

    number: int
    secret: str
    name: str | None
    role: str
    key: Hashable | None
    """Key of the connection; None while it is lost."""
    owner: Hashable = None
    """Address and token of the client."""
    lost_s: float = 0.0
    """Time at which the connection was lost."""
    place: Place | None = None
    """Centre of the member's newest landing; None before the first."""


@dataclass(slots=True)
class Barrier:
    """State of a group landing: members wait until all are ready."""

    number: int
    guide: int
    gather: Gather
    deadline_s: float
    states: dict[int, str] = field(default_factory=dict)
    """Reported state of members by number."""
    is_open: bool = False
    """Whether ``gathered`` was sent: no member waits any more."""

    def gathering(self, now_s: float) -> Gathering:
        """Return the message that announces it, with the time left."""
        left_ms = None if self.is_open else max(0, round(1000.0 * (self.deadline_s - now_s)))
        return Gathering(
            gathering=self.number,
            guide=self.guide,
            position=self.gather.position,
            radius_m=self.gather.radius_m,
            inner_radius_m=self.gather.inner_radius_m,
            left_ms=left_ms,
        )


@dataclass(slots=True)
class Group:
    """Group of a scene; it ends with its last seat."""

    id: tuple[str, str]
    """Scene id and group name."""
    owner: Hashable = None
    """Address and token of the client that created it."""
    seats: dict[int, Seat] = field(default_factory=dict)
    """Seats by number, ascending."""
    newest: int = 0
    """Number of the newest seat."""
    barrier: Barrier | None = None
    roster_due_s: float | None = None
    """Time of the next roster; None: nothing changed."""
    roster_sent_s: float = float("-inf")
    gathering_due_s: float | None = None
    """Time of the next ``gathering``; None: it was sent."""
    gathering_sent_s: float = float("-inf")

    def seat_of(self, secret: str | None) -> Seat | None:
        """Return the seat with a secret; None if there is none."""
        if secret is None:
            return None
        # Timing reveals nothing useful: few seats, 128 random bits each.
        return next((seat for seat in self.seats.values() if seat.secret == secret), None)

    def roster(self) -> Roster:
        """Return the members and their positions; never a secret (10.1)."""
        members = tuple(
            Member(
                member=seat.number,
                name=seat.name,
                role=seat.role,
                present=seat.key is not None,
                position=seat.place,
            )
            for seat in self.seats.values()
        )
        return Roster(group=self.id[1], members=members)

    def due_s(self, absence_s: float) -> float | None:
        """Return the time of the next timer; None if there is none."""
        news = self.roster_due_s, self.gathering_due_s
        times = [due_s for due_s in news if due_s is not None]
        if self.barrier is not None and not self.barrier.is_open:
            times.append(self.barrier.deadline_s)
        times += [seat.lost_s + absence_s for seat in self.seats.values() if seat.key is None]
        return min(times) if times and self.seats else None

    @property
    def is_absent(self) -> bool:
        """Whether all seats are kept for lost connections."""
        return all(seat.key is None for seat in self.seats.values())
