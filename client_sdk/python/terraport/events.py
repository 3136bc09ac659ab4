"""Events of the session core, in order.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

from terraport.cache import CachedSegment
from terraport_wire import (
    Gathered,
    Gathering,
    Hit,
    Joined,
    Land,
    Limits,
    Notice,
    Plan,
    Roster,
    SceneFacts,
)

__all__ = [
    "Event", "GroupEvent", "GroupRefused", "InnerWhole", "LandingEvent", "LandingSent", "Opened",
    "PayloadBegan", "PickAnswered", "PickRefused", "Planned", "Refused", "RestoreNeeded",
    "SegmentArrived", "SegmentRejected", "Shown", "Superseded",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Opened:
    """The server said welcome."""

    scene: SceneFacts
    limits: Limits
    session: str
    """The server's name for this session, for logs."""
    version_changed: bool
    """Whether an earlier connection of this session served another version."""


@dataclass(frozen=True, slots=True)
class LandingSent:
    """A landing's ``land`` is on its way."""

    landing: int


@dataclass(frozen=True, slots=True)
class Planned:
    """A landing has its plan; asked for again, it gets another one."""

    landing: int
    land: Land
    plan: Plan
    here: tuple[CachedSegment, ...]
    """What of ``plan.show`` is in memory, in its order."""
    came: frozenset[int]
    """Keys of those of them that came since the landing was asked for."""


@dataclass(frozen=True, slots=True)
class PayloadBegan:
    """The first payload of a landing is here."""

    landing: int


@dataclass(frozen=True, slots=True)
class SegmentArrived:
    """One segment is whole, and its checksums are right."""

    landing: int | None
    """The landing that is planned and shows it."""
    entry: CachedSegment
    restored: bool = False
    """Whether it came from the disk cache and not from the server."""


@dataclass(frozen=True, slots=True)
class SegmentRejected:
    """One segment came damaged, or the disk cache has lost it; a landing asks for it again."""

    landing: int | None
    key: int
    on_disk: bool = False
    """Whether it is the file that is damaged or gone."""


@dataclass(frozen=True, slots=True)
class RestoreNeeded:
    """The plan counts on segments that only the disk holds.

    The caller answers each with :meth:`SessionCore.restored` or :meth:`SessionCore.lost`.
    """

    keys: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class InnerWhole:
    """The deadline has passed and the inner set is complete; the landing continues."""

    landing: int
    ids: tuple[int, ...]
    hidden: bytes
    """Base faces, one bit each, the lowest bit first."""


@dataclass(frozen=True, slots=True)
class Shown:
    """The landing is whole, and is what is visible from now on."""

    landing: int
    ids: tuple[int, ...]
    """Visible segments, ascending."""
    missing: tuple[int, ...]
    """Segments that could not be delivered, ascending."""
    hidden: bytes
    """Base faces, one bit each, the lowest bit first."""


@dataclass(frozen=True, slots=True)
class Superseded:
    """An unfinished landing was ended by a newer one."""

    landing: int
    by: int


@dataclass(frozen=True, slots=True)
class Refused:
    """The server refused one landing, or (fatal) the connection."""

    code: str
    message: str
    fatal: bool
    landing: int | None = None


@dataclass(frozen=True, slots=True)
class PickAnswered:
    """What lies there; None for nothing."""

    request: int
    hit: Hit | None


@dataclass(frozen=True, slots=True)
class PickRefused:
    """The server refused a pick."""

    request: int
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class GroupRefused:
    """The server refused to let the session join or gather."""

    request: int
    code: str
    message: str


GroupEvent = Joined | GroupRefused | Roster | Gathering | Gathered
"""The group's messages are events as they are, once the seat has sorted out what crossed."""

LandingEvent = LandingSent | Planned | PayloadBegan | InnerWhole | Shown | Superseded | Refused

Event = (
    Opened | LandingEvent | SegmentArrived | SegmentRejected | RestoreNeeded
    | PickAnswered | PickRefused | Notice | GroupEvent
)  # fmt: skip
