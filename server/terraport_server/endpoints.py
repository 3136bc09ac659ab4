"""The HTTP endpoints beside the stream."""

from __future__ import annotations

import hmac
import logging
from hashlib import sha256
from http import HTTPStatus
from typing import Annotated, Any

import xxhash
from fastapi import APIRouter, Depends, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse
from starlette.exceptions import HTTPException

from terraport_server.auth import bearer_token
from terraport_server.errors import AccessError, RequestError, UnknownSceneError, http_status
from terraport_server.http_answers import (
    CHECK,
    FOREVER,
    PRIVATE_FOREVER,
    ServiceOfRequest,
    is_unchanged,
)
from terraport_server.logs import log
from terraport_server.metrics import CONTENT_TYPE
from terraport_server.scene_links import (
    REPORT,
    building_line,
    links_of,
    report_of,
    service_links,
    summary_of,
)
from terraport_server.scenes import ServedScene
from terraport_server.service import Service
from terraport_server.session import INTERNAL_TEXT
from terraport_store import OriginError, StoreError
from terraport_store.labels import encode_labels
from terraport_wire import ErrorCode

__all__ = ["add_routes"]

_router = APIRouter()

_MAX_REPORT_BYTES = 64 << 20
"""Of a report in object storage: it passes through memory."""


def add_routes(app: FastAPI) -> None:
    """Add the endpoints and the answers to their errors; ``app.state.service`` must be set."""
    app.include_router(_router)
    app.add_exception_handler(AccessError, _access_refused)
    app.add_exception_handler(UnknownSceneError, _unknown_scene)
    app.add_exception_handler(RequestError, _refused)
    app.add_exception_handler(HTTPException, _not_routed)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(Exception, _failed)


def _token(request: Request) -> str | None:
    return bearer_token(request.headers.get("authorization"))


def _scene(
    request: Request, scene_id: str, service: ServiceOfRequest, v: str | None = None
) -> ServedScene:
    """Return the scene that a request may see, in the version ``v`` or the newest."""
    code = service.gate.check(_token(request), scene_id)
    if code is not None:
        raise AccessError(code)
    return service.registry.get(scene_id, v)


_Scene = Annotated[ServedScene, Depends(_scene)]


@_router.get("/scenes", summary="Scenes that the token opens")
def list_scenes(request: Request, service: ServiceOfRequest) -> dict[str, Any]:
    """List id, name, version and size of every scene that the token opens, and what is beside."""
    token_pass = service.gate.find(_token(request))
    if token_pass is None:
        raise AccessError(ErrorCode.UNAUTHORISED)
    ids = [scene_id for scene_id in service.registry.ids() if token_pass.opens(scene_id)]
    answer = {
        "scenes": [summary_of(service.registry.get(scene_id)) for scene_id in ids],
        "links": service_links(service.settings),
    }
    building = [build for build in service.registry.building if token_pass.opens(build.id)]
    if building:
        answer["building"] = [building_line(build) for build in building]
    return answer


@_router.get("/scenes/{scene_id}", summary="One scene: its manifest and addresses")
def get_scene(served: _Scene) -> JSONResponse:
    """Return the manifest with the scene's id and the addresses of its parts added."""
    document = served.scene.manifest.model_dump(mode="json")
    document |= {"id": served.id, "links": links_of(served)}
    headers = {"Cache-Control": CHECK, "ETag": f'"{served.version}"'}
    return JSONResponse(document, headers=headers)


@_router.get("/scenes/{scene_id}/base.glb", summary="The base mesh")
def get_base(
    request: Request, served: _Scene, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the base mesh; ranges are understood."""
    return _file(request, served, "base.glb", "model/gltf-binary", v, service)


@_router.get("/scenes/{scene_id}/base.cover", summary="Segments over each base face")
def get_cover(
    request: Request, served: _Scene, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the cover, as spec/scene-format.md has it."""
    return _file(request, served, "base.cover", "application/octet-stream", v, service)


@_router.get("/scenes/{scene_id}/regions.json", summary="Facts about the regions")
def get_regions(
    request: Request, served: _Scene, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the regions file."""
    return _file(request, served, "regions.json", "application/json", v, service)


@_router.get("/scenes/{scene_id}/labels.json", summary="What people call the regions")
def get_labels(request: Request, served: _Scene) -> Response:
    """Return the labels by stable id, as they are now: they belong to no version."""
    data = encode_labels(served.names.labels)
    headers = {
        "ETag": f'"{xxhash.xxh3_64_hexdigest(data)}"',
        "Cache-Control": CHECK,
        "Vary": "Authorization",
    }
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return Response(data, media_type="application/json", headers=headers)


@_router.get("/scenes/{scene_id}/segments/{segment}.glb", summary="One segment's GLB")
async def get_segment(
    request: Request, segment: int, served: _Scene, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the very bytes that a landing streams."""
    index = served.scene.index
    if not 0 <= segment < len(index):
        text = f"got segment {segment}, expected 0 to {len(index) - 1}"
        raise RequestError(404, "unknown_segment", text)
    headers = _caching(service, v, f"{int(index.xxh3[segment]):016x}")
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    try:
        data = await served.desk.payload(segment)
    except (OriginError, FileNotFoundError) as error:
        log(
            "segment_lost",
            level=logging.ERROR,
            scene=served.id,
            version=served.version,
            segment=segment,
            reason=str(error),
        )
        text = f"segment {segment} cannot be had now; try again later"
        raise RequestError(503, "segment_unavailable", text) from None
    except StoreError:
        service.metrics.corrupt_segments.labels(service.metrics.scene_label(served.id)).inc()
        text = f"segment {segment} is not whole on the server's disk"
        raise RequestError(500, "segment_corrupt", text) from None
    return Response(data, media_type="model/gltf-binary", headers=headers)


@_router.get("/scenes/{scene_id}/report", summary="The build's report, where there is one")
async def get_report(served: _Scene) -> Response:
    """Return the build's report of the scene; 404 where the build left none."""
    headers = {"Cache-Control": CHECK}
    path = report_of(served)
    if path is not None:
        return FileResponse(path, media_type="text/html", headers=headers)
    try:
        data = await served.read(REPORT, _MAX_REPORT_BYTES)
    except OriginError as error:
        log("report not read", level=logging.ERROR, scene=served.id, reason=str(error))
        text = "the report cannot be had now; try again later"
        raise RequestError(503, "report_unavailable", text) from None
    except OSError:  # there is none, or a link that leads out of the scene
        text = "this scene has no report, expected report.html from terraport report"
        raise RequestError(404, "unknown_report", text) from None
    return Response(data, media_type="text/html", headers=headers)


@_router.get("/healthz", summary="Whether the process runs", response_class=PlainTextResponse)
def get_health() -> str:
    """Answer 200 while the process runs, whatever state the service is in."""
    return "ok\n"


@_router.get("/readyz", summary="Whether new sessions are taken")
def get_readiness(service: ServiceOfRequest) -> PlainTextResponse:
    """Say ok, or 503 while starting or draining, or without any scene."""
    draining = service.draining and not service.replaced
    if draining or not service.ready:
        return PlainTextResponse("draining\n" if draining else "starting\n", 503)
    if not service.registry.ids():
        return PlainTextResponse("no scene\n", 503)
    return PlainTextResponse("ok\n")


def _check_metrics_token(request: Request, service: ServiceOfRequest) -> None:
    settings = service.settings
    if settings.serves_metrics:
        return
    if settings.metrics_token is None:
        raise HTTPException(404)
    given = (_token(request) or "").encode("utf-8", "surrogatepass")
    right = settings.metrics_token.get_secret_value().encode()
    # Digests: of one length, whatever was given.
    if not hmac.compare_digest(sha256(given).digest(), sha256(right).digest()):
        raise AccessError(ErrorCode.UNAUTHORISED)


@_router.get("/metrics", summary="Prometheus metrics", dependencies=[Depends(_check_metrics_token)])
async def get_metrics(service: ServiceOfRequest) -> Response:
    """Return all metrics, of all processes of the service."""
    return Response(await service.render_metrics(), media_type=CONTENT_TYPE)


def _file(
    request: Request,
    served: ServedScene,
    key: str,
    media_type: str,
    version: str | None,
    service: Service,
) -> Response:
    headers = _caching(service, version, served.scene.manifest.files[key].xxh3)
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    try:
        path = served.scene.file_path(key)
    except PermissionError as error:
        log("file not served", level=logging.ERROR, scene=served.id, reason=str(error))
        raise UnknownSceneError(served.id, served.version) from None
    if not path.is_file():  # an old version whose files are gone
        raise UnknownSceneError(served.id, served.version)
    return FileResponse(path, media_type=media_type, headers=headers)


def _caching(service: Service, version: str | None, content_hash: str) -> dict[str, str]:
    """Cache for ever what names its version; ask again about what is "the newest"."""
    forever = FOREVER if service.gate.is_open else PRIVATE_FOREVER
    return {
        "ETag": f'"{content_hash}"',
        "Cache-Control": CHECK if version is None else forever,
        "Vary": "Authorization",
    }


def _error(status: int, code: str, text: str, headers: dict[str, str] | None = None) -> Response:
    """Return the JSON body of every refused request."""
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
    return _error(status, code, "got a request that nothing here answers, expected one of the API")


def _not_understood(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    fields = sorted({str(fault["loc"][-1])[:64] for fault in error.errors()})
    return _error(400, ErrorCode.INVALID_FIELD, f"got a wrong value of: {', '.join(fields)}")


def _failed(_request: Request, _fault: Exception) -> Response:
    """Answer a fault of our own; uvicorn logs its trace."""
    return _error(500, ErrorCode.INTERNAL, INTERNAL_TEXT)


def _refused(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestError)
    return _error(error.status, error.code, str(error))
