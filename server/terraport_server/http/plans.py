"""A plan without a session: what a landing shows, with the places of the payloads in the pack.

``GET /scenes/ID/v-.../plan?x=X&y=Y&z=Z&radius_m=R`` never changes under its address, so proxies and
browsers keep it (spec/protocol.md, section 7).
"""

from __future__ import annotations

import asyncio
import re
from typing import Annotated, Final

import numpy as np
from fastapi import APIRouter, Query, Request, Response

from terraport_server.client_key import client_key
from terraport_server.errors import AccessError, RequestError, UnknownSceneError
from terraport_server.http.responses import (
    ServiceOfRequest,
    caching_headers,
    is_unchanged,
    token_of,
)
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.plan import budgets_of, choose, plan_of
from terraport_wire import KEY_DTYPE, Budgets, ErrorCode, InvalidMessageError, Land, encode

__all__ = ["plan_routes"]

plan_routes = APIRouter()

_KEYS: Final = re.compile(r"[0-9a-f]{16}(?:,[0-9a-f]{16})*")

Budget = Annotated[int | None, Query(ge=0, lt=1 << 53)]


@plan_routes.get("/scenes/{scene_id}/{folder}/plan", summary="What a landing shows")
async def get_plan(
    request: Request,
    service: ServiceOfRequest,
    scene_id: str,
    folder: str,
    x: float,
    y: float,
    z: float,
    radius_m: float,
    coarse_radius_m: float | None = None,
    inner_radius_m: float | None = None,
    max_triangles: Budget = None,
    max_bytes: Budget = None,
    max_segments: Budget = None,
    max_gpu_bytes: Budget = None,
    gpu_vertex_bytes: Budget = None,
    gpu_face_bytes: Budget = None,
    without: str = "",
) -> Response:
    """Return a plan as msgpack; ``without`` are keys of segments in hexadecimal digits."""
    code = service.gate.check(token_of(request), scene_id)
    if code is not None:
        raise AccessError(code)
    served = service.registry.find_pack(scene_id, f"{folder}/segments.pack")
    is_open = service.gate.is_open
    headers = caching_headers(f'"{served.version}"', served.version, is_open=is_open)
    if is_unchanged(request, headers["ETag"]):
        return Response(None, 304, headers)
    if without and not _KEYS.fullmatch(without):
        text = "without: got other text, expected keys of 16 hexadecimal digits with commas"
        raise RequestError(400, ErrorCode.INVALID_FIELD, text)
    try:
        land = Land(
            generation=0,
            position=(x, y, z),
            radius_m=radius_m,
            coarse_radius_m=coarse_radius_m,
            inner_radius_m=inner_radius_m,
            have=np.zeros(0, KEY_DTYPE),
            without=np.array([int(key, 16) for key in without.split(",") if key], KEY_DTYPE),
            taken_bytes=0,
        )
        budgets = Budgets(
            max_triangles=max_triangles,
            max_bytes=max_bytes,
            max_segments=max_segments,
            max_gpu_bytes=max_gpu_bytes,
            gpu_vertex_bytes=gpu_vertex_bytes,
            gpu_face_bytes=gpu_face_bytes,
        )
    except InvalidMessageError as error:
        raise RequestError(400, ErrorCode.INVALID_FIELD, str(error)) from None
    limits = service.session_limits
    if max(radius_m, coarse_radius_m or 0.0) > limits.max_radius_m:
        text = f"got a radius beyond {limits.max_radius_m:g}, expected at most that"
        raise RequestError(400, ErrorCode.RADIUS_TOO_LARGE, text)
    if served.pack_address is None:  # in object storage, and no setting says where clients find it
        raise UnknownSceneError(scene_id, served.version)
    planned: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()

    def plan() -> None:
        if planned.done():  # the client is gone
            return
        try:
            planned.set_result(_plan(served, land, budgets, limits.max_plan_segments))
        except Exception as error:  # noqa: BLE001 - is raised where it is awaited
            planned.set_exception(error)

    client = client_key(request.client.host if request.client is not None else "unknown")
    service.plans.ask(client, plan, lambda: None)
    return Response(await planned, media_type="application/msgpack", headers=headers)


def _plan(served: ServedScene, land: Land, budgets: Budgets, max_segments: int) -> bytes:
    """Return the plan message, of which every row follows."""
    scene = served.view
    ball = choose(
        scene,
        land.position,
        land.radius_m,
        coarse_radius_m=land.coarse_radius_m,
        without=land.without,
        budgets=budgets_of(budgets, max_segments),
    )
    return encode(
        plan_of(
            scene,
            ball,
            0,
            inner_radius_m=land.inner_radius_m,
            offsets=served.scene.rows.offset,
            pack=served.pack_address,
        )
    )
