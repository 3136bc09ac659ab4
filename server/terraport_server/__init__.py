"""terraport service: scenes in, landings out.

:func:`create_app` makes the ASGI application, :func:`run` serves it, :class:`BackgroundServer` runs
it in a thread. ``session`` and ``groups`` decide (pure: no I/O, no clock), ``stream`` and ``http``
speak with clients, ``scenes`` reads what is served, ``auth`` says who may see it.
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
"""Module of each name, imported at first use, so that ``terraport serve --help`` is quick."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
