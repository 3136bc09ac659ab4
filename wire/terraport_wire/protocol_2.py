"""Protocol 2: its messages, its tables and its payload frame (spec/protocol-2.md).

It has the field kinds, the codec, the errors and the group messages of protocol 1.
"""

from __future__ import annotations

import dataclasses
import struct
from functools import partial
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from . import codec
from .client_messages import Budgets, Bye, Centre, ClientMessage, Credit, Generation, Pick, Radius
from .errors import MalformedError
from .group_messages import (
    Arrived,
    Gather,
    Gathered,
    Gathering,
    Join,
    Joined,
    Leave,
    Roster,
)
from .kinds import Choice, Integer, Number, Refused, Text, clip
from .limits import (
    MAX_FRAME_BYTES,
    MAX_HEADER_BYTES,
    MAX_INTEGER,
    MAX_LEVELS,
    MAX_PLAN_SEGMENTS,
    MAX_RADIUS_M,
    MAX_SEGMENT_BYTES,
    MAX_SERVER_MESSAGE_BYTES,
    MAX_TOKEN_BYTES,
)
from .message import Direction, Message, Part, PartKind
from .server_messages import Error, Notice, Picked, ServerMessage

__all__ = [
    "FRAME_HEADER_BYTES",
    "KEY_DTYPE",
    "MAX_HAVE",
    "MESSAGES",
    "SEGMENT_DTYPE",
    "SUBPROTOCOL",
    "Frame",
    "Hello",
    "Land",
    "Limits",
    "Plan",
    "Prefetch",
    "Ready",
    "SceneFacts",
    "Welcome",
    "decode",
    "decode_frame",
    "frame_header",
]

SUBPROTOCOL: Final = "terraport.v2.msgpack"

KEY_DTYPE: Final = np.dtype("<u8")
"""Name of a payload by its content."""

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

MAX_HAVE: Final = 4096
"""Most keys in ``have``: 32 KiB."""

MAX_WITHOUT: Final = 64
"""Most keys in ``without``."""

FRAME_HEADER_BYTES: Final = 24

_KIND: Final = 0x01
_HEADER: Final = struct.Struct("<BxHIQII")
_U32: Final = 2**32 - 1


class Rows:
    """Packed rows of one dtype, at most `most`: a read-only array in Python."""

    def __init__(self, dtype: np.dtype[Any], most: int) -> None:
        self.dtype = dtype
        self.most = most

    def check(self, value: Any) -> NDArray[Any]:
        rows = np.ascontiguousarray(value, dtype=self.dtype)
        if rows.ndim != 1 or len(rows) > self.most:
            raise Refused(f"got shape {rows.shape}, expected at most {self.most} rows")
        if rows.flags.writeable:
            rows = rows.copy()
            rows.setflags(write=False)
        return rows

    def to_wire(self, value: Any) -> bytes:
        data: bytes = value.tobytes()
        return data

    def from_wire(self, raw: Any) -> NDArray[Any]:
        size = self.dtype.itemsize
        if not isinstance(raw, bytes) or len(raw) % size or len(raw) > self.most * size:
            most = f"at most {self.most} rows of {size} bytes"
            raise Refused(f"got {clip(raw)}, expected binary of {most}")
        return np.frombuffer(raw, dtype=self.dtype)

    def schema(self) -> dict[str, Any]:
        size = self.dtype.itemsize
        return {"type": "string", "x-msgpack": f"binary: rows of {size} bytes, little-endian"}

    def describe(self) -> str:
        return f"binary, at most {self.most} rows of {self.dtype.itemsize} bytes"


class Binary:
    """Bytes, at most `most`."""

    def __init__(self, most: int) -> None:
        self.most = most

    def check(self, value: Any) -> bytes:
        if not isinstance(value, bytes) or len(value) > self.most:
            raise Refused(f"got {clip(value)}, expected at most {self.most} bytes")
        return value

    def to_wire(self, value: Any) -> bytes:
        data: bytes = value
        return data

    def from_wire(self, raw: Any) -> bytes:
        return self.check(raw)

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "x-msgpack": "binary"}

    def describe(self) -> str:
        return f"binary, at most {self.most} bytes"


Keys = Rows(KEY_DTYPE, MAX_HAVE)
Bits = Annotated[
    bytes | None,
    Binary(MAX_SERVER_MESSAGE_BYTES),
    "Base faces, one bit each, the lowest bit first, in a gzip stream",
]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hello(ClientMessage):
    """First message of a connection."""

    TYPE: ClassVar[str] = "hello"

    client: Annotated[str, Text(128), "Name and version of the client, for logs"]
    token: Annotated[
        str | None, Text(MAX_TOKEN_BYTES), "Bearer token, where it was not given before"
    ] = None
    budgets: Annotated[Budgets, PartKind(Budgets), "Most of what a landing shows"]
    credit_bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload that may be sent at first"]


Coarse = Annotated[
    float | None,
    Number(0.0, MAX_RADIUS_M, low_excluded=True),
    "The coarser level is shown beyond radius_m up to it",
]
Have = Annotated[NDArray[Any], Keys, "Keys of segments that the client has near that place"]
Without = Annotated[
    NDArray[Any] | None, Rows(KEY_DTYPE, MAX_WITHOUT), "Keys of segments that it cannot use"
]
Taken = Annotated[
    int, Integer(0, MAX_INTEGER), "Payload bytes that have arrived on this connection"
]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prefetch(ClientMessage):
    """Send ahead what a landing at a place needs: the user points there."""

    TYPE: ClassVar[str] = "prefetch"

    generation: Generation
    position: Centre
    radius_m: Radius
    coarse_radius_m: Coarse = None
    have: Have
    without: Without = None
    taken_bytes: Taken

    def contradiction(self) -> tuple[str, str] | None:
        """Compare the radii."""
        coarse_m = self.coarse_radius_m
        if coarse_m is not None and coarse_m < self.radius_m:
            expected = f"expected at least radius_m {self.radius_m:g}"
            return "coarse_radius_m", f"got {coarse_m:g}, {expected}"
        return None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Land(Prefetch):
    """Answer with a plan, send the segments that the client does not have, then ``ready``."""

    TYPE: ClassVar[str] = "land"

    inner_radius_m: Annotated[
        float | None,
        Number(0.0, MAX_RADIUS_M, low_excluded=True),
        "A smaller set that the client may show first",
    ] = None

    def contradiction(self) -> tuple[str, str] | None:
        """Compare the radii."""
        if self.inner_radius_m is not None and self.inner_radius_m > self.radius_m:
            expected = f"expected at most radius_m {self.radius_m:g}"
            return "inner_radius_m", f"got {self.inner_radius_m:g}, {expected}"
        return Prefetch.contradiction(self)


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


MESSAGES: Final[dict[Direction, dict[str, type[Message]]]] = {
    direction: {message.TYPE: message for message in classes}
    for direction, classes in (
        (
            Direction.CLIENT_TO_SERVER,
            (Hello, Land, Prefetch, Credit, Pick, Bye, Join, Leave, Gather, Arrived),
        ),
        (
            Direction.SERVER_TO_CLIENT,
            (
                Welcome,
                Plan,
                Ready,
                Picked,
                Notice,
                Error,
                Joined,
                Roster,
                Gathering,
                Gathered,
            ),
        ),
    )
}
"""Message class by direction and type."""

decode = partial(codec.decode, messages=MESSAGES)
"""As :func:`terraport_wire.decode`, for messages of protocol 2."""


@dataclasses.dataclass(frozen=True, slots=True)
class Frame:
    """A piece of one segment's payload."""

    generation: int
    key: int
    offset: int
    total: int
    """Bytes of the whole payload."""
    data: memoryview
    """A view of the received message."""


def frame_header(*, generation: int, key: int, offset: int, total: int) -> bytes:
    """Return the 24 bytes before a piece of payload."""
    return _HEADER.pack(_KIND, FRAME_HEADER_BYTES, generation, key, offset, total)


def decode_frame(data: bytes | memoryview) -> Frame | None:
    """Return the frame in one WebSocket message; None for a kind that is to be skipped.

    Raises
    ------
    MalformedError
        If it is cut off or contradicts itself.
    """
    view = memoryview(data)
    if not 0 < len(view) <= MAX_FRAME_BYTES or not 0 < view[0] < 0x80:
        raise MalformedError(f"got {len(view)} bytes, expected a frame", offset=0)
    if view[0] != _KIND:
        return None
    if len(view) < FRAME_HEADER_BYTES:
        raise MalformedError(f"got {len(view)} bytes, expected a header", offset=0)
    _, header_bytes, generation, key, offset, total = _HEADER.unpack_from(view)
    payload = view[header_bytes:]
    if (
        not FRAME_HEADER_BYTES <= header_bytes <= MAX_HEADER_BYTES
        or total > MAX_SEGMENT_BYTES
        or not 0 < len(payload) <= total - offset
    ):
        text = f"got {len(payload)} bytes at {offset} of {total}, header {header_bytes}"
        raise MalformedError(f"{text}, expected a part of a segment", offset=2)
    return Frame(generation, key, offset, total, payload)
