"""All messages of the protocol, and the tables that name them by direction.

A type is known in one direction only: a server that receives a ``plan`` treats it as it would any
unknown type.
"""

from __future__ import annotations

import dataclasses

from .client_messages import Aim, Budgets, Bye, Credit, Evict, Held, Hello, Land, Pick, Reject
from .group_messages import (
    Arrived,
    Gather,
    Gathered,
    Gathering,
    Join,
    Joined,
    Leave,
    Member,
    Roster,
)
from .message import Direction, Message, Part
from .server_messages import (
    Degraded,
    Error,
    HeldChecked,
    Hit,
    Notice,
    Picked,
    Plan,
    Prefetch,
    Ready,
    SceneInfo,
    ServerLimits,
    Superseded,
    Timings,
    Welcome,
)

__all__ = [
    "MESSAGES",
    "PARTS",
    "Aim",
    "Arrived",
    "Budgets",
    "Bye",
    "Credit",
    "Degraded",
    "Direction",
    "Error",
    "Evict",
    "Gather",
    "Gathered",
    "Gathering",
    "Held",
    "HeldChecked",
    "Hello",
    "Hit",
    "Join",
    "Joined",
    "Land",
    "Leave",
    "Member",
    "Message",
    "Notice",
    "Part",
    "Pick",
    "Picked",
    "Plan",
    "Prefetch",
    "Ready",
    "Reject",
    "Roster",
    "SceneInfo",
    "ServerLimits",
    "Superseded",
    "Timings",
    "Unknown",
    "Welcome",
]

_CLIENT: tuple[type[Message], ...] = (
    Hello,
    Aim,
    Land,
    Credit,
    Evict,
    Reject,
    Pick,
    Bye,
    Held,
    Join,
    Leave,
    Gather,
    Arrived,
)
_SERVER: tuple[type[Message], ...] = (
    Welcome,
    Plan,
    Prefetch,
    Ready,
    Degraded,
    Superseded,
    Picked,
    Notice,
    Error,
    HeldChecked,
    Joined,
    Roster,
    Gathering,
    Gathered,
)

MESSAGES: dict[Direction, dict[str, type[Message]]] = {
    Direction.CLIENT_TO_SERVER: {message.TYPE: message for message in _CLIENT},
    Direction.SERVER_TO_CLIENT: {message.TYPE: message for message in _SERVER},
}
"""Message class by direction and type on the wire."""

PARTS: tuple[type[Part], ...] = (Budgets, SceneInfo, ServerLimits, Hit, Timings, Member)
"""Maps that stand inside messages."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unknown:
    """A message of a type that this version does not know: skip it.

    Attributes
    ----------
    type : str
        Its type, at most 64 characters of it.
    """

    type: str
