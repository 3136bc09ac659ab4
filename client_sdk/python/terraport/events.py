"""What the session state machine reports: values, in the order in which they happened.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from terraport.cache import CachedSegment
from terraport.pull_ranges import Fetch, PackAddress
from terraport_wire import Gathering, Hit, Member, Plan, SceneInfo, ServerLimits, Timings

__all__ = [
    "Degraded",
    "Dropped",
    "Event",
    "FetchNeeded",
    "FetchStopped",
    "GroupCalled",
    "GroupGathered",
    "GroupJoined",
    "GroupRefused",
    "GroupRoster",
    "LandingSent",
    "Noticed",
    "Opened",
    "PayloadBegan",
    "PickAnswered",
    "PickRefused",
    "Planned",
    "Prefetched",
    "Ready",
    "Refused",
    "RestoreNeeded",
    "SegmentArrived",
    "SegmentRejected",
    "Superseded",
]


@dataclass(frozen=True, slots=True)
class Opened:
    """The server said welcome; held segments that it does not know any more are dropped already."""

    scene: SceneInfo
    limits: ServerLimits
    session: str
    """The server's name for this session, for logs."""
    held_count: int
    """Offered segments that the server accepted."""
    version_changed: bool
    """True when an earlier connection of this session served another version."""


@dataclass(frozen=True, slots=True)
class Dropped:
    """These ids are held no more: not of the served version, or of a server that takes no offer."""

    segments: tuple[int, ...]
    on_disk: tuple[tuple[int, int], ...]
    """Id and xxh3 of those that a disk cache deletes."""


@dataclass(frozen=True, slots=True)
class LandingSent:
    """A landing's ``land`` is on its way."""

    landing: int


@dataclass(frozen=True, slots=True)
class Planned:
    """A landing has its plan; after a reconnect it gets another one."""

    landing: int
    plan: Plan
    kept: tuple[CachedSegment, ...]
    """What of ``plan.keep`` is in memory, ascending id."""


@dataclass(frozen=True, slots=True)
class PayloadBegan:
    """The first chunk of a landing is here."""

    landing: int


@dataclass(frozen=True, slots=True)
class SegmentArrived:
    """One segment is whole and has the right hash."""

    landing: int | None
    """The landing that it belongs to; None for a prefetched one."""
    entry: CachedSegment
    restored: bool = False
    """True when it came from the disk cache and not from the server."""


@dataclass(frozen=True, slots=True)
class SegmentRejected:
    """One segment came with a wrong hash, or the disk cache lost it; it was asked for again."""

    landing: int | None
    segment: int
    actual: int | None
    """xxh3-64 of what came; None when nothing is left."""
    expected: int
    """xxh3-64 that was promised."""


@dataclass(frozen=True, slots=True)
class RestoreNeeded:
    """The plan keeps segments that only the disk holds.

    The caller must answer each with :meth:`ClientSession.restored` or :meth:`ClientSession.lost`.
    """

    landing: int
    segments: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class FetchNeeded:
    """A session that pulls needs these payloads, the most urgent first, and no other any more.

    The caller answers each with :meth:`ClientSession.fetched`, or all of them with
    :meth:`ClientSession.stop_pulling` and another connection.
    """

    address: PackAddress
    fetches: tuple[Fetch, ...]


@dataclass(frozen=True, slots=True)
class FetchStopped:
    """Nothing is to be fetched until the next :class:`FetchNeeded`."""


@dataclass(frozen=True, slots=True)
class Degraded:
    """The deadline passed and the inner set is whole; the landing goes on."""

    landing: int
    segments: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Ready:
    """The landing is whole, and is what is visible from now on."""

    landing: int
    shown: tuple[int, ...]
    """Visible ids, ascending: load and keep of the plan, less the missing ones."""
    missing: tuple[int, ...]
    timings: Timings | None = field(default=None, compare=False)
    """When the server did what, where it says so."""


@dataclass(frozen=True, slots=True)
class Superseded:
    """An unfinished landing was ended by a newer one."""

    landing: int
    by: int


@dataclass(frozen=True, slots=True)
class Prefetched:
    """Everything that an aim asked for is held."""

    aim: int
    segments: int
    payload_bytes: int


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
class Refused:
    """The server refused something: one landing, one aim, or (fatal) the connection."""

    code: str
    message: str
    fatal: bool
    landing: int | None = None


@dataclass(frozen=True, slots=True)
class Noticed:
    """News from the server."""

    kind: str
    version: str | None
    reconnect_after_ms: int | None


@dataclass(frozen=True, slots=True)
class GroupJoined:
    """The session has a seat in its group, or has it again after a reconnect."""

    request: int
    group: str
    member: int
    role: str


@dataclass(frozen=True, slots=True)
class GroupRefused:
    """The server refused to let the session join or gather."""

    request: int
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class GroupRoster:
    """Who is in the group now."""

    members: tuple[Member, ...]


@dataclass(frozen=True, slots=True)
class GroupCalled:
    """The guide lands the group; older group landings are over."""

    gathering: Gathering


@dataclass(frozen=True, slots=True)
class GroupGathered:
    """The barrier of a group landing is open; members by number."""

    gathering: int
    ready: tuple[int, ...]
    degraded: tuple[int, ...]
    missing: tuple[int, ...]


Event = (
    Opened
    | Dropped
    | Planned
    | SegmentArrived
    | SegmentRejected
    | RestoreNeeded
    | FetchNeeded
    | FetchStopped
    | Degraded
    | LandingSent
    | PayloadBegan
    | Ready
    | Superseded
    | Prefetched
    | PickAnswered
    | PickRefused
    | Refused
    | Noticed
    | GroupJoined
    | GroupRefused
    | GroupRoster
    | GroupCalled
    | GroupGathered
)
