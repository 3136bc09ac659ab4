"""All messages of the protocol, and the tables that name them by direction.

A type is known in one direction only: a server that receives a ``plan`` treats it as it would any
unknown type.
"""

from __future__ import annotations

import dataclasses

from . import client_messages, group_messages, server_messages
from .message import Direction, Message

__all__ = ["MESSAGES", "Direction", "Message", "Unknown"]

_CLASSES: list[type] = [
    value
    for module in (client_messages, server_messages, group_messages)
    for value in vars(module).values()
    if isinstance(value, type) and value.__module__ == module.__name__
]

MESSAGES: dict[Direction, dict[str, type[Message]]] = {
    direction: {
        message.TYPE: message
        for message in _CLASSES
        if issubclass(message, Message)
        and "TYPE" in vars(message)
        and message.DIRECTION is direction
    }
    for direction in (Direction.CLIENT_TO_SERVER, Direction.SERVER_TO_CLIENT)
}
"""Message class by direction and type on the wire."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unknown:
    """A message of a type that this version does not know: skip it.

    Attributes
    ----------
    type : str
        Its type, at most 64 characters of it.
    """

    type: str
