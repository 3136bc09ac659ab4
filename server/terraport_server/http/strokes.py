"""Endpoints of strokes that people paint on the ground, and of what they have taught.

The service does not learn: ``terraport teach --watch`` reads the strokes and writes what they
taught. The store keeps strokes in the scene's folder.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import time
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from terraport_server.auth.gate import TokenPass
from terraport_server.auth.origins import origin_is_allowed
from terraport_server.errors import AccessError, RequestError
from terraport_server.http.responses import (
    CHECK,
    SceneOfRequest,
    ServiceOfRequest,
    in_pieces,
    is_unchanged,
    token_of,
)
from terraport_server.logging import log
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import (
    StoreError,
    Stroke,
    StrokeError,
    Strokes,
)
from terraport_wire import ErrorCode

__all__ = ["may_paint", "stroke_routes"]

stroke_routes = APIRouter()

_JSON = "application/json"

_MAX_BODY_BYTES = 16 << 10
"""Maximum size of a stroke: one with the most points takes 12 KB."""

_READ_ONLY = (
    "the service cannot write to this scene's folder, expected one that it may write strokes to; "
    "mount the scenes writable, and let the service's user own them"
)


def may_paint(service: Service, token_pass: TokenPass, served: ServedScene) -> bool:
    """Return whether a token's bearer may paint on a scene, and the scene's folder is writable.

    Without authentication, clients on this machine may paint, and no others.
    """
    is_local = served.fetchers is None
    return is_local and _has_right(service, token_pass, served) and _is_writable(served)


def _has_right(service: Service, token_pass: TokenPass, served: ServedScene) -> bool:
    if service.gate.is_open and not service.settings.checks_host:
        return False
    return token_pass.opens(served.id) and "teach" in token_pass.scopes


def _is_writable(served: ServedScene) -> bool:
    """Return whether files can be created in the scene's folder: it may be mounted read-only."""
    return os.access(served.scene.path, os.W_OK)


async def _painter(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest
) -> TokenPass:
    """Return the rights of a bearer who may paint."""
    token_pass = service.gate.find(token_of(request))
    if token_pass is None:
        raise AccessError(ErrorCode.UNAUTHORISED)
    if served.fetchers is not None:
        text = "this scene lies in object storage, expected one in a folder to paint on"
        raise RequestError(409, "no_strokes", text)
    if not _has_right(service, token_pass, served):
        text = "got a token without the right to teach, expected one with the scope teach"
        raise RequestError(403, ErrorCode.FORBIDDEN, text)
    origin, host = request.headers.get("origin"), request.headers.get("host")
    if not origin_is_allowed(origin, host, service.settings.allowed_origins):
        text = "got a request of a page of another origin, expected one of allowed_origins"
        raise RequestError(403, ErrorCode.FORBIDDEN, text)
    if request.method != "GET" and not _is_writable(served):
        raise RequestError(409, "no_strokes", _READ_ONLY)
    return token_pass


Painter = Annotated[TokenPass, Depends(_painter)]


@stroke_routes.get("/scenes/{scene_id}/strokes", summary="Strokes on the ground")
async def get_strokes(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, painter: Painter
) -> Response:
    """List the strokes, with their authors and times."""
    try:
        cached = await service.strokes.read(served.scene.path)
    except (StoreError, OSError) as error:
        raise _unavailable(served, error) from None
    headers = {
        "ETag": f'"{cached.strokes.revision or "none"}"',
        "Cache-Control": CHECK,
        "Vary": "Authorization",
    }
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    pieces = in_pieces(cached.response(painter.name))
    return StreamingResponse(pieces, media_type=_JSON, headers=headers)


@stroke_routes.post("/scenes/{scene_id}/strokes", summary="Paint a stroke", status_code=201)
async def post_stroke(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, painter: Painter
) -> Response:
    """Add a stroke: its name, colour, width and line."""
    _count(service, painter)
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != _JSON:
        # Browsers send this type to another origin only after a preflight request.
        raise RequestError(415, ErrorCode.INVALID_FIELD, f"got another type, expected {_JSON}")
    try:
        body = json.loads(await _body(request))
        stroke = Stroke.painted(
            body,
            stroke_id=secrets.token_hex(8),
            who=painter.name,
            when=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        )
    except StrokeError as error:
        raise RequestError(400, ErrorCode.INVALID_FIELD, f"got {error}") from None
    except (ValueError, RecursionError):
        raise RequestError(
            400, ErrorCode.INVALID_FIELD, "got invalid JSON, expected a stroke"
        ) from None
    strokes = await _changed(service, served, lambda strokes: strokes.with_one(stroke))
    log("stroke painted", scene=served.id, who=painter.name, stroke=stroke.id)
    answer = {"stroke": _row(stroke, painter), "revision": strokes.revision}
    return JSONResponse(answer, status_code=201)


@stroke_routes.delete("/scenes/{scene_id}/strokes/{stroke_id}", summary="Delete a stroke")
async def delete_stroke(
    served: SceneOfRequest, service: ServiceOfRequest, painter: Painter, stroke_id: str
) -> Response:
    """Delete a stroke that the same token painted."""
    _count(service, painter)

    def without(strokes: Strokes) -> Strokes:
        of_id = next((one for one in strokes.strokes if one.id == stroke_id), None)
        if of_id is None:
            text = "got an unknown stroke, expected one that GET .../strokes lists"
            raise RequestError(404, "unknown_stroke", text)
        if of_id.who != painter.name:
            text = f"got a stroke of {of_id.who}, expected one of your own"
            raise RequestError(403, ErrorCode.FORBIDDEN, text)
        return strokes.without(stroke_id)

    strokes = await _changed(service, served, without)
    log("stroke taken back", scene=served.id, who=painter.name, stroke=stroke_id)
    return JSONResponse({"revision": strokes.revision})


@stroke_routes.get("/scenes/{scene_id}/taught", summary="What the strokes have taught")
async def get_taught(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest
) -> Response:
    """Return taught.json; 204 where there is none yet."""
    headers = {"Cache-Control": CHECK, "Vary": "Authorization"}
    if served.fetchers is not None:
        return Response(status_code=204, headers=headers)
    try:
        data, etag = await service.strokes.taught(served.scene.path)
    except (StoreError, OSError) as error:
        raise _unavailable(served, error) from None
    if data is None:
        return Response(status_code=204, headers=headers)
    headers["ETag"] = etag
    if is_unchanged(request, etag):
        return Response(status_code=304, headers=headers)
    return Response(data, media_type=_JSON, headers=headers)


async def _body(request: Request) -> bytes:
    """Return the body of a request; RequestError where it is too long."""
    data = bytearray()
    async for piece in request.stream():
        data += piece
        if len(data) > _MAX_BODY_BYTES:
            text = f"got more than {_MAX_BODY_BYTES} bytes, expected one stroke"
            raise RequestError(413, ErrorCode.TOO_LARGE, text)
    return bytes(data)


async def _changed(service: Service, served: ServedScene, change: Any) -> Strokes:
    try:
        return await service.strokes.change(served.scene.path, change)
    except StrokeError as error:
        raise RequestError(409, ErrorCode.TOO_MANY, str(error)) from None
    except (StoreError, OSError) as error:
        raise _unavailable(served, error) from None


def _count(service: Service, painter: TokenPass) -> None:
    if not service.painters.take(painter.name, time.monotonic()):
        text = f"got more strokes than {service.painters.per_s:g} a second, expected fewer"
        raise RequestError(429, ErrorCode.TOO_MANY, text)


def _row(stroke: Stroke, painter: TokenPass) -> dict[str, Any]:
    return {**stroke.document(), "yours": stroke.who == painter.name}


def _unavailable(served: ServedScene, error: Exception) -> RequestError:
    log("strokes not kept", level=logging.ERROR, scene=served.id, reason=str(error))
    text = "strokes cannot be read or written now; try again later"
    return RequestError(503, "strokes_unavailable", text)
