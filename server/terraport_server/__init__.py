"""The terraport streaming service.

:func:`create_app` makes the ASGI application, :func:`run` serves it, :class:`BackgroundServer` runs
it in a thread. Packages: ``session`` and ``groups`` (protocol state machines; pure, no I/O, no
clock), ``stream`` (WebSocket), ``http`` (HTTP endpoints), ``scenes`` (open scenes and payload),
``auth`` (tokens and origins).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from terraport_server.app import create_app
    from terraport_server.background_server import BackgroundServer
    from terraport_server.serving import run
    from terraport_server.settings import Settings

__all__ = ["BackgroundServer", "Settings", "create_app", "run"]

_HOMES: Final = {
    "BackgroundServer": "background_server",
    "Settings": "settings",
    "create_app": "app",
    "run": "serving",
}
"""Module of each name, imported on first use so that ``terraport serve --help`` starts fast."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
