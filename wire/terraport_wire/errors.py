"""Errors of the wire, and the tables that map them to close codes and HTTP status.

::

    WireError
    ├── InvalidMessageError     our own side tried to make a message that is not allowed
    └── DecodeError             what the peer sent is not allowed
        ├── MalformedError      bytes or text that are no message and no payload frame
        ├── TooLargeError       longer than the limit for its direction
        └── FieldError          a known message with a missing, mistyped or out-of-range field
"""

from __future__ import annotations

from enum import IntEnum, StrEnum, unique

__all__ = [
    "CLOSE_CODES",
    "HTTP_STATUS",
    "CloseCode",
    "DecodeError",
    "ErrorCode",
    "FieldError",
    "InvalidMessageError",
    "MalformedError",
    "TooLargeError",
    "WireError",
]


@unique
class CloseCode(IntEnum):
    """WebSocket close codes (4000-4999 is the range for applications, RFC 6455 section 7.4.2)."""

    NORMAL = 1000
    MALFORMED = 4400
    UNAUTHORISED = 4401
    FORBIDDEN = 4403
    UNKNOWN_SCENE = 4404
    TIMEOUT = 4408
    VERSION = 4409
    TOO_LARGE = 4413
    TOO_MANY = 4429
    INTERNAL = 4500
    DRAINING = 4503


@unique
class ErrorCode(StrEnum):
    """Codes of the ``error`` message. A receiver treats one it does not know by ``fatal`` alone."""

    MALFORMED = "malformed"
    INVALID_FIELD = "invalid_field"
    OUT_OF_ORDER = "out_of_order"
    RADIUS_TOO_LARGE = "radius_too_large"
    UNAUTHORISED = "unauthorised"
    FORBIDDEN = "forbidden"
    UNKNOWN_SCENE = "unknown_scene"
    TIMEOUT = "timeout"
    UNSUPPORTED_VERSION = "unsupported_version"
    TOO_LARGE = "too_large"
    TOO_MANY = "too_many"
    INTERNAL = "internal"
    DRAINING = "draining"
    GROUP_REFUSED = "group_refused"


CLOSE_CODES: dict[ErrorCode, CloseCode] = {
    ErrorCode.MALFORMED: CloseCode.MALFORMED,
    ErrorCode.INVALID_FIELD: CloseCode.MALFORMED,
    ErrorCode.OUT_OF_ORDER: CloseCode.MALFORMED,
    ErrorCode.RADIUS_TOO_LARGE: CloseCode.MALFORMED,
    ErrorCode.UNAUTHORISED: CloseCode.UNAUTHORISED,
    ErrorCode.FORBIDDEN: CloseCode.FORBIDDEN,
    ErrorCode.UNKNOWN_SCENE: CloseCode.UNKNOWN_SCENE,
    ErrorCode.TIMEOUT: CloseCode.TIMEOUT,
    ErrorCode.UNSUPPORTED_VERSION: CloseCode.VERSION,
    ErrorCode.TOO_LARGE: CloseCode.TOO_LARGE,
    ErrorCode.TOO_MANY: CloseCode.TOO_MANY,
    ErrorCode.INTERNAL: CloseCode.INTERNAL,
    ErrorCode.DRAINING: CloseCode.DRAINING,
    ErrorCode.GROUP_REFUSED: CloseCode.FORBIDDEN,
}
"""The close code of each error where it is fatal."""

HTTP_STATUS: dict[CloseCode, int] = {
    CloseCode.NORMAL: 200,
    CloseCode.MALFORMED: 400,
    CloseCode.UNAUTHORISED: 401,
    CloseCode.FORBIDDEN: 403,
    CloseCode.UNKNOWN_SCENE: 404,
    CloseCode.TIMEOUT: 408,
    CloseCode.VERSION: 409,
    CloseCode.TOO_LARGE: 413,
    CloseCode.TOO_MANY: 429,
    CloseCode.INTERNAL: 500,
    CloseCode.DRAINING: 503,
}
"""The HTTP status of a refusal before the WebSocket is open: the close code less 4000."""


class WireError(Exception):
    """Base of every error of this package."""


class InvalidMessageError(WireError, ValueError):
    """A message was constructed with a value that the protocol does not allow (our own fault).

    Attributes
    ----------
    message_type : str
        Type of the message, for example ``"land"``.
    field : str
        Path of the field, for example ``"budgets.max_bytes"``.
    text : str
        What was given and what is expected.
    """

    def __init__(self, message_type: str, field: str, text: str) -> None:
        super().__init__(message_type, field, text)
        self.message_type = message_type
        self.field = field
        self.text = text

    def __str__(self) -> str:
        return f"{self.message_type}.{self.field}: {self.text}"


class DecodeError(WireError):
    """What the peer sent is not allowed.

    Attributes
    ----------
    code : ErrorCode
        Code for the ``error`` message.
    text : str
        What was received and what was expected; safe to show to the peer.
    offset : int or None
        Byte offset in the received message, where one is known.
    fatal : bool
        True if the connection cannot go on.
    """

    code: ErrorCode = ErrorCode.MALFORMED
    fatal: bool = True

    def __init__(self, text: str, *, offset: int | None = None) -> None:
        super().__init__(text)
        self.text = text
        self.offset = offset

    def __str__(self) -> str:
        return self.text if self.offset is None else f"{self.text} (at byte {self.offset})"

    @property
    def close_code(self) -> CloseCode:
        """Close code to use where the error is fatal."""
        return CLOSE_CODES[self.code]


class MalformedError(DecodeError):
    """Bytes or text that are no message and no payload frame."""


class TooLargeError(DecodeError):
    """A message or frame longer than the limit for its direction."""

    code = ErrorCode.TOO_LARGE


class FieldError(DecodeError):
    """A known message with a field that is missing, mistyped or out of range.

    Attributes
    ----------
    message_type : str
        Type of the message.
    field : str
        Path of the field, for example ``"budgets.max_bytes"``.
    generation, request : int or None
        Generation or request of the refused message, where it could be read.
    fatal : bool
        False for ``land``, ``prefetch``, ``pick``, ``join`` and ``gather``: they are
        refused and the session goes on, because nothing was changed by them.  True for every
        other message, and for all of a server: the two sides' views of the session would differ.
    """

    code = ErrorCode.INVALID_FIELD

    def __init__(
        self,
        message_type: str,
        field: str,
        text: str,
        *,
        generation: int | None = None,
        request: int | None = None,
        from_server: bool = False,
    ) -> None:
        super().__init__(text)
        self.message_type = message_type
        self.field = field
        self.generation = generation
        self.request = request
        refusable = {"land", "prefetch", "pick", "join", "gather"}
        self.fatal = from_server or message_type not in refusable

    def __str__(self) -> str:
        return f"{self.message_type}.{self.field}: {self.text}"
