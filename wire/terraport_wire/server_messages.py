"""Messages that a server sends."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from .client_messages import KEY_DTYPE, Generation
from .kinds import Binary, Choice, Flag, Integer, Number, NumberMap, Position, Rows, Text
from .limits import (
    MAX_ATTRIBUTES,
    MAX_INTEGER,
    MAX_LEVELS,
    MAX_PLAN_SEGMENTS,
    MAX_RADIUS_M,
    MAX_SERVER_MESSAGE_BYTES,
)
from .message import Direction, Message, Part, PartKind

__all__ = [
    "COARSER",
    "FOLLOWS",
    "SEGMENT_DTYPE",
    "Error",
    "Hit",
    "Limits",
    "Notice",
    "Picked",
    "Plan",
    "Ready",
    "SceneFacts",
    "Welcome",
]

SEGMENT_DTYPE: Final = np.dtype(
    [
        ("key", "<u8"),
        ("id", "<u4"),
        ("bytes", "<u4"),
        ("faces", "<u4"),
        ("vertices", "<u4"),
        ("flags", "<u4"),
    ]
)
"""One row of ``plan.show``, 28 bytes."""

FOLLOWS: Final = 1
"""Flag of a row: its key was not in ``have``."""

COARSER: Final = 2
"""Flag of a row: the coarser level of the segment."""

_U32 = 2**32 - 1

Point = tuple[float, float, float]
Bits = Annotated[
    bytes | None,
    Binary(MAX_SERVER_MESSAGE_BYTES),
    "Base faces, one bit each, the lowest bit first, in a gzip stream",
]


class ServerMessage(Message):
    """A message from a server to a client."""

    __slots__ = ()

    DIRECTION: ClassVar[Direction] = Direction.SERVER_TO_CLIENT


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SceneFacts(Part):
    """Which scene is served."""

    id: Annotated[str, Text(128, shortest=1), "Id of the scene in URLs"]
    name: Annotated[str, Text(256), "Name for people"]
    version: Annotated[str, Text(64, shortest=1), "Changes whenever any byte does"]
    segment_count: Annotated[int, Integer(0, _U32), "Segments"]
    base_faces: Annotated[int, Integer(0, _U32), "Faces of the base mesh"]
    levels: Annotated[int, Integer(1, MAX_LEVELS), "Levels of detail"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Limits(Part):
    """What this service allows on this connection."""

    max_radius_m: Annotated[float, Number(0.0, MAX_RADIUS_M), "Largest radius"]
    max_message_bytes: Annotated[int, Integer(1, MAX_INTEGER), "Largest message to the service"]
    max_messages_per_s: Annotated[float, Number(0.0, 1e9), "Messages, averaged over 10 s"]
    max_credit_bytes: Annotated[int, Integer(1, MAX_INTEGER), "Most credit; more is cut to it"]
    idle_timeout_s: Annotated[float, Number(0.0, 1e9), "Silence after which the service closes"]
    groups: Annotated[str, Choice("none", "here", "query"), "Where groups can be joined"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Welcome(ServerMessage):
    """Answer to hello: the session is open."""

    TYPE: ClassVar[str] = "welcome"

    server: Annotated[str, Text(128), "Name and version of the service"]
    session: Annotated[str, Text(64), "Id of the session, for logs"]
    scene: Annotated[SceneFacts, PartKind(SceneFacts), "The scene"]
    limits: Annotated[Limits, PartKind(Limits), "What the service allows"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plan(ServerMessage):
    """Answer to land: what is shown, and which base faces are hidden."""

    TYPE: ClassVar[str] = "plan"

    generation: Generation
    show: Annotated[NDArray[Any], Rows(SEGMENT_DTYPE, MAX_PLAN_SEGMENTS), "Segments, nearest first"]
    hidden: Bits
    inner_count: Annotated[
        int | None, Integer(0, MAX_PLAN_SEGMENTS), "Rows within inner_radius_m"
    ] = None
    inner_hidden: Bits = None
    effective_radius_m: Annotated[
        float, Number(0.0, MAX_RADIUS_M), "Everything nearer is in `show`"
    ]
    omitted: Annotated[int, Integer(0, _U32), "Segments that a budget left out"]
    omitted_by: Annotated[
        str | None,
        Choice("max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"),
        "The budget",
    ] = None
    pack: Annotated[str | None, Text(201), "Over HTTP: address of the pack"] = None
    offsets: Annotated[
        NDArray[Any] | None,
        Rows(KEY_DTYPE, MAX_PLAN_SEGMENTS),
        "Over HTTP: where the payload of each row begins in the pack",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Ready(ServerMessage):
    """Everything that follows was sent."""

    TYPE: ClassVar[str] = "ready"

    generation: Generation
    missing: Annotated[
        NDArray[Any] | None,
        Rows(KEY_DTYPE, MAX_PLAN_SEGMENTS),
        "Keys of `show` that cannot be delivered",
    ] = None
    hidden: Bits = None


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
    generation: Annotated[
        int | None, Integer(0, _U32), "Generation of the refused landing or prefetch"
    ] = None
    request: Annotated[
        int | None, Integer(0, _U32), "Request of the refused pick, join or gather"
    ] = None
