"""What goes into a session, comes out of it, and is heard of it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from terraport_payload.types import Int64, UInt64
from terraport_server.groups.state import Place
from terraport_server.session.selection import SegmentTable
from terraport_wire import (
    Arrived,
    CloseCode,
    Error,
    ErrorCode,
    Gather,
    Join,
    Message,
    Plan,
    PullInfo,
    Ready,
    Reject,
    Superseded,
)

__all__ = [
    "Action",
    "Authorise",
    "Close",
    "GroupPort",
    "MakePlan",
    "Observer",
    "PullView",
    "RunPick",
    "SceneView",
    "SendChunk",
    "SendMessage",
    "SessionLimits",
]


@dataclass(frozen=True, slots=True)
class PullView:
    """Where clients fetch the payloads of a scene by themselves, in its ``glb`` encoding."""

    info: PullInfo
    offsets: UInt64
    """Where each segment begins in the pack: multiples of 64, below 2^38."""


@dataclass(frozen=True, slots=True)
class SceneView:
    """What a session needs of the scene that it serves."""

    id: str
    version: str
    name: str
    encodings: Mapping[str, SegmentTable]
    """One table per payload encoding; at least one, all of the same length."""
    within: Callable[[Sequence[float], float], Int64]
    """Ids of the segments whose box comes within a radius of a point, metres, scene frame."""
    pull: PullView | None = None
    """None where payload is sent in frames alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionLimits:
    """What one client may do. Every field is a setting; see docs/topics/limits.md."""

    server: str = "terraport"
    release_factor: float = 1.25
    max_radius_m: float = 500.0
    max_message_bytes: int = 1 << 20
    max_messages_per_s: float = 60.0
    max_held_segments: int = 32_768
    max_plan_segments: int = 16_384
    max_credit_bytes: int = 64 << 20
    max_picks: int = 8
    """Picks that may be under way at once."""
    handshake_timeout_s: float = 10.0
    idle_timeout_s: float = 60.0
    reconnect_after_ms: int = 1000
    groups: str = "here"
    """What ``welcome.limits.groups`` says: "none", "here" or "query"."""


@dataclass(frozen=True, slots=True)
class SendMessage:
    """Send one message, behind the actions before it."""

    message: Message


class SendChunk(NamedTuple):
    """Send ``length`` payload bytes of a segment from ``offset``.

    Before anything else is called on the session, answer with ``chunks_sent`` (the bytes are whole,
    right, and on their way) or ``payload_failed``.
    """

    generation: int
    segment: int
    offset: int
    length: int
    total: int
    landing: bool
    """False for an aim: lower priority."""


@dataclass(frozen=True, slots=True)
class MakePlan:
    """Call ``make_plan`` when it is this client's turn; whatever it has asked for by then counts.

    Planning costs as much as a landing is wide, so the caller decides whose turn it is. Until then
    more may be told to the session: a landing that a newer one ends meanwhile needs no plan.
    """


@dataclass(frozen=True, slots=True)
class RunPick:
    """Answer later with ``picked`` or ``pick_failed``."""

    request: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True)
class Close:
    """Close the connection; nothing follows."""

    code: CloseCode
    reason: str


Action = SendMessage | SendChunk | MakePlan | RunPick | Close


class Observer:
    """Hears what happens, for metrics and logs. This one ignores it all."""

    def planned(self, generation: int, plan: Plan) -> None:
        """Hear of a landing accepted and planned."""

    def plan_sent(self, generation: int, seconds: float) -> None:
        """Hear of a plan handed to the socket, so long after ``land`` came."""

    def first_byte(self, seconds: float) -> None:
        """Hear of a landing's first payload byte, so long after ``land`` came."""

    def ready(self, message: Ready, seconds: float) -> None:
        """Hear of a landing that is ready, so long after ``land`` came."""

    def superseded(self, message: Superseded, *, landing: bool) -> None:
        """Hear of a generation that ended unfinished."""

    def aim_ended(self, sent_bytes: int, used_bytes: int) -> None:
        """Hear what became of payload sent for aims: so much of it a landing has shown."""

    def aim_judged(self, *, hit: bool) -> None:
        """Hear of a landing after an aim; a hit needed nothing that the aim had not brought."""

    def credit_stalled(self, *, stalled: bool) -> None:
        """Hear that there is payload to send and no credit, or that this is over."""

    def rejected(self, message: Reject) -> None:
        """Hear of a segment that the client could not use."""

    def grouped(self, event: str) -> None:
        """Hear of a group: ``join``, ``gather``, or ``refused``."""

    def ending(self, reason: str) -> None:
        """Hear that the session is being closed: ``bye``, or an error's code."""

    def refused(self, error: Error) -> None:
        """Hear of an error that the client was told."""


class GroupPort(Protocol):
    """One session's way to the groups of its process; answers come by ``Session.tell_group``."""

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        """Take a seat, standing at that place if at any; return why not."""

    def leave(self, now_s: float) -> None:
        """Give up the seat, if there is one."""

    def gather(self, gather: Gather, now_s: float) -> str | None:
        """Land the group; return why not."""

    def arrived(self, arrived: Arrived) -> None:
        """Note that this member's part of a group landing is over."""

    def landed(self, place: Place, now_s: float) -> None:
        """Note where the client lands; nothing where it has no seat."""


class Authorise(Protocol):
    """Decides on the token of ``hello``, and whether there is room for its client."""

    def __call__(self, token: str | None) -> tuple[ErrorCode, str] | None:
        """Return ``None`` to admit, or why not, in a code and in words."""
