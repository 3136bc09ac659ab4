"""ASGI application: FastAPI with the WebSocket and HTTP endpoints of a service."""

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
from terraport_wire import SUBPROTOCOL

__all__ = ["create_app"]

_BEFORE_ID: Final = "/scenes/"
_BEHIND_ID: Final = "/stream"


class _Application(FastAPI):
    """FastAPI that dispatches streams itself: its middleware stack takes 12 KB per session."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = scope.get("path", "")
        if scope["type"] == "websocket" and path.endswith(_BEHIND_ID):
            scene_id = path.removesuffix(_BEHIND_ID).removeprefix(_BEFORE_ID)
            if path.startswith(_BEFORE_ID) and scene_id and "/" not in scene_id:
                await stream(WebSocket(scope, receive, send), scene_id, self.state.service)
                return
        await super().__call__(scope, receive, send)


def create_app(settings: Settings, limits: Limits = DEFAULT_LIMITS) -> FastAPI:
    """Create the application of a server process.

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
        If the settings are not valid or not safe.
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
        # The protocol's version; that of the software would help attackers.
        version=SUBPROTOCOL.split(".")[1],
        lifespan=lifespan,
        docs_url="/docs" if settings.serves_docs else None,
        openapi_url="/openapi.json" if settings.serves_docs else None,
        redoc_url=None,
        # A redirect of /scenes/ would contain the Host header.
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
