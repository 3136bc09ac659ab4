"""What groups consist of: seats, barriers, and their bounds.

PURE: no I/O, no clock, no randomness. What becomes of them: :mod:`terraport_server.groups.groups`.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from terraport_wire import Gather, Gathering, Member, Roster

__all__ = ["Barrier", "Group", "GroupLimits", "Place", "Seat"]

Place = tuple[float, float, float]
"""Where somebody stands: x, y, z in metres of the scene frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupLimits:
    """Bounds of all groups of one process. Every field is a setting; see docs/topics/limits.md."""

    max_groups: int = 64
    max_groups_per_client: int = 8
    """Groups that exist and were begun from one address with one token."""
    max_group_members: int = 32
    group_absence_s: float = 30.0
    """How long the seat of a lost connection is kept."""
    group_deadline_s: float = 60.0
    """Longest that a barrier stays shut, and the default where the guide names none."""


@dataclass(slots=True)
class Seat:
    """One member of a group."""

    number: int
    secret: str
    name: str | None
    role: str
    key: Hashable | None
    """The connection; None while it is lost."""
    owner: Hashable = None
    """Address and token of who took it."""
    lost_s: float = 0.0
    """Since when it is lost."""
    place: Place | None = None
    """Centre of its last landing; None before the first."""


@dataclass(slots=True)
class Barrier:
    """One group landing."""

    number: int
    guide: int
    gather: Gather
    deadline_s: float
    states: dict[int, str] = field(default_factory=dict)
    """What members have said, by number."""
    is_open: bool = False
    """Whether ``gathered`` was said, or nobody waits any more."""

    def gathering(self, now_s: float) -> Gathering:
        """Return what members are told of it at that time."""
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
    """One group; it is gone with its last seat."""

    id: tuple[str, str]
    """Scene and name."""
    owner: Hashable = None
    """Address and token of who began it."""
    seats: dict[int, Seat] = field(default_factory=dict)
    """By number, ascending."""
    newest: int = 0
    """Number of the newest seat."""
    barrier: Barrier | None = None
    roster_due_s: float | None = None
    """When changes are told; None = none."""
    roster_told_s: float = float("-inf")
    gathering_due_s: float | None = None
    """When the newest gathering is told; None = it was."""
    gathering_told_s: float = float("-inf")

    def seat_of(self, secret: str | None) -> Seat | None:
        """Return the seat of a secret."""
        if secret is None:
            return None
        # 128 random bits, compared in a group that holds a few: no timing tells them apart.
        return next((seat for seat in self.seats.values() if seat.secret == secret), None)

    def roster(self) -> Roster:
        """Return who is there, and where; never a secret (16.1)."""
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
        """When there is something to do; None where the group is gone, or waits for nothing."""
        news = self.roster_due_s, self.gathering_due_s
        times = [due_s for due_s in news if due_s is not None]
        if self.barrier is not None and not self.barrier.is_open:
            times.append(self.barrier.deadline_s)
        times += [seat.lost_s + absence_s for seat in self.seats.values() if seat.key is None]
        return min(times) if times and self.seats else None

    @property
    def is_absent(self) -> bool:
        """Whether nobody is there: all its seats are kept for lost connections."""
        return all(seat.key is None for seat in self.seats.values())
