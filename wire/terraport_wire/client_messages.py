"""Messages that a client sends."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, ClassVar

from numpy.typing import NDArray

from .kinds import Choice, Flag, Integer, Number, Position, Text, Version
from .limits import (
    MAX_DEADLINE_MS,
    MAX_GPU_ELEMENT_BYTES,
    MAX_HELD_SEGMENTS,
    MAX_INTEGER,
    MAX_RADIUS_M,
    MAX_RELEASE_FACTOR,
    MAX_TOKEN_BYTES,
)
from .message import Direction, Message, Part, PartKind
from .tables import HeldTable, Ids

__all__ = [
    "Aim",
    "Budgets",
    "Bye",
    "Credit",
    "Evict",
    "Held",
    "Hello",
    "Land",
    "Pick",
    "Reject",
    "inner_radius_problem",
]

_U32 = 2**32 - 1

Generation = Annotated[
    int, Integer(0, _U32), "Number of the aim or land; strictly increasing on one connection"
]
Centre = Annotated[
    tuple[float, float, float], Position(), "Centre in metres of the scene frame (x, y, z)"
]
Radius = Annotated[
    float, Number(0.0, MAX_RADIUS_M, low_excluded=True), "Radius in metres around the centre"
]
CoarseRadius = Annotated[
    float | None,
    Number(0.0, MAX_RADIUS_M, low_excluded=True),
    "Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m",
]


class ClientMessage(Message):
    """A message from a client to a server."""

    __slots__ = ()

    DIRECTION: ClassVar[Direction] = Direction.CLIENT_TO_SERVER


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Budgets(Part):
    """What one landing may hold in all (load and keep together); absent means unlimited."""

    max_triangles: Annotated[int | None, Integer(0, MAX_INTEGER), "Most triangles"] = None
    max_bytes: Annotated[int | None, Integer(0, MAX_INTEGER), "Most payload bytes"] = None
    max_segments: Annotated[int | None, Integer(0, MAX_INTEGER), "Most segments"] = None
    max_gpu_bytes: Annotated[
        int | None, Integer(0, MAX_INTEGER), "Most bytes on the client's GPU (section 6.2)"
    ] = None
    gpu_vertex_bytes: Annotated[
        int | None,
        Integer(1, MAX_GPU_ELEMENT_BYTES),
        "Bytes of a vertex in the client's buffers; absent means 24",
    ] = None
    gpu_face_bytes: Annotated[
        int | None,
        Integer(1, MAX_GPU_ELEMENT_BYTES),
        "Bytes of a triangle's three indices in them; absent means 6",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hello(ClientMessage):
    """First message of a connection: who the client is, what it can take, what it holds."""

    TYPE: ClassVar[str] = "hello"

    protocol: Annotated[tuple[int, int], Version(), "Newest version that the client speaks"]
    client: Annotated[str, Text(128), "Name and version of the client, for logs"]
    token: Annotated[
        str | None, Text(MAX_TOKEN_BYTES), "Bearer token, where it was not given before"
    ] = None
    encoding: Annotated[str, Choice("segment-2"), "Payload encoding that the client wants"]
    budgets: Annotated[Budgets, PartKind(Budgets), "Hard bounds of every landing"]
    credit_bytes: Annotated[
        int, Integer(0, MAX_INTEGER), "First credit: payload bytes that may be sent at once"
    ]
    release_factor: Annotated[
        float | None,
        Number(1.0, MAX_RELEASE_FACTOR),
        "Release radius / load radius; absent means the server's default",
    ] = None
    scene_version: Annotated[
        str | None, Text(64), "Scene version that the client knows; absent means the newest"
    ] = None
    held: Annotated[
        NDArray[Any] | None,
        HeldTable(MAX_HELD_SEGMENTS),
        "Segments that the client holds whole, with their hashes",
    ] = None
    delivery: Annotated[
        str | None,
        Choice("push", "pull"),
        "How payload comes: `push`, in frames of this connection; `pull`, fetched by the client "
        "(section 17). Absent means `push`",
    ] = None
    timings: Annotated[
        bool | None, Flag(), "True: send timings with every ready; absent means false"
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Aim(ClientMessage):
    """The user points at a place: send ahead, at low priority, what a landing there needs."""

    TYPE: ClassVar[str] = "aim"

    generation: Generation
    position: Centre
    radius_m: Radius
    coarse_radius_m: CoarseRadius = None

    def contradiction(self) -> tuple[str, str] | None:
        """Check the coarser level's radius against the radius."""
        return _coarse_radius_problem(self.coarse_radius_m, self.radius_m)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Land(ClientMessage):
    """The user teleports: answer with one plan, send its segments, say ready."""

    TYPE: ClassVar[str] = "land"

    generation: Generation
    position: Centre
    radius_m: Radius
    inner_radius_m: Annotated[
        float | None,
        Number(0.0, MAX_RADIUS_M, low_excluded=True),
        "Radius in metres of the degraded set; at most radius_m",
    ] = None
    deadline_ms: Annotated[
        int | None,
        Integer(1, MAX_DEADLINE_MS),
        "Milliseconds after which the inner set alone is acceptable; needs inner_radius_m",
    ] = None
    stall_ms: Annotated[
        int | None,
        Integer(1, MAX_DEADLINE_MS),
        "Milliseconds without progress after which it is, too; needs inner_radius_m",
    ] = None
    coarse_radius_m: CoarseRadius = None

    def contradiction(self) -> tuple[str, str] | None:
        """Check the other radii against the radius, and the deadlines against both."""
        problem = _coarse_radius_problem(self.coarse_radius_m, self.radius_m)
        if problem is not None:
            return problem
        if self.inner_radius_m is None:
            for name in ("deadline_ms", "stall_ms"):
                if getattr(self, name) is not None:
                    return (name, "got a deadline without inner_radius_m, expected both")
            return None
        return inner_radius_problem(self.inner_radius_m, self.radius_m)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Credit(ClientMessage):
    """Grant more payload bytes."""

    TYPE: ClassVar[str] = "credit"

    bytes: Annotated[int, Integer(1, MAX_INTEGER), "Payload bytes granted beyond what was before"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evict(ClientMessage):
    """The client no longer holds these segments."""

    TYPE: ClassVar[str] = "evict"

    segments: Annotated[NDArray[Any], Ids(MAX_HELD_SEGMENTS), "Segments no longer held"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Reject(ClientMessage):
    """A segment arrived whole but is not usable."""

    TYPE: ClassVar[str] = "reject"

    generation: Annotated[int, Integer(0, _U32), "Generation of the segment's last frame"]
    segment: Annotated[int, Integer(0, _U32), "The segment"]
    reason: Annotated[str, Text(64), "`hash_mismatch`, `undecodable`, or another word for logs"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pick(ClientMessage):
    """Ask what lies along a ray, or above or below a point."""

    TYPE: ClassVar[str] = "pick"

    request: Annotated[int, Integer(0, _U32), "Number chosen by the client, for the answer"]
    origin: Annotated[tuple[float, float, float], Position(), "Point in metres of the scene frame"]
    direction: Annotated[
        tuple[float, float, float] | None,
        Position(nonzero=True),
        "Direction of the ray, of any length; absent: the vertical line through origin",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Held(ClientMessage):
    """More of what the client holds, after hello and before the first aim or land."""

    TYPE: ClassVar[str] = "held"

    segments: Annotated[
        NDArray[Any],
        HeldTable(MAX_HELD_SEGMENTS),
        "Segments that the client holds whole, with their hashes",
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bye(ClientMessage):
    """The client ends the session; the server closes with 1000."""

    TYPE: ClassVar[str] = "bye"


def _coarse_radius_problem(
    coarse_radius_m: float | None, radius_m: float
) -> tuple[str, str] | None:
    if coarse_radius_m is None or coarse_radius_m >= radius_m:
        return None
    text = f"got {coarse_radius_m:g}, expected at least radius_m {radius_m:g}"
    return ("coarse_radius_m", text)


def inner_radius_problem(inner_radius_m: float, radius_m: float) -> tuple[str, str] | None:
    """Return field and text where an inner radius is beyond the radius."""
    if inner_radius_m <= radius_m:
        return None
    text = f"got {inner_radius_m:g}, expected at most radius_m {radius_m:g}"
    return ("inner_radius_m", text)
