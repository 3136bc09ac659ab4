"""Messages that a client sends."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from .kinds import Integer, Number, Position, Rows, Text
from .limits import (
    MAX_GPU_ELEMENT_BYTES,
    MAX_HAVE,
    MAX_INTEGER,
    MAX_RADIUS_M,
    MAX_TOKEN_BYTES,
    MAX_WITHOUT,
)
from .message import Direction, Message, Part, PartKind

__all__ = [
    "KEY_DTYPE",
    "Budgets",
    "Bye",
    "Credit",
    "Hello",
    "Land",
    "Pick",
    "Prefetch",
    "inner_radius_problem",
]

KEY_DTYPE: Final = np.dtype("<u8")
"""Name of a payload by its content."""

_U32 = 2**32 - 1

Generation = Annotated[
    int, Integer(0, _U32), "Number of the landing or prefetch; rising on one connection"
]
Centre = Annotated[
    tuple[float, float, float], Position(), "Centre in metres of the scene frame (x, y, z)"
]
Radius = Annotated[
    float, Number(0.0, MAX_RADIUS_M, low_excluded=True), "Radius in metres around the centre"
]


class ClientMessage(Message):
    """A message from a client to a server."""

    __slots__ = ()

    DIRECTION: ClassVar[Direction] = Direction.CLIENT_TO_SERVER


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Budgets(Part):
    """Most of what a landing shows; absent means unlimited."""

    max_triangles: Annotated[int | None, Integer(0, MAX_INTEGER), "Most triangles"] = None
    max_bytes: Annotated[int | None, Integer(0, MAX_INTEGER), "Most payload bytes"] = None
    max_segments: Annotated[int | None, Integer(0, MAX_INTEGER), "Most segments"] = None
    max_gpu_bytes: Annotated[
        int | None, Integer(0, MAX_INTEGER), "Most bytes on the client's GPU"
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
    """First message of a connection."""

    TYPE: ClassVar[str] = "hello"

    client: Annotated[str, Text(128), "Name and version of the client, for logs"]
    token: Annotated[
        str | None, Text(MAX_TOKEN_BYTES), "Bearer token, where it was not given before"
    ] = None
    budgets: Annotated[Budgets, PartKind(Budgets), "Most of what a landing shows"]
    credit_bytes: Annotated[int, Integer(0, MAX_INTEGER), "Payload that may be sent at first"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prefetch(ClientMessage):
    """Send ahead what a landing at a place needs: the user points there."""

    TYPE: ClassVar[str] = "prefetch"

    generation: Generation
    position: Centre
    radius_m: Radius
    coarse_radius_m: Annotated[
        float | None,
        Number(0.0, MAX_RADIUS_M, low_excluded=True),
        "The coarser level is shown beyond radius_m up to it",
    ] = None
    have: Annotated[
        NDArray[Any],
        Rows(KEY_DTYPE, MAX_HAVE),
        "Keys of segments that the client has near that place",
    ]
    without: Annotated[
        NDArray[Any] | None, Rows(KEY_DTYPE, MAX_WITHOUT), "Keys of segments that it cannot use"
    ] = None
    taken_bytes: Annotated[
        int, Integer(0, MAX_INTEGER), "Payload bytes that have arrived on this connection"
    ]

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
        problem = inner_radius_problem(self.inner_radius_m, self.radius_m)
        return Prefetch.contradiction(self) if problem is None else problem


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Credit(ClientMessage):
    """Grant more payload bytes."""

    TYPE: ClassVar[str] = "credit"

    bytes: Annotated[int, Integer(1, MAX_INTEGER), "Payload bytes granted beyond what was before"]


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
class Bye(ClientMessage):
    """The client ends the session; the server closes with 1000."""

    TYPE: ClassVar[str] = "bye"


def inner_radius_problem(inner_radius_m: float | None, radius_m: float) -> tuple[str, str] | None:
    """Return field and text where an inner radius is beyond the radius."""
    if inner_radius_m is None or inner_radius_m <= radius_m:
        return None
    text = f"got {inner_radius_m:g}, expected at most radius_m {radius_m:g}"
    return ("inner_radius_m", text)
