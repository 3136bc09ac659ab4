"""A scene as 3D Tiles over HTTP: the tileset, and the contents that it refers to."""

from __future__ import annotations

import logging
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse

from terraport_payload import PayloadError
from terraport_server.errors import RequestError
from terraport_server.http.payloads import segment_faults, segment_number
from terraport_server.http.responses import (
    CHECK,
    SceneOfRequest,
    ServiceOfRequest,
    caching_headers,
    in_pieces,
    is_unchanged,
)
from terraport_server.logging import log
from terraport_server.scenes.served_scene import ServedScene
from terraport_store import StoreError

__all__ = ["tile_routes"]

tile_routes = APIRouter()


@tile_routes.get("/scenes/{scene_id}/tileset.json", summary="The scene as 3D Tiles 1.1")
async def get_tileset(
    request: Request,
    served: SceneOfRequest,
    service: ServiceOfRequest,
    radius_m: Annotated[float | None, Query(gt=0, le=1e6)] = None,
) -> Response:
    """Return the tileset; with ``radius_m``, full detail within that distance of the eye."""
    try:
        tiles = await service.tiles.tiles(served)
    except (PayloadError, StoreError, OSError, ModuleNotFoundError) as error:
        raise _unavailable(served, error) from None
    # Not immutable: another release of the service may cut the base differently.
    headers = {
        "ETag": f'"{tiles.digest}{"" if radius_m is None else f"-{radius_m!r}"}"',
        "Cache-Control": CHECK,
        "Vary": "Authorization",
    }
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    pieces = in_pieces(tiles.tileset.pieces(radius_m))
    return StreamingResponse(pieces, media_type="application/json", headers=headers)


@tile_routes.get("/scenes/{scene_id}/tiles/{name}.glb", summary="A part of the base")
async def get_part(
    request: Request,
    served: SceneOfRequest,
    service: ServiceOfRequest,
    name: str,
    v: str | None = None,
) -> Response:
    """Return a part of the base by its name in the tileset."""
    headers = caching_headers(f'"{name[:64]}"', v, is_open=service.gate.is_open)
    try:
        data = await service.tiles.part(served, name)
    except (PayloadError, StoreError, OSError, ModuleNotFoundError) as error:
        raise _unavailable(served, error) from None
    if data is None:
        text = "got an unknown tile, expected one of this version's tileset.json"
        raise RequestError(404, "unknown_tile", text)
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return Response(data, media_type="model/gltf-binary", headers=headers)


@tile_routes.get("/scenes/{scene_id}/tiles/segments/{segment}.glb", summary="An unlit segment")
async def get_unlit_segment(
    request: Request,
    served: SceneOfRequest,
    service: ServiceOfRequest,
    segment: str,
    v: str | None = None,
) -> Response:
    """Return a segment as GLB with unlit materials, like the parts of the base."""
    number = segment_number(segment, len(served.hashes))
    headers = caching_headers(
        f'"{served.hashes[number]:016x}-unlit"', v, is_open=service.gate.is_open
    )
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    with segment_faults(service, served, number):
        data = await served.payloads.glb(number, unlit=True)
    return Response(data, media_type="model/gltf-binary", headers=headers)


def _unavailable(served: ServedScene, error: Exception) -> RequestError:
    log("tiles not made", level=logging.ERROR, scene=served.id, reason=str(error))
    if isinstance(error, ModuleNotFoundError):
        text = "this service has no 3D Tiles: pip install 'terraport[tiles]' where it runs"
        return RequestError(501, "tiles_unavailable", text)
    text = "the tiles are not available now; try again later"
    return RequestError(503, "tiles_unavailable", text)
