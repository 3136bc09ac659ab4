"""Endpoints of scenes and their files, health and metrics, and the responses to errors."""

from __future__ import annotations

import contextlib
import hmac
import json
import logging
from collections.abc import Iterator
from hashlib import sha256
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, PlainTextResponse, StreamingResponse
from starlette.exceptions import HTTPException

from terraport_server.auth.gate import TokenPass
from terraport_server.errors import AccessError, RequestError, UnknownSceneError, http_status
from terraport_server.http.links import (
    building_line,
    has_local_file,
    links_of,
    scene_line,
    scene_path,
    service_links,
)
from terraport_server.http.payloads import pack_routes, payload_routes, require_file
from terraport_server.http.plans import plan_routes
from terraport_server.http.responses import (
    CHECK,
    OpenFileResponse,
    SceneOfRequest,
    ServiceOfRequest,
    caching_headers,
    in_pieces,
    is_unchanged,
    token_of,
)
from terraport_server.http.strokes import may_paint, stroke_routes
from terraport_server.http.tiles import tile_routes
from terraport_server.logging import log
from terraport_server.metrics import CONTENT_TYPE
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_server.session.session import INTERNAL_TEXT
from terraport_store import OriginError
from terraport_store.layout import BASE, MEDIA_TYPE, OVERVIEW, PREVIEW, REPORT, REPORT_PDF
from terraport_wire import ErrorCode

__all__ = ["add_routes"]

_router = APIRouter()

_MAX_REPORT_BYTES = 64 << 20
"""Maximum size of a report in object storage: it passes through memory."""


def add_routes(app: FastAPI) -> None:
    """Add the endpoints and error handlers; ``app.state.service`` must be set."""
    for routes in (tile_routes, stroke_routes, payload_routes, _router, plan_routes, pack_routes):
        app.include_router(routes)
    app.add_exception_handler(AccessError, _access_refused)
    app.add_exception_handler(UnknownSceneError, _unknown_scene)
    app.add_exception_handler(RequestError, _refused)
    app.add_exception_handler(HTTPException, _not_routed)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(Exception, _failed)


async def _token_pass(request: Request, service: ServiceOfRequest) -> TokenPass:
    token_pass = service.gate.find(token_of(request))
    if token_pass is None:
        raise AccessError(ErrorCode.UNAUTHORISED)
    return token_pass


@_router.get("/scenes", summary="Scenes that the token opens")
async def list_scenes(
    service: ServiceOfRequest, token_pass: Annotated[TokenPass, Depends(_token_pass)]
) -> Response:
    """List every scene that the token opens, scenes being built, and links of the service."""
    pieces = in_pieces(_list_pieces(service, token_pass))
    return StreamingResponse(pieces, media_type="application/json")


def _list_pieces(service: Service, token_pass: TokenPass) -> Iterator[bytes]:
    """Yield the list, one piece per scene."""
    registry, is_first = service.registry, True
    yield b'{"scenes":['
    for scene_id in registry.ids():
        if not token_pass.opens(scene_id):
            continue
        with contextlib.suppress(UnknownSceneError):  # removed while the list was sent
            yield (b"" if is_first else b",") + _json(scene_line(registry.get(scene_id)))
            is_first = False
    rest: dict[str, Any] = {"links": service_links(service.settings)}
    building = [build for build in registry.building if token_pass.opens(build.id)]
    if building:
        rest["building"] = [building_line(build) for build in building]
    yield b"]," + _json(rest)[1:]


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode()


@_router.get("/scenes/{scene_id}", summary="One scene: its manifest and addresses")
async def get_scene(
    served: SceneOfRequest,
    service: ServiceOfRequest,
    token_pass: Annotated[TokenPass, Depends(_token_pass)],
) -> Response:
    """Return the manifest with the scene's id and the addresses of its parts added."""
    links = links_of(served)
    if may_paint(service, token_pass, served):
        links = {**links, "strokes": f"{scene_path(served.id)}/strokes"}
    added = json.dumps({"id": served.id, "links": links}).encode()
    headers = {"Cache-Control": CHECK, "ETag": f'"{served.version}"', "Vary": "Authorization"}
    document = served.manifest_json[:-1] + b"," + added[1:]
    return Response(document, media_type="application/json", headers=headers)


@_router.get("/scenes/{scene_id}/base.tsg", summary="The base mesh")
def get_base(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the base mesh, or one byte range of it."""
    return _file(request, served, BASE, MEDIA_TYPE, v, service)


@_router.get("/scenes/{scene_id}/overview.tsg", summary="A coarse first picture")
def get_overview(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the overview; 404 for a small base, which needs none."""
    require_file(served, OVERVIEW)
    return _file(request, served, OVERVIEW, MEDIA_TYPE, v, service)


@_router.get("/scenes/{scene_id}/regions.json", summary="Facts about the regions")
def get_regions(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the regions file."""
    return _file(request, served, "regions.json", "application/json", v, service)


@_router.get("/scenes/{scene_id}/labels.json", summary="Labels of the regions")
async def get_labels(request: Request, served: SceneOfRequest) -> Response:
    """Return the current labels by stable id; they belong to no version."""
    kept = served.labels_file
    headers = {"ETag": kept.etag, "Cache-Control": CHECK, "Vary": "Authorization"}
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return Response(kept.data, media_type="application/json", headers=headers)


@_router.get("/scenes/{scene_id}/report", summary="The build's report")
async def get_report(served: SceneOfRequest) -> Response:
    """Return the build's report; 404 where there is none."""
    return await _build_file(served, REPORT, "text/html")


@_router.get("/scenes/{scene_id}/report.pdf", summary="The report as PDF")
async def get_report_pdf(served: SceneOfRequest) -> Response:
    """Return the report's page for printing; 404 where there is none."""
    return await _build_file(served, REPORT_PDF, "application/pdf")


@_router.get("/scenes/{scene_id}/preview.jpg", summary="A small picture of the scene")
async def get_preview(served: SceneOfRequest) -> Response:
    """Return the preview of the scene; 404 where there is none."""
    return await _build_file(served, PREVIEW, "image/jpeg")


async def _build_file(served: ServedScene, name: str, media_type: str) -> Response:
    headers = {"Cache-Control": CHECK}
    if has_local_file(served, name):
        with contextlib.suppress(OSError):
            return OpenFileResponse(served.scene.path, name, media_type, headers)
    try:
        data = await served.read(name, _MAX_REPORT_BYTES)
    except OriginError as error:
        log("report not read", level=logging.ERROR, scene=served.id, reason=str(error))
        text = "the report is not available now; try again later"
        raise RequestError(503, "report_unavailable", text) from None
    except OSError:  # missing, or a link out of the scene
        text = f"this scene has no report, expected {name} from terraport report"
        raise RequestError(404, "unknown_report", text) from None
    return Response(data, media_type=media_type, headers=headers)


@_router.get("/healthz", summary="Whether the process runs", response_class=PlainTextResponse)
async def get_health() -> str:
    """Return 200 while the process runs."""
    return "ok\n"


@_router.get("/readyz", summary="Whether new sessions are accepted")
async def get_readiness(service: ServiceOfRequest) -> PlainTextResponse:
    """Return 200, or 503 while starting or draining, or without any scene."""
    draining = service.draining
    if draining or not service.ready:
        return PlainTextResponse("draining\n" if draining else "starting\n", 503)
    if service.registry.is_empty:
        return PlainTextResponse("no scene\n", 503)
    return PlainTextResponse("ok\n")


async def _check_metrics_token(request: Request, service: ServiceOfRequest) -> None:
    settings = service.settings
    if settings.serves_metrics:
        return
    bearer = service.gate.find(token_of(request))
    if not service.gate.is_open and bearer is not None and "metrics" in bearer.scopes:
        return
    if settings.metrics_token is None:
        raise HTTPException(404)
    given = (token_of(request) or "").encode("utf-8", "surrogatepass")
    right = settings.metrics_token.get_secret_value().encode()
    # Digests have one length, whatever the client sent.
    if not hmac.compare_digest(sha256(given).digest(), sha256(right).digest()):
        raise AccessError(ErrorCode.UNAUTHORISED)


@_router.get("/metrics", summary="Prometheus metrics", dependencies=[Depends(_check_metrics_token)])
async def get_metrics(service: ServiceOfRequest) -> Response:
    """Return all metrics, of all processes of the service."""
    return Response(service.render_metrics(), media_type=CONTENT_TYPE)


def _file(
    request: Request,
    served: ServedScene,
    key: str,
    media_type: str,
    version: str | None,
    service: Service,
) -> Response:
    etag = f'"{served.scene.manifest.files[key].xxh3}"'
    headers = caching_headers(etag, version, is_open=service.gate.is_open)
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    path = served.scene.manifest.files[key].path
    try:
        return OpenFileResponse(served.scene.path, path, media_type, headers)
    except FileNotFoundError:  # an old version whose files were deleted
        raise UnknownSceneError(served.id, served.version) from None
    except OSError as error:
        served.tell_failure("file_not_served", None, error)
        raise UnknownSceneError(served.id, served.version) from None


def _error(status: int, code: str, text: str, headers: dict[str, str] | None = None) -> Response:
    """Return the JSON response of a refused request."""
    return JSONResponse({"error": {"code": code, "message": text}}, status, headers=headers)


def _access_refused(_request: Request, error: Exception) -> Response:
    assert isinstance(error, AccessError)
    headers = {"WWW-Authenticate": "Bearer"} if error.code is ErrorCode.UNAUTHORISED else None
    return _error(http_status(error.code), error.code, str(error), headers)


def _unknown_scene(_request: Request, error: Exception) -> Response:
    assert isinstance(error, UnknownSceneError)
    return _error(404, error.code, str(error))


def _not_routed(_request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    status = HTTPStatus(error.status_code)
    code = status.phrase.lower().replace(" ", "_")
    return _error(status, code, "got a request for an unknown address, expected one of the API")


def _not_understood(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    fields = sorted({str(fault["loc"][-1])[:64] for fault in error.errors()})
    return _error(400, ErrorCode.INVALID_FIELD, f"got a wrong value of: {', '.join(fields)}")


def _failed(_request: Request, _fault: Exception) -> Response:
    """Respond to an internal error; uvicorn logs its traceback."""
    return _error(500, ErrorCode.INTERNAL, INTERNAL_TEXT)


def _refused(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestError)
    return _error(error.status, error.code, str(error))
