"""Messages that a server sends."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .client_messages import Generation, Radius
from .kinds import Choice, Flag, Integer, Number, NumberMap, Position, Text, Version, VersionList
from .limits import (
    MAX_ATTRIBUTES,
    MAX_HELD_SEGMENTS,
    MAX_INTEGER,
    MAX_PLAN_SEGMENTS,
    MAX_RADIUS_M,
    MAX_RELEASE_FACTOR,
)
from .message import Direction, Message, Part, PartKind
from .tables import Ids, LoadTable
from .welcome_parts import PullInfo, SceneInfo, ServerLimits

__all__ = [
    "Degraded",
    "Error",
    "HeldChecked",
    "Hit",
    "Notice",
    "Picked",
    "Plan",
    "Prefetch",
    "Ready",
    "Superseded",
    "Timings",
    "Welcome",
]

_U32 = 2**32 - 1

Point = tuple[float, float, float]
Blocks = Annotated[
    NDArray[Any] | None,
    Ids(MAX_PLAN_SEGMENTS),
    "With `pull`: where the payload of each row begins in the pack, in blocks of 64 bytes",
]


class ServerMessage(Message):
    """A message from a server to a client."""

    __slots__ = ()

    DIRECTION: ClassVar[Direction] = Direction.SERVER_TO_CLIENT


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Welcome(ServerMessage):
    """Answer to hello: the session is open."""

    TYPE: ClassVar[str] = "welcome"

    protocol: Annotated[tuple[int, int], Version(), "Version spoken from now on"]
    server: Annotated[str, Text(128), "Name and version of the server"]
    session: Annotated[str, Text(64), "Id of the session, for logs of both sides"]
    scene: Annotated[SceneInfo, PartKind(SceneInfo), "The scene"]
    limits: Annotated[ServerLimits, PartKind(ServerLimits), "What the server allows"]
    release_factor: Annotated[
        float, Number(1.0, MAX_RELEASE_FACTOR), "Release radius / load radius in use"
    ]
    dropped: Annotated[
        NDArray[Any],
        Ids(MAX_HELD_SEGMENTS),
        "Offered segments that this scene version does not have; the client frees them",
    ]
    held_count: Annotated[
        int, Integer(0, MAX_HELD_SEGMENTS), "Offered segments that are accepted as held"
    ]
    pull: Annotated[
        PullInfo | None,
        PartKind(PullInfo),
        "Where payload is fetched; present where hello asked for `pull` and the server grants it",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldChecked(ServerMessage):
    """Answer to held: what of it is accepted."""

    TYPE: ClassVar[str] = "held_checked"

    dropped: Annotated[
        NDArray[Any],
        Ids(MAX_HELD_SEGMENTS),
        "Offered segments that this scene version does not have; the client frees them",
    ]
    held_count: Annotated[int, Integer(0, _U32), "Segments that are held by now"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan(ServerMessage):
    """Answer to land: the one set of segments of this landing."""

    TYPE: ClassVar[str] = "plan"

    generation: Generation
    position: Annotated[Point, Position(), "Centre, as received"]
    radius_m: Radius
    release_radius_m: Annotated[
        float,
        Number(0.0, MAX_RADIUS_M * MAX_RELEASE_FACTOR, low_excluded=True),
        "Radius in metres within which held segments are kept",
    ]
    effective_radius_m: Annotated[
        float,
        Number(0.0, MAX_RADIUS_M),
        "Everything nearer than this is shown: the largest radius, or less where a budget cut",
    ]
    inner_count: Annotated[
        int, Integer(0, MAX_PLAN_SEGMENTS), "Segments of the plan within inner_radius_m"
    ]
    load: Annotated[
        NDArray[Any],
        LoadTable(MAX_PLAN_SEGMENTS),
        "Segments within radius_m that follow, in sending order",
    ]
    keep: Annotated[
        NDArray[Any], Ids(MAX_PLAN_SEGMENTS), "Segments within radius_m that the client holds"
    ]
    nearby: Annotated[
        NDArray[Any],
        Ids(MAX_PLAN_SEGMENTS),
        "Held segments beyond radius_m within release_radius_m: kept, not shown",
    ]
    load_bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload bytes of load, whole segments"]
    load_triangles: Annotated[int, Integer(0, MAX_INTEGER), "Triangles of load"]
    total_bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload bytes of load and keep"]
    total_triangles: Annotated[int, Integer(0, MAX_INTEGER), "Triangles of load and keep"]
    omitted_segments: Annotated[
        int, Integer(0, _U32), "Segments within radius_m that a budget left out"
    ]
    omitted_by: Annotated[
        str | None,
        Choice("max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"),
        "Budget that the first omitted segment would exceed; absent if none was omitted",
    ] = None
    total_gpu_bytes: Annotated[
        int | None,
        Integer(0, MAX_INTEGER),
        "GPU bytes of load, keep and nearby; present where hello bounds them",
    ] = None
    blocks: Blocks = None

    def contradiction(self) -> tuple[str, str] | None:
        """Check the sums and that load, keep and nearby share no id."""
        if int(self.load["length"].sum(dtype="u8")) != self.load_bytes:
            return ("load_bytes", f"got {self.load_bytes}, expected the sum of load's lengths")
        if int(self.load["faces"].sum(dtype="u8")) != self.load_triangles:
            return (
                "load_triangles",
                f"got {self.load_triangles}, expected the sum of load's faces",
            )
        for total, share in (("total_bytes", "load_bytes"), ("total_triangles", "load_triangles")):
            if getattr(self, total) < getattr(self, share):
                return (total, f"got {getattr(self, total)}, expected at least {share}")
        if (self.omitted_by is None) != (self.omitted_segments == 0):
            return ("omitted_by", "got one of omitted_by and omitted_segments, expected both")
        return self._overlap()

    def _overlap(self) -> tuple[str, str] | None:
        # Each list holds an id once already, so a repetition is one across lists.
        ids = np.sort(np.concatenate((self.load["id"], self.keep, self.nearby)))
        if not (ids[1:] == ids[:-1]).any():
            return None
        text = "got an id of {}, expected load, keep and nearby to be disjoint"
        if np.isin(self.load["id"], self.keep).any():
            return ("load", text.format("keep"))
        if np.isin(self.nearby, self.keep).any():
            return ("nearby", text.format("keep"))
        return ("nearby", text.format("load"))


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prefetch(ServerMessage):
    """Answer to aim: what is sent ahead."""

    TYPE: ClassVar[str] = "prefetch"

    generation: Generation
    segments: Annotated[NDArray[Any], LoadTable(MAX_PLAN_SEGMENTS), "Segments, in sending order"]
    bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload bytes of segments, whole"]
    blocks: Blocks = None

    def contradiction(self) -> tuple[str, str] | None:
        """Check that the lengths of `segments` add up to `bytes`."""
        if int(self.segments["length"].sum(dtype="u8")) != self.bytes:
            return ("bytes", f"got {self.bytes}, expected the sum of the segments' lengths")
        return None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Timings(Part):
    """When the server did what for one landing, in microseconds since it received land."""

    plan_us: Annotated[
        int | None,
        Integer(0, MAX_INTEGER),
        "Plan handed to the socket; absent where the plan was still waiting for that",
    ] = None
    first_byte_us: Annotated[
        int | None, Integer(0, MAX_INTEGER), "First chunk on its way; absent where there was none"
    ] = None
    last_byte_us: Annotated[
        int | None, Integer(0, MAX_INTEGER), "Last chunk on its way; absent where there was none"
    ] = None
    ready_us: Annotated[int, Integer(0, MAX_INTEGER), "Ready decided"]
    credit_wait_us: Annotated[
        int,
        Integer(0, MAX_INTEGER),
        "How long there was payload to send and no credit: time that the client took",
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Ready(ServerMessage):
    """Every segment of the plan was sent whole, or is listed as missing."""

    TYPE: ClassVar[str] = "ready"

    generation: Generation
    delivered: Annotated[
        int, Integer(0, MAX_PLAN_SEGMENTS), "Segments of load that were sent whole"
    ]
    payload_bytes: Annotated[
        int, Integer(0, MAX_INTEGER), "Payload bytes sent in this generation's frames"
    ]
    missing: Annotated[
        NDArray[Any], Ids(MAX_PLAN_SEGMENTS), "Segments of the plan that cannot be delivered"
    ]
    timings: Annotated[Timings | None, PartKind(Timings), "Where hello asked for them"] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Degraded(ServerMessage):
    """The deadline has passed and the inner set is whole; streaming goes on to ready."""

    TYPE: ClassVar[str] = "degraded"

    generation: Generation
    segments: Annotated[
        NDArray[Any], Ids(MAX_PLAN_SEGMENTS), "The inner set: what may be shown already"
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Superseded(ServerMessage):
    """An unfinished generation was ended by a newer one."""

    TYPE: ClassVar[str] = "superseded"

    generation: Generation
    by: Annotated[int, Integer(0, _U32), "The newer generation"]
    unsent_bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload bytes that were not sent"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hit(Part):
    """What a pick met."""

    position: Annotated[Point, Position(), "Point of the surface, metres of the scene frame"]
    normal: Annotated[Point, Position(1.5), "Unit normal of the face"]
    segment: Annotated[int, Integer(0, _U32), "Segment of the face"]
    region: Annotated[int, Integer(0, _U32), "Region of the face, in this scene version"]
    stable_id: Annotated[
        int | None,
        Integer(0, _U32),
        "Number of the region that is the same in every version of the scene, where it has one",
    ] = None
    label: Annotated[
        str | None, Text(256), "Label of the region when the pick is answered, where it has one"
    ] = None
    height_m: Annotated[
        float, Number(-1e9, 1e9), "Height in metres in the survey's own vertical reference"
    ]
    attributes: Annotated[
        dict[str, float], NumberMap(MAX_ATTRIBUTES), "Survey attributes there, without gaps"
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picked(ServerMessage):
    """Answer to pick."""

    TYPE: ClassVar[str] = "picked"

    request: Annotated[int, Integer(0, _U32), "Request, as received"]
    hit: Annotated[Hit | None, PartKind(Hit), "What was met; absent if nothing was"] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Notice(ServerMessage):
    """News that ends nothing by itself; a client skips kinds that it does not know."""

    TYPE: ClassVar[str] = "notice"

    kind: Annotated[
        str,
        Text(64, shortest=1, pattern="[a-z][a-z0-9_]*"),
        "`draining`: reconnect soon; `scene_published`: a newer version is served",
    ]
    version: Annotated[str | None, Text(64), "Version of the new scene"] = None
    reconnect_after_ms: Annotated[
        int | None, Integer(0, MAX_INTEGER), "Milliseconds to wait before reconnecting"
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Error(ServerMessage):
    """Something was refused or failed."""

    TYPE: ClassVar[str] = "error"

    code: Annotated[
        str, Text(64, shortest=1, pattern="[a-z][a-z0-9_]*"), "Stable code, see the error codes"
    ]
    message: Annotated[str, Text(1024), "What was received and what was expected, for people"]
    fatal: Annotated[bool, Flag(), "True: the server closes with the code's close code"]
    generation: Annotated[int | None, Integer(0, _U32), "Generation of the refused aim or land"] = (
        None
    )
    request: Annotated[
        int | None, Integer(0, _U32), "Request of the refused pick, join or gather"
    ] = None
    protocols: Annotated[
        tuple[tuple[int, int], ...] | None,
        VersionList(),
        "With unsupported_version: the versions offered",
    ] = None
