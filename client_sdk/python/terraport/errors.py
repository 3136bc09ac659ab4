"""Exceptions of the SDK.

::

    TerraportError
    ├── UsageError (also ValueError)          the caller passed something that cannot work
    ├── MissingExtraError (also ImportError)  a function needs a package that is not installed
    ├── SessionClosedError                    the session ended before an answer came
    ├── ConnectionFailedError                 no connection within the attempts allowed
    ├── ServerError                           the server refused, with a code of the protocol
    ├── ProtocolViolationError                the server sent what the protocol does not allow
    ├── HttpError                             an HTTP request failed
    ├── LandingError
    │   ├── LandingSupersededError            a newer landing took its place
    │   ├── LandingTimeoutError (also TimeoutError)
    │   └── LandingIncompleteError            some segments could not be delivered whole
    └── GroupError                            a group landing or a group is over

    OutsideSceneWarning (a UserWarning)       a landing where nothing of the scene can be

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = [
    "ConnectionFailedError",
    "GroupError",
    "HttpError",
    "LandingError",
    "LandingIncompleteError",
    "LandingSuperseded",
    "LandingSupersededError",
    "LandingTimeoutError",
    "MissingExtraError",
    "OutsideSceneWarning",
    "ProtocolViolationError",
    "ServerError",
    "SessionClosedError",
    "TerraportError",
    "UsageError",
]


class TerraportError(Exception):
    """Base of every error that this package raises on purpose."""


class OutsideSceneWarning(UserWarning):
    """A landing farther from the scene than its radius: it succeeds, and nothing is there.

    An application whose user may leave the scene looks at :attr:`terraport.Landing.outside_m`, and
    silences this one by :func:`warnings.filterwarnings`.
    """


class UsageError(TerraportError, ValueError):
    """A call that cannot work, whatever the server says."""


@dataclass(eq=False)
class MissingExtraError(TerraportError, ImportError):
    """A function needs packages that the core install does not bring."""

    what: str
    """What was asked for."""
    install: str
    """What to give to pip, for example ``terraport[pipeline]`` or ``trimesh``."""

    def __str__(self) -> str:
        return f'{self.what} needs packages that are not installed: pip install "{self.install}"'


@dataclass(eq=False)
class SessionClosedError(TerraportError):
    """The session ended before the answer came."""

    reason: str

    def __str__(self) -> str:
        return f"the session is closed: {self.reason}"


@dataclass(eq=False)
class ConnectionFailedError(TerraportError):
    """No connection within the attempts allowed."""

    url: str
    attempts: int
    cause: str
    """Text of the last failure."""

    def __str__(self) -> str:
        tries = "attempt" if self.attempts == 1 else "attempts"
        return f"no connection to {self.url} after {self.attempts} {tries}: {self.cause}"


@dataclass(eq=False)
class ServerError(TerraportError):
    """The server refused something, in the words of the wire protocol."""

    code: str
    """Stable error code, for example ``"unauthorised"``; see ``spec/protocol.md``."""
    message: str
    fatal: bool = False
    """True when the server closes the connection with it."""

    def __str__(self) -> str:
        return f"the server answered {self.code}: {self.message}"


@dataclass(eq=False)
class ProtocolViolationError(TerraportError):
    """The server broke the wire protocol; the connection cannot be used any further."""

    message: str

    def __str__(self) -> str:
        return f"the server broke the protocol: {self.message}"


@dataclass(eq=False)
class HttpError(TerraportError):
    """An HTTP request failed."""

    url: str
    status: int
    """HTTP status; 0 when no answer came at all."""
    message: str

    def __str__(self) -> str:
        answered = f"answered {self.status}" if self.status else "did not answer"
        return f"{self.url} {answered}: {self.message}"


@dataclass(eq=False)
class GroupError(TerraportError):
    """A group landing, or the group, is over for this member; the session lives on."""

    message: str

    def __str__(self) -> str:
        return self.message


class LandingError(TerraportError):
    """One landing failed; the session lives on and the previous landing stays visible."""


@dataclass(eq=False)
class LandingSupersededError(LandingError):
    """A newer landing took this one's place before it was ready."""

    landing: int
    by: int
    """Number of the landing that took its place."""

    def __str__(self) -> str:
        return f"landing {self.landing} was superseded by landing {self.by}"


LandingSuperseded = LandingSupersededError
"""The short name under which the package exports it."""


@dataclass(eq=False)
class LandingTimeoutError(LandingError, TimeoutError):
    """``ready(timeout_s=...)`` ran out; the landing continues."""

    landing: int
    timeout_s: float
    received: int
    """Segments that have arrived or were held already."""
    expected: int
    """Segments of the plan; 0 before the plan came."""

    def __str__(self) -> str:
        if self.expected == 0:
            return f"landing {self.landing} got no plan within {self.timeout_s:g} s"
        return (
            f"landing {self.landing} has {self.received} of {self.expected} segments "
            f"after {self.timeout_s:g} s"
        )


@dataclass(eq=False)
class LandingIncompleteError(LandingError):
    """All but these segments are there; over these the base mesh stays, so nothing is open."""

    landing: int
    missing: Sequence[int]
    """Segment ids that the server listed as missing or that came damaged twice."""

    def __str__(self) -> str:
        shown = ", ".join(str(segment) for segment in self.missing[:8])
        more = f" and {len(self.missing) - 8} more" if len(self.missing) > 8 else ""
        return (
            f"landing {self.landing} is ready but for {len(self.missing)} segment(s) "
            f"that could not be delivered whole: {shown}{more}"
        )
