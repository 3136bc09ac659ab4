"""What a session takes, returns and reports: scene, limits, actions, observer.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from terraport_payload.hidden import HiddenFaces
from terraport_payload.types import Float32, Int64, UInt32, UInt64
from terraport_server.groups.state import Place
from terraport_wire import (
    Arrived,
    CloseCode,
    Error,
    ErrorCode,
    Gather,
    Join,
    Message,
)

__all__ = [
    "Action",
    "Authorise",
    "Close",
    "GroupPort",
    "MakePlan",
    "Observer",
    "RunPick",
    "SceneView",
    "SegmentTable",
    "SendChunk",
    "SendMessage",
    "SessionLimits",
]


@dataclass(frozen=True, slots=True)
class SegmentTable:
    """Table of the S segments of a scene, as plans need it.

    Rows 0 to S - 1 are the segments at full detail, S to 2 S - 1 those at the coarser level.
    """

    bounds: Float32
    """(S, 6) min x, y, z, max x, y, z; metres, scene frame."""
    lengths: UInt32
    """(S,) payload bytes."""
    hashes: UInt64
    """(S,) xxh3-64 of the payload."""
    faces: UInt32
    """(S,) triangles."""
    vertices: UInt32
    """(S,) vertices."""
    texture_bytes: UInt64
    """(S,) bytes of the texture on a GPU, including mipmaps; 0 without a texture."""
    levels: int = 1
    """Number of levels of detail: rows per segment."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.lengths)

    @property
    def segment_count(self) -> int:
        """Number of segments S."""
        return len(self.lengths) // self.levels


@dataclass(frozen=True, slots=True)
class SceneView:
    """Part of a served scene that a session uses."""

    id: str
    version: str
    name: str
    table: SegmentTable
    within: Callable[[Sequence[float], float], Int64]
    """Return the ids of segments whose box is within a radius of a point; metres, scene frame."""
    hidden_faces: HiddenFaces
    """Which base faces are under which segments."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionLimits:
    """Limits of one session. Some are settings: docs/topics/settings.md."""

    server: str = "terraport"
    max_radius_m: float = 500.0
    max_message_bytes: int = 1 << 20
    max_messages_per_s: float = 60.0
    max_plan_segments: int = 16_384
    max_credit_bytes: int = 64 << 20
    max_picks: int = 8
    """Maximum concurrent picks."""
    handshake_timeout_s: float = 10.0
    idle_timeout_s: float = 60.0
    reconnect_after_ms: int = 1000
    groups: str = "here"
    """Value of ``welcome.limits.groups``: "none", "here" or "query"."""


@dataclass(frozen=True, slots=True)
class SendMessage:
    """Send one message, after all earlier actions."""

    message: Message


class SendChunk(NamedTuple):
    """Send ``length`` payload bytes of a segment from ``offset``.

    In frames of at most `MAX_CHUNK_BYTES`. Report the outcome before any other call on the session:
    ``chunks_sent`` once verified bytes are handed to the socket, of the last chunk perhaps fewer,
    else ``payload_failed``.
    """

    generation: int
    segment: int
    offset: int
    length: int
    total: int
    landing: bool
    """False for a prefetch, which has lower priority."""


@dataclass(frozen=True, slots=True)
class MakePlan:
    """Call ``make_plan`` when the caller's queue allows.

    The cost of a plan grows with the landing's radius, so the caller schedules plans fairly between
    clients. The session accepts messages meanwhile: a landing superseded by then needs no plan.
    """


@dataclass(frozen=True, slots=True)
class RunPick:
    """Run a pick; report it later with ``picked`` or ``pick_failed``."""

    request: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True)
class Close:
    """Close the connection; the last action."""

    code: CloseCode
    reason: str


Action = SendMessage | SendChunk | MakePlan | RunPick | Close


class Observer:
    """Callbacks for metrics and logs, called synchronously. This one does nothing."""

    def planned(
        self, generation: int, *, load: int, keep: int, payload_bytes: int, omitted: int
    ) -> None:
        """Record a planned landing: segments to send and not, their bytes, and left out ones."""

    def plan_sent(self, generation: int, seconds: float) -> None:
        """Record a plan's hand-over to the socket, in seconds since ``land`` was received."""

    def first_byte(self, seconds: float) -> None:
        """Record a landing's first payload byte, in seconds since ``land`` was received."""

    def ready(
        self, generation: int, *, segments: int, payload_bytes: int, missing: int, seconds: float
    ) -> None:
        """Record the ``ready`` of a landing, in seconds since ``land`` was received."""

    def superseded(self, generation: int, unsent_bytes: int, *, landing: bool) -> None:
        """Record a landing or prefetch that a newer one ended."""

    def credit_stalled(self, *, stalled: bool) -> None:
        """Record that payload began or ceased to wait for the client's credit."""

    def rejected(self, generation: int, rows: Sequence[int]) -> None:
        """Record the payloads near a landing that the client cannot use."""

    def grouped(self, event: str) -> None:
        """Record the answer to a group request: ``join``, ``gather`` or ``refused``."""

    def ending(self, reason: str) -> None:
        """Record that the session is closing; the reason is ``bye`` or an error code."""

    def refused(self, error: Error) -> None:
        """Record an error sent to the client."""


class GroupPort(Protocol):
    """One session's access to its process's groups; replies come by ``Session.tell_group``."""

    def join(self, join: Join, place: Place | None, now_s: float) -> str | None:
        """Join a group, at the given position if known; return the reason of a refusal."""

    def leave(self, now_s: float) -> None:
        """Leave the group, if the session is in one."""

    def gather(self, gather: Gather, now_s: float) -> str | None:
        """Start a group landing; return the reason of a refusal."""

    def arrived(self, arrived: Arrived) -> None:
        """Record that this member finished its part of a group landing."""

    def landed(self, place: Place, now_s: float) -> None:
        """Record the centre of the client's newest landing; ignored outside a group."""


class Authorise(Protocol):
    """Check of the token in ``hello``, and of the session limits that depend on it."""

    def __call__(self, token: str | None) -> tuple[ErrorCode, str] | None:
        """Return ``None`` to admit the client, else an error code and its text."""
