"""The ASGI application: FastAPI with the stream, the HTTP endpoints, and a service behind them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, WebSocket
from fastapi.middleware.cors import CORSMiddleware

from terraport_server.app_guard import AppGuard
from terraport_server.endpoints import add_routes
from terraport_server.page_endpoints import add_page_routes
from terraport_server.service import Service
from terraport_server.settings import Settings
from terraport_server.stream import stream
from terraport_wire import PROTOCOL

__all__ = ["create_app"]


def create_app(settings: Settings) -> FastAPI:
    """Make the application of one server process.

    Parameters
    ----------
    settings
        Everything that can be set.

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
    service = Service(settings)

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        await service.start()
        try:
            yield
        finally:
            await service.drain()
            await service.stop()

    app = FastAPI(
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
    add_routes(app)
    if settings.allowed_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=list(settings.allowed_origins),
            allow_methods=["GET"],
            allow_headers=["Authorization", "If-None-Match", "Range"],
            expose_headers=["Content-Range", "ETag"],
        )
    app.add_middleware(AppGuard, service=service)

    @app.websocket("/scenes/{scene_id}/stream")
    async def stream_endpoint(websocket: WebSocket, scene_id: str) -> None:
        await stream(websocket, scene_id, service)

    add_page_routes(app)
    return app
