"""terraport service: scenes in, landings out.

:func:`create_app` makes the ASGI application, :func:`run` serves it, :class:`BackgroundServer` runs
it in a thread. :mod:`~terraport_server.selection`, :mod:`~terraport_server.session` and what they
are made of are PURE; everything that touches the network is in :mod:`~terraport_server.sender`.
"""

from __future__ import annotations

from terraport_server.app import create_app
from terraport_server.background_server import BackgroundServer
from terraport_server.serving import run
from terraport_server.settings import Settings

__all__ = ["BackgroundServer", "Settings", "create_app", "run"]
