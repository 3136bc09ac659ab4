"""Messages to bytes or text, and back.

``terraport.v1.msgpack`` carries a message as one msgpack map in a binary WebSocket message,
``terraport.v1.json`` as one JSON object in a text message.  Both hold the key ``type``; unknown
types and unknown keys are skipped.
"""

from __future__ import annotations

import base64
import binascii
import json
from enum import StrEnum, unique
from typing import Any, NoReturn

import msgpack

from .errors import DecodeError, FieldError, MalformedError, TooLargeError
from .guard import check_depth, check_msgpack
from .kinds import Refused, clip
from .limits import MAX_CLIENT_MESSAGE_BYTES, MAX_CONTAINER_ITEMS, MAX_SERVER_MESSAGE_BYTES
from .message import Direction, Message, from_map, to_map
from .messages import MESSAGES, Unknown

__all__ = [
    "PROTOCOL",
    "TOKEN_PREFIX",
    "Subprotocol",
    "choose_subprotocol",
    "decode",
    "encode",
    "is_payload",
    "token_from_subprotocols",
    "token_subprotocol",
]

PROTOCOL = (1, 1)
"""Version of the protocol that this package speaks: (major, minor)."""

TOKEN_PREFIX = "terraport.token."  # noqa: S105 - a name, not a secret

_LIMITS = {
    Direction.CLIENT_TO_SERVER: MAX_CLIENT_MESSAGE_BYTES,
    Direction.SERVER_TO_CLIENT: MAX_SERVER_MESSAGE_BYTES,
}
_LONGEST_TYPE = 64
_FIRST_MESSAGE_BYTE = 0x80


@unique
class Subprotocol(StrEnum):
    """WebSocket subprotocols, in a server's order of preference."""

    MSGPACK = "terraport.v1.msgpack"
    JSON = "terraport.v1.json"


def encode(message: Message, subprotocol: Subprotocol) -> bytes | str:
    """Return a message as bytes (msgpack) or text (JSON).

    Keys stand in the order of the message class, ``type`` first; absent fields are left out.  The
    same message gives the same bytes every time.
    """
    packed = subprotocol is Subprotocol.MSGPACK
    plain = {"type": message.TYPE, **to_map(message, packed=packed)}
    if packed:
        data: bytes = msgpack.packb(plain, use_bin_type=True)
        return data
    return json.dumps(plain, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def decode(
    data: bytes | bytearray | memoryview | str,
    subprotocol: Subprotocol,
    direction: Direction,
    *,
    max_bytes: int | None = None,
) -> Message | Unknown:
    """Return the message that bytes (msgpack) or text (JSON) hold.

    Parameters
    ----------
    data : bytes-like or str
        One whole WebSocket message: binary for msgpack, text for JSON.
    subprotocol : Subprotocol
        The connection's subprotocol.
    direction : Direction
        Who sent it.
    max_bytes : int, optional
        Stricter limit than the protocol's own for this direction.

    Returns
    -------
    Message or Unknown
        `Unknown` for a type that this direction does not have; the caller skips it.

    Raises
    ------
    MalformedError
        If `data` is no message: wrong frame type, bad structure, no ``type``.
    TooLargeError
        If it is longer than the limit.
    FieldError
        If a field of a known message is missing, mistyped or out of range.
    """
    limit = _LIMITS[direction] if max_bytes is None else min(max_bytes, _LIMITS[direction])
    packed = subprotocol is Subprotocol.MSGPACK
    plain = _plain_msgpack(data, limit) if packed else _plain_json(data, limit)
    if not isinstance(plain, dict):
        raise MalformedError(f"got {clip(plain)}, expected a map with a type")
    type_name = plain.get("type")
    if not isinstance(type_name, str):
        raise MalformedError(f"got type {clip(type_name)}, expected text")
    message = MESSAGES[direction].get(type_name)
    if message is None:
        return Unknown(type_name[:_LONGEST_TYPE])
    try:
        decoded = from_map(message, plain, packed=packed)
    except Refused as refused:
        raise FieldError(
            type_name,
            refused.path,
            refused.text,
            generation=_readable(plain, "generation", message),
            request=_readable(plain, "request", message),
        ) from None
    assert isinstance(decoded, Message)
    return decoded


def is_payload(data: bytes | bytearray | memoryview | str) -> bool:
    """Return True if a WebSocket message is a payload frame, not a message.

    Frame kinds are below 0x80; a msgpack map starts at 0x80 or above; text is never payload.
    """
    return not isinstance(data, str) and len(data) > 0 and data[0] < _FIRST_MESSAGE_BYTE


def choose_subprotocol(offered: list[str]) -> Subprotocol | None:
    """Return the first subprotocol of the server's preference that the client offers."""
    return next((ours for ours in Subprotocol if ours.value in offered), None)


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


def _plain_msgpack(data: bytes | bytearray | memoryview | str, limit: int) -> Any:
    if isinstance(data, str):
        raise MalformedError("got a text message, expected a binary one (terraport.v1.msgpack)")
    _check_size(len(data), limit)
    data = bytes(data)
    check_msgpack(data)
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


def _plain_json(data: bytes | bytearray | memoryview | str, limit: int) -> Any:
    if not isinstance(data, str):
        raise MalformedError("got a binary message, expected a text one (terraport.v1.json)")
    _check_size(len(data), limit)  # characters: a lower bound that saves encoding a huge text
    try:
        _check_size(len(data.encode("utf-8")), limit)
    except UnicodeEncodeError as error:
        raise MalformedError("got text with a lone surrogate") from error
    try:
        plain = json.loads(data, object_pairs_hook=_unique_names, parse_constant=_no_constant)
    except DecodeError:
        raise
    except json.JSONDecodeError as error:
        raise MalformedError(f"got text that is no JSON: {error.msg}", offset=error.pos) from None
    except RecursionError:
        raise MalformedError("got nesting far beyond the limit") from None
    except ValueError:  # an integer with thousands of digits
        raise MalformedError("got a number that is too long") from None
    check_depth(plain)
    return plain


def _check_size(size: int, limit: int) -> None:
    if size > limit:
        raise TooLargeError(f"got a message of {size} bytes, expected at most {limit}")


def _unique_keys(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    keys: dict[str, Any] = {}
    for key, value in pairs:
        if not isinstance(key, str):
            raise MalformedError(f"got key {clip(key)}, expected text")
        if key in keys:
            raise MalformedError(f"got key {clip(key)} twice, expected each key once")
        keys[key] = value
    return keys


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the keys of a JSON object, which are text already."""
    keys = dict(pairs)
    return keys if len(keys) == len(pairs) else _unique_keys(pairs)


def _no_constant(text: str) -> NoReturn:
    raise MalformedError(f"got {text}, expected a finite number")


def _readable(plain: dict[str, Any], name: str, message: type[Message]) -> int | None:
    """Return the refused message's id for the answer, where it has one that is in range."""
    if name not in message.__dataclass_fields__:  # type: ignore[attr-defined]
        return None
    value = plain.get(name)
    return value if type(value) is int and 0 <= value < 2**32 else None
