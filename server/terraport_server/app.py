"""The ASGI application: FastAPI with the stream, the HTTP endpoints, and a service behind them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, WebSocket

from terraport_server.endpoints import add_routes
from terraport_server.service import Service, server_name
from terraport_server.settings import Settings
from terraport_server.stream import stream

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
        version=server_name().removeprefix("terraport").strip() or "0",
        lifespan=lifespan,
        redoc_url=None,
    )
    app.state.service = service
    add_routes(app)

    @app.websocket("/scenes/{scene_id}/stream")
    async def stream_endpoint(websocket: WebSocket, scene_id: str) -> None:
        await stream(websocket, scene_id, service)

    return app
