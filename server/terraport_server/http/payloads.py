"""Segments and packs over HTTP.

``/scenes/ID/segments/N.glb``, ``base.glb`` and ``overview.glb`` are for other programs: GLBs, made
when they are asked for.
``/scenes/ID/v-.../segments.pack`` is the pack of a version, which clients fetch in ranges; they
compare each segment.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final
from urllib.parse import unquote

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse

from terraport_payload import PayloadError
from terraport_server.errors import AccessError, RequestError, UnknownSceneError
from terraport_server.http.responses import (
    PIECE_BYTES,
    PackResponse,
    SceneOfRequest,
    ServiceOfRequest,
    caching_headers,
    in_pieces,
    is_unchanged,
    token_of,
)
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import OriginError, StoreError
from terraport_store.layout import BASE, ENCODING, OVERVIEW

__all__ = ["pack_routes", "payload_routes", "require_file", "segment_faults", "segment_number"]

payload_routes = APIRouter()
pack_routes = APIRouter()
"""Their address matches many others: to be added after all routes of a scene."""

_PACK_PATH: Final = re.compile(r"(?:/[^/?]+)*?/scenes/([^/?]+)/([^/?]+/[^/?]+)(?:\?.*)?")


@payload_routes.head("/scenes/{scene_id}/segments/{segment}.glb", include_in_schema=False)
@payload_routes.get("/scenes/{scene_id}/segments/{segment}.glb", summary="One segment")
async def get_segment(
    request: Request,
    served: SceneOfRequest,
    service: ServiceOfRequest,
    segment: str,
    v: str | None = None,
) -> Response:
    """Return a segment as GLB."""
    number = segment_number(segment, len(served.hashes))
    etag = f'"{served.hashes[number]:016x}-glb"'
    headers = caching_headers(etag, v, is_open=service.gate.is_open)
    if is_unchanged(request, etag):
        return Response(None, 304, headers)
    with segment_faults(service, served, number):
        data = await served.payloads.glb(number)
    return Response(data, 200, headers, "model/gltf-binary")


@payload_routes.get("/scenes/{scene_id}/base.glb", summary="The base mesh as GLB")
async def get_base_glb(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the base as GLB."""
    return await _file_as_glb(request, served, BASE, v, service)


@payload_routes.get("/scenes/{scene_id}/overview.glb", summary="The overview as GLB")
async def get_overview_glb(
    request: Request, served: SceneOfRequest, service: ServiceOfRequest, v: str | None = None
) -> Response:
    """Return the overview as GLB; 404 for a small base, which needs none."""
    return await _file_as_glb(request, served, OVERVIEW, v, service)


async def _file_as_glb(
    request: Request, served: ServedScene, key: str, version: str | None, service: Service
) -> Response:
    require_file(served, key)
    etag = f'"{served.scene.manifest.files[key].xxh3}-glb"'
    headers = caching_headers(etag, version, is_open=service.gate.is_open)
    if is_unchanged(request, etag):
        return Response(None, 304, headers)
    try:
        data = await served.glb(key)
    except OSError:  # an old version whose files were deleted
        raise UnknownSceneError(served.id, served.version) from None
    except PayloadError as error:
        served.tell_failure("file_damaged", None, error)
        raise RequestError(500, "file_corrupt", f"{key} is damaged on the server's disk") from None
    headers["Content-Length"] = str(len(data))
    # In pieces, so that a slow client holds none of it but the one that is being sent.
    pieces = (data[at : at + PIECE_BYTES] for at in range(0, len(data), PIECE_BYTES))
    return StreamingResponse(in_pieces(pieces), headers=headers, media_type="model/gltf-binary")


def require_file(served: ServedScene, key: str) -> None:
    """Raise RequestError where a version has no overview."""
    if key not in served.scene.manifest.files:
        raise RequestError(
            404, "unknown_overview", "the scene has no overview, since its base is small"
        )


@pack_routes.head("/scenes/{scene_id}/{folder}/{name}", include_in_schema=False)
@pack_routes.get("/scenes/{scene_id}/{folder}/{name}", summary="The pack of a version")
async def get_pack(
    request: Request, service: ServiceOfRequest, scene_id: str, folder: str, name: str
) -> Response:
    """Return a pack by its path in the scene's folder, or one byte range of it."""
    served, headers = _find_pack(request, service, scene_id, f"{folder}/{name}")
    if is_unchanged(request, headers["ETag"]):
        return Response(None, 304, headers)
    try:
        return PackResponse(served, headers)
    except OSError as error:
        served.tell_failure("file_not_served", None, error)
        raise UnknownSceneError(scene_id, served.version) from None


@payload_routes.get("/auth", summary="Whether a proxy may serve a pack to this client")
async def check_access(request: Request, service: ServiceOfRequest) -> Response:
    """Answer for the address in ``X-Forwarded-Uri`` (Caddy's ``forward_auth``).

    204 with the caching headers of the pack, 401 or 403 as the pack itself would answer, and 404
    for every other address.
    """
    path = _PACK_PATH.fullmatch(request.headers.get("x-forwarded-uri", ""))
    if path is None:
        raise RequestError(404, "not_found", "got an address that is not a pack's")
    _, headers = _find_pack(request, service, *map(unquote, path.groups()))
    return Response(None, 204, headers)


def _find_pack(
    request: Request, service: Service, scene_id: str, path: str
) -> tuple[ServedScene, dict[str, str]]:
    """Return the version that has a pack, and the caching headers, where the request may see it."""
    code = service.gate.check(token_of(request), scene_id)
    if code is not None:
        raise AccessError(code)
    served = service.registry.find_pack(scene_id, path)
    if served.fetchers is not None:  # in object storage, where no file can be sent from
        raise UnknownSceneError(scene_id)
    manifest = served.scene.manifest
    etag = f'"{manifest.files[manifest.encodings[ENCODING].pack].xxh3}"'
    return served, caching_headers(etag, served.version, is_open=service.gate.is_open)


@contextmanager
def segment_faults(service: Service, served: ServedScene, segment: int) -> Iterator[None]:
    """Convert errors about a payload that is unreadable or incomplete into a client error.

    Raises
    ------
    RequestError
        The error for the client.
    """
    try:
        yield
    except (OriginError, FileNotFoundError) as error:
        served.tell_failure("segment_lost", segment, error)
        text = f"segment {segment} is not available now; try again later"
        raise RequestError(503, "segment_unavailable", text) from None
    except (PayloadError, StoreError):
        served.payloads.distrust(segment)
        service.metrics.corrupt_segments.labels(service.metrics.scene_label(served.id)).inc()
        text = f"segment {segment} is damaged on the server's disk"
        raise RequestError(500, "segment_corrupt", text) from None


def segment_number(text: str, count: int) -> int:
    """Return the number of a segment in an address; raises RequestError."""
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 40):
        raise RequestError(400, "invalid_field", "got a wrong value of: segment")
    if text.startswith("-") or int(digits) >= count:
        expected = f"got segment {text}, expected 0 to {count - 1}"
        raise RequestError(404, "unknown_segment", expected)
    return int(digits)
