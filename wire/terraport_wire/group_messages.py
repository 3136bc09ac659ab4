"""Messages of groups: several clients that land together (spec/protocol.md, section 10)."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .client_messages import Centre, ClientMessage, Radius, inner_radius_problem
from .kinds import Choice, Flag, Integer, Number, Position, Rows, Text
from .limits import MAX_DEADLINE_MS, MAX_GROUP_MEMBERS, MAX_GROUP_NAME, MAX_RADIUS_M
from .message import Part, PartList
from .server_messages import ServerMessage

__all__ = [
    "Arrived",
    "Gather",
    "Gathered",
    "Gathering",
    "Join",
    "Joined",
    "Leave",
    "Member",
    "Roster",
]

_U32 = 2**32 - 1
_MEMBERS = Rows(np.dtype("<u4"), MAX_GROUP_MEMBERS)

Request = Annotated[int, Integer(0, _U32), "Number chosen by the client, for the answer"]
GroupName = Annotated[
    str,
    Text(MAX_GROUP_NAME, shortest=1, pattern="[A-Za-z0-9_.~-]+"),
    "Name of the group, within the scene",
]
GatheringNumber = Annotated[
    int, Integer(1, _U32), "Number of the group landing, chosen by the server"
]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Join(ClientMessage):
    """Take a seat in a group of this scene; it is made if there is none of that name."""

    TYPE: ClassVar[str] = "join"

    request: Request
    group: GroupName
    role: Annotated[str, Choice("guide", "member"), "A guide moves the group; one at most"]
    name: Annotated[
        str | None, Text(MAX_GROUP_NAME, shortest=1), "What the others call this member"
    ] = None
    seat: Annotated[
        str | None,
        Text(64, shortest=1),
        "Secret of the seat held before, to take it again after a lost connection",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Leave(ClientMessage):
    """Give up the seat in the group."""

    TYPE: ClassVar[str] = "leave"


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Gather(ClientMessage):
    """The guide lands the group."""

    TYPE: ClassVar[str] = "gather"

    request: Request
    position: Centre
    radius_m: Radius
    inner_radius_m: Annotated[
        float | None,
        Number(0.0, MAX_RADIUS_M, low_excluded=True),
        "Radius in metres of the inner set; at most radius_m",
    ] = None
    deadline_ms: Annotated[
        int | None,
        Integer(1, MAX_DEADLINE_MS),
        "Milliseconds after which the barrier opens without who is missing; absent means the "
        "server's default",
    ] = None

    def contradiction(self) -> tuple[str, str] | None:
        """Check the inner radius against the radius."""
        return inner_radius_problem(self.inner_radius_m, self.radius_m)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Arrived(ClientMessage):
    """A member's part of a group landing is over."""

    TYPE: ClassVar[str] = "arrived"

    gathering: GatheringNumber
    state: Annotated[
        str,
        Choice("ready", "degraded", "declined"),
        "`ready`: shows its landing; `degraded`: its inner set; `declined`: will not come",
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Joined(ServerMessage):
    """Answer to join: the seat in the group."""

    TYPE: ClassVar[str] = "joined"

    request: Annotated[int, Integer(0, _U32), "Request, as received"]
    group: GroupName
    member: Annotated[int, Integer(1, _U32), "Number of this member in the group"]
    role: Annotated[str, Choice("guide", "member"), "As granted"]
    seat: Annotated[
        str, Text(64, shortest=1), "Secret by which this seat is taken again, for this client alone"
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Member(Part):
    """One seat of a group."""

    member: Annotated[int, Integer(1, _U32), "Number in the group, never given again in it"]
    name: Annotated[
        str | None, Text(MAX_GROUP_NAME, shortest=1), "What it calls itself, for people"
    ] = None
    role: Annotated[str, Choice("guide", "member"), "A group has one guide at most"]
    present: Annotated[bool, Flag(), "False where its connection is lost and its seat is kept"]
    position: Annotated[
        tuple[float, float, float] | None,
        Position(),
        "Centre of its last landing, metres of the scene frame (x, y, z); absent before the first",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Roster(ServerMessage):
    """Who is in the group, newest state; the ones between may be left out."""

    TYPE: ClassVar[str] = "roster"

    group: GroupName
    members: Annotated[
        tuple[Member, ...], PartList(Member, MAX_GROUP_MEMBERS), "All seats, ascending number"
    ]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Gathering(ServerMessage):
    """The guide lands the group: land there, then say arrived."""

    TYPE: ClassVar[str] = "gathering"

    gathering: GatheringNumber
    guide: Annotated[int, Integer(1, _U32), "Number of the member who asked for it"]
    position: Annotated[
        tuple[float, float, float], Position(), "Centre in metres of the scene frame (x, y, z)"
    ]
    radius_m: Radius
    inner_radius_m: Annotated[
        float | None,
        Number(0.0, MAX_RADIUS_M, low_excluded=True),
        "Radius in metres of the inner set",
    ] = None
    left_ms: Annotated[
        int | None,
        Integer(0, MAX_DEADLINE_MS),
        "Milliseconds until the barrier opens at the latest; absent where it has: nobody waits",
    ] = None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Gathered(ServerMessage):
    """The barrier is open: everybody has arrived, or the deadline has passed."""

    TYPE: ClassVar[str] = "gathered"

    gathering: GatheringNumber
    ready: Annotated[NDArray[Any], _MEMBERS, "Members that show their landing"]
    degraded: Annotated[NDArray[Any], _MEMBERS, "Members that show the inner set"]
    missing: Annotated[NDArray[Any], _MEMBERS, "Members that declined, or did not arrive in time"]
