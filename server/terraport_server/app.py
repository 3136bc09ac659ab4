"""The ASGI application: FastAPI with the stream, the HTTP endpoints, and a service behind them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket

from terraport_server.http.guard import AppGuard
from terraport_server.http.scenes import add_routes
from terraport_server.http.stream import stream
from terraport_server.http.viewer import read_viewer, viewer_routes
from terraport_server.limits import DEFAULT_LIMITS, Limits
from terraport_server.service import Service
from terraport_server.settings import Settings
from terraport_wire import PROTOCOL

__all__ = ["create_app"]

_BEFORE_ID: Final = "/scenes/"
_BEHIND_ID: Final = "/stream"


class _Application(FastAPI):
    """FastAPI, past which streams go: eleven calls deep, its stack took 12 KB of each session."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = scope.get("path", "")
        if scope["type"] == "websocket" and path.endswith(_BEHIND_ID):
            scene_id = path.removesuffix(_BEHIND_ID).removeprefix(_BEFORE_ID)
            if path.startswith(_BEFORE_ID) and scene_id and "/" not in scene_id:
                await stream(WebSocket(scope, receive, send), scene_id, self.state.service)
                return
        await super().__call__(scope, receive, send)


def create_app(settings: Settings, limits: Limits = DEFAULT_LIMITS) -> FastAPI:
    """Make the application of one server process.

    Parameters
    ----------
    settings
        Everything that an operator sets.
    limits
        The fixed limits.

    Returns
    -------
    FastAPI
        ``app.state.service`` is its :class:`Service`.

    Raises
    ------
    SettingsError
        When the settings cannot be served with, or not safely.
    """
    settings.check()
    service = Service(settings, limits)

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        await service.start()
        try:
            yield
        finally:
            await service.stop()

    app = _Application(
        title="terraport",
        summary="Scenes for landings: base mesh, segments, and a stream",
        # Of the protocol: a stranger need not know which of its bugs this service has.
        version=f"{PROTOCOL[0]}.{PROTOCOL[1]}",
        lifespan=lifespan,
        docs_url="/docs" if settings.serves_docs else None,
        openapi_url="/openapi.json" if settings.serves_docs else None,
        redoc_url=None,
        # Otherwise /scenes/ answers with an absolute address made of the Host header.
        redirect_slashes=False,
    )
    app.state.service = service
    app.state.viewer = read_viewer(settings)
    add_routes(app)
    if settings.allowed_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=list(settings.allowed_origins),
            allow_methods=["GET", "POST", "DELETE"],
            allow_headers=["Authorization", "Content-Type", "If-None-Match", "Range"],
            expose_headers=["Content-Range", "ETag"],
        )
    app.add_middleware(AppGuard, service=service)
    app.router.routes.extend(viewer_routes)
    return app
