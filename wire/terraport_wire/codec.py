"""Messages to bytes, and back.

``terraport.v2.msgpack`` carries a message as one msgpack map in a binary WebSocket message.  It
holds the key ``type``; unknown types and unknown keys are skipped.
"""

from __future__ import annotations

import base64
import binascii
from typing import Any

import msgpack

from .errors import DecodeError, FieldError, MalformedError, TooLargeError
from .guard import check_msgpack, leading_type
from .kinds import Refused, clip
from .limits import (
    MAX_CLIENT_MESSAGE_BYTES,
    MAX_CLIENT_VALUES,
    MAX_CONTAINER_ITEMS,
    MAX_SERVER_MESSAGE_BYTES,
)
from .message import Direction, Message, from_map, to_map
from .messages import MESSAGES, Unknown

__all__ = [
    "SUBPROTOCOL",
    "TOKEN_PREFIX",
    "decode",
    "encode",
    "is_payload",
    "token_from_subprotocols",
    "token_subprotocol",
]

SUBPROTOCOL = "terraport.v2.msgpack"
"""The WebSocket subprotocol: its name has the version of the protocol."""

TOKEN_PREFIX = "terraport.token."  # noqa: S105 - a name, not a secret

_LIMITS = {
    Direction.CLIENT_TO_SERVER: MAX_CLIENT_MESSAGE_BYTES,
    Direction.SERVER_TO_CLIENT: MAX_SERVER_MESSAGE_BYTES,
}
_MAX_VALUES = {
    Direction.CLIENT_TO_SERVER: MAX_CLIENT_VALUES,
    Direction.SERVER_TO_CLIENT: None,  # bounded by its bytes and by each list's own limit
}
_LONGEST_TYPE = 64
_FIRST_MESSAGE_BYTE = 0x80


def encode(message: Message) -> bytes:
    """Return a message as bytes.

    Keys stand in the order of the message class, ``type`` first; absent fields are left out.  The
    same message gives the same bytes every time.
    """
    data: bytes = msgpack.packb({"type": message.TYPE, **to_map(message)}, use_bin_type=True)
    return data


def decode(
    data: bytes | bytearray | memoryview | str,
    direction: Direction,
    *,
    max_bytes: int | None = None,
) -> Message | Unknown:
    """Return the message that bytes hold.

    Parameters
    ----------
    data : bytes-like or str
        One whole WebSocket message: binary; a text message is malformed.
    direction : Direction
        Who sent it.
    max_bytes : int, optional
        Stricter limit than the protocol's own for this direction.

    Returns
    -------
    Message or Unknown
        `Unknown` for a type that this direction does not have; the caller skips it. Where the
        type stands first, nothing else of the message was looked at.

    Raises
    ------
    MalformedError
        If `data` is no message: wrong frame type, bad structure, no ``type``, too many values.
    TooLargeError
        If it is longer than the limit.
    FieldError
        If a field of a known message is missing, mistyped or out of range.
    """
    limit = _LIMITS[direction] if max_bytes is None else min(max_bytes, _LIMITS[direction])
    data = _whole_bytes(data, limit)
    leading = leading_type(data)
    if leading is not None and leading not in MESSAGES[direction]:
        return Unknown(leading[:_LONGEST_TYPE])  # whatever else it holds costs nothing
    plain = _plain(data, direction)
    if not isinstance(plain, dict):
        raise MalformedError(f"got {clip(plain)}, expected a map with a type")
    type_name = plain.get("type")
    if not isinstance(type_name, str):
        raise MalformedError(f"got type {clip(type_name)}, expected text")
    message = MESSAGES[direction].get(type_name)
    if message is None:
        return Unknown(type_name[:_LONGEST_TYPE])
    try:
        decoded = from_map(message, plain)
    except Refused as refused:
        raise FieldError(
            type_name,
            refused.path,
            refused.text,
            generation=_readable(plain, "generation", message),
            request=_readable(plain, "request", message),
            from_server=direction is Direction.SERVER_TO_CLIENT,
        ) from None
    assert isinstance(decoded, Message)
    return decoded


def is_payload(data: bytes | bytearray | memoryview | str) -> bool:
    """Return True if a WebSocket message is a payload frame, not a message.

    Frame kinds are below 0x80; a msgpack map starts at 0x80 or above; text is never payload.
    """
    return not isinstance(data, str) and len(data) > 0 and data[0] < _FIRST_MESSAGE_BYTE


def token_subprotocol(token: str) -> str:
    """Return the subprotocol entry that carries a token where no header can be set.

    Base64url without padding, because a subprotocol name allows neither ``=`` nor ``/``.
    """
    text = base64.urlsafe_b64encode(token.encode("utf-8")).decode("ascii").rstrip("=")
    return TOKEN_PREFIX + text


def token_from_subprotocols(offered: list[str]) -> str | None:
    """Return the token among the offered subprotocols, or None if there is none that decodes."""
    for entry in offered:
        if entry.startswith(TOKEN_PREFIX):
            text = entry[len(TOKEN_PREFIX) :]
            try:
                padded = text + "=" * (-len(text) % 4)
                return base64.b64decode(padded, altchars=b"-_", validate=True).decode("utf-8")
            except (binascii.Error, UnicodeDecodeError, ValueError):
                return None
    return None


def _whole_bytes(data: bytes | bytearray | memoryview | str, limit: int) -> bytes:
    if isinstance(data, str):
        raise MalformedError("got a text message, expected a binary one (terraport.v2.msgpack)")
    if len(data) > limit:
        raise TooLargeError(f"got a message of {len(data)} bytes, expected at most {limit}")
    return bytes(data)


def _plain(data: bytes, direction: Direction) -> Any:
    check_msgpack(data, max_values=_MAX_VALUES[direction])
    try:
        return msgpack.unpackb(
            data,
            raw=False,
            strict_map_key=False,
            object_pairs_hook=_unique_keys,
            max_array_len=MAX_CONTAINER_ITEMS,
            max_map_len=MAX_CONTAINER_ITEMS,
        )
    except DecodeError:
        raise
    except UnicodeDecodeError as error:
        raise MalformedError("got text that is not UTF-8") from error
    except (msgpack.UnpackException, ValueError) as error:  # e.g. the library's own limits
        raise MalformedError("got bytes that are no msgpack value") from error


def _unique_keys(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    for key, value in pairs:
        if not isinstance(key, str):
            raise MalformedError(f"got key {clip(key)}, expected text")
        if key in keys:
            raise MalformedError(f"got key {clip(key)} twice, expected each key once")
        keys[key] = value
    return keys


def _readable(plain: dict[str, Any], name: str, message: type[Message]) -> int | None:
    """Return the refused message's id for the answer, where it has one that is in range."""
    if name not in message.__dataclass_fields__:  # type: ignore[attr-defined]
        return None
    value = plain.get(name)
    return value if type(value) is int and 0 <= value < 2**32 else None
