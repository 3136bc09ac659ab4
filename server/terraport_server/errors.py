"""Errors of the service.

::

    ServerError
    ├── SettingsError       a setting is not valid (``setting``)
    ├── UnknownSceneError   unknown scene or version (``scene_id``)
    ├── AccessError         a request without a valid token (``code``)
    ├── RequestError        an HTTP request is refused (``status``, ``code``)
    └── PickTimeoutError    a pick exceeded its limits

Clients receive a stable code and a text; :mod:`terraport_wire.errors` has the codes, close codes
and HTTP statuses. PURE: no I/O, no clock.
"""

from __future__ import annotations

from terraport_wire import CLOSE_CODES, HTTP_STATUS, ErrorCode

__all__ = [
    "AccessError",
    "PickTimeoutError",
    "RequestError",
    "ServerError",
    "SettingsError",
    "UnknownSceneError",
    "http_status",
]


class ServerError(Exception):
    """Base class of all errors of the service."""


class SettingsError(ServerError):
    """A setting is not valid.

    Parameters
    ----------
    setting : str
        Name of the setting.
    what : str
        "got X, expected Y", lower-case, no full stop.
    """

    def __init__(self, setting: str, what: str) -> None:
        super().__init__(setting, what)
        self.setting = setting
        self.what = what

    def __str__(self) -> str:
        return f"{self.setting}: {self.what}"


class UnknownSceneError(ServerError):
    """The scene, or this version of it, is not served.

    Parameters
    ----------
    scene_id : str
        The requested id.
    version : str, optional
        The requested version, if the scene is known.
    """

    code = ErrorCode.UNKNOWN_SCENE

    def __init__(self, scene_id: str, version: str | None = None) -> None:
        super().__init__(scene_id, version)
        self.scene_id = scene_id
        self.version = version

    def __str__(self) -> str:
        if self.version is None:
            return f"no scene {self.scene_id[:64]!r} here, expected one that GET /scenes lists"
        return f"no version {self.version[:64]!r} of scene {self.scene_id!r}, expected the newest"


class AccessError(ServerError):
    """A request has no valid token.

    Parameters
    ----------
    code : ErrorCode
        ``UNAUTHORISED`` or ``FORBIDDEN``.
    """

    def __init__(self, code: ErrorCode) -> None:
        super().__init__(code)
        self.code = code

    def __str__(self) -> str:
        if self.code is ErrorCode.FORBIDDEN:
            return "got a token that does not open this scene, expected one that does"
        return "got no token or a wrong one, expected Authorization: Bearer TOKEN"


class RequestError(ServerError):
    """An HTTP request is refused.

    Parameters
    ----------
    status : int
        HTTP status.
    code : str
        Stable error code.
    what : str
        "got X, expected Y".
    """

    def __init__(self, status: int, code: str, what: str) -> None:
        super().__init__(status, code, what)
        self.status = status
        self.code = code
        self.what = what

    def __str__(self) -> str:
        return self.what


class PickTimeoutError(ServerError):
    """A pick exceeded its time or number of segments.

    Parameters
    ----------
    segments : int
        Number of segments examined.
    """

    def __init__(self, segments: int) -> None:
        super().__init__(segments)
        self.segments = segments

    def __str__(self) -> str:
        return f"no answer after {self.segments} segments, expected one within the limits"


def http_status(code: ErrorCode) -> int:
    """Return the HTTP status of an error code."""
    return HTTP_STATUS[CLOSE_CODES[code]]
