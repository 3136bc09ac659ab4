"""Errors of the service.

::

    ServerError
    ├── SettingsError       what the operator asked for cannot be (``setting``)
    ├── UnknownSceneError   no scene of that id, or not that version of it (``scene_id``)
    ├── AccessError         a request without the right token (``code``)
    ├── RequestError        an HTTP request that cannot be answered (``status``, ``code``)
    └── PickTimeoutError    a pick took longer than it may

Peers see a stable code and a text; the codes, close codes and HTTP statuses are
:mod:`terraport_wire.errors`'. PURE: no I/O, no clock.
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
    """Base of all errors of the service."""


class SettingsError(ServerError):
    """What the operator asked for cannot be.

    Parameters
    ----------
    setting : str
        Name of the setting.
    what : str
        What was found and what was expected, lower-case, no full stop.
    """

    def __init__(self, setting: str, what: str) -> None:
        super().__init__(setting, what)
        self.setting = setting
        self.what = what

    def __str__(self) -> str:
        return f"{self.setting}: {self.what}"


class UnknownSceneError(ServerError):
    """No scene of that id, or not that version of it.

    Parameters
    ----------
    scene_id : str
        What was asked for.
    version : str, optional
        The version asked for, where the scene is known.
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
    """A request without the right token.

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
    """An HTTP request that cannot be answered.

    Parameters
    ----------
    status : int
        HTTP status.
    code : str
        Stable code.
    what : str
        What was received and what was expected.
    """

    def __init__(self, status: int, code: str, what: str) -> None:
        super().__init__(status, code, what)
        self.status = status
        self.code = code
        self.what = what

    def __str__(self) -> str:
        return self.what


class PickTimeoutError(ServerError):
    """A pick took longer than it may.

    Parameters
    ----------
    segments : int
        Segments looked at until then.
    """

    def __init__(self, segments: int) -> None:
        super().__init__(segments)
        self.segments = segments

    def __str__(self) -> str:
        return f"time was up after {self.segments} segments, expected an answer before"


def http_status(code: ErrorCode) -> int:
    """HTTP status beside an error code."""
    return HTTP_STATUS[CLOSE_CODES[code]]
