"""What people see in a browser: the viewer at ``/``, or where there is none, a list of scenes.

The viewer's files are the same for everybody and public, also where tokens are asked for: it holds
no scene, and asks its user for the token.
"""

from __future__ import annotations

import html
from typing import Final

from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.responses import HTMLResponse
from starlette.exceptions import HTTPException

from terraport_server.http.links import links_of, scene_path, service_links
from terraport_server.http.responses import CHECK, FOREVER, ServiceOfRequest, is_unchanged
from terraport_server.http.viewer import ASSETS, PageFile, chosen_coding
from terraport_server.service import Service

__all__ = ["VIEWER_POLICY", "add_page_routes"]

VIEWER_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
    "style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors "
)
"""Nothing from elsewhere, no inline script or style; who may frame it follows. The decoders are
WebAssembly. With every file, not with the page alone: a worker is held to the policy that came with
its own script.
"""

PERMISSIONS: Final = (
    "xr-spatial-tracking=(self), camera=(), geolocation=(), microphone=(), payment=(), usb=()"
)

_NOT_BUILT: Final = (
    "<p>The viewer is not part of this installation. In a checkout, <code>pip install -e .</code> "
    "builds it (Node comes from the system or from PyPI); a released wheel brings it.</p>"
)

MOST_LISTED: Final = 100
"""Scenes on the page without a viewer, which is written anew for whoever asks: .03 ms each."""

_router = APIRouter()


def add_page_routes(app: FastAPI) -> None:
    """Add ``/`` and the viewer's files; after every other route."""
    app.include_router(_router)


@_router.head("/", include_in_schema=False)
@_router.get("/", summary="The viewer; without one, the scenes", response_class=HTMLResponse)
async def get_page(request: Request, service: ServiceOfRequest) -> Response:
    """Return the viewer's page, or a list with names only where no token is asked for."""
    if service.viewer is None:
        return HTMLResponse(_list_page(service), headers={"Cache-Control": CHECK})
    return _answer(request, service, service.viewer.index)


@_router.head("/assets/{name}", include_in_schema=False)
@_router.get("/assets/{name}", include_in_schema=False)
async def get_asset(request: Request, service: ServiceOfRequest, name: str) -> Response:
    """Return one of the viewer's scripts, styles or pictures."""
    return _answer(request, service, _find(service, ASSETS + name))


@_router.head("/{name}", include_in_schema=False)
@_router.get("/{name}", include_in_schema=False)
async def get_other(request: Request, service: ServiceOfRequest, name: str) -> Response:
    """Return what the viewer has beside its page: its icon, the licences of what is in it."""
    return _answer(request, service, _find(service, name))


def _find(service: Service, name: str) -> PageFile:
    file = None if service.viewer is None else service.viewer.find(name)
    if file is None:
        raise HTTPException(404)
    return file


def _answer(request: Request, service: Service, file: PageFile) -> Response:
    ancestors = service.settings.frame_ancestors
    coding = chosen_coding(request.headers.get("accept-encoding"), file.forms)
    headers = {
        "Cache-Control": FOREVER if file.is_fixed else CHECK,
        "Content-Security-Policy": VIEWER_POLICY + (" ".join(ancestors) or "'none'"),
        "ETag": file.etag(coding),
        "Permissions-Policy": PERMISSIONS,
        "Vary": "Accept-Encoding",
    }
    if is_unchanged(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    if coding:
        headers["Content-Encoding"] = coding
    return Response(file.forms[coding], media_type=file.media_type, headers=headers)


def _list_page(service: Service) -> str:
    rows = []
    scene_ids = service.registry.ids() if service.gate.is_open else []
    for scene_id in scene_ids[:MOST_LISTED]:
        served = service.registry.get(scene_id)
        name, path = html.escape(served.scene.manifest.name), scene_path(scene_id)
        counts = served.scene.manifest.counts
        report = f' · <a href="{path}/report">report</a>' if "report" in links_of(served) else ""
        rows.append(
            f'<li><a href="{path}">{name}</a>: {counts.segments:,} segments, '
            f"{counts.detail_faces:,} triangles{report}</li>"
        )
    if len(scene_ids) > MOST_LISTED:
        rows.append(f'<li>and {len(scene_ids) - MOST_LISTED:,} more: <a href="scenes">all</a></li>')
    listed = "\n".join(rows) or "<li>none to show; GET /scenes with a token lists them</li>"
    links = [
        f'<a href="{path}">{"API" if name == "docs" else name}</a>'
        for name, path in service_links(service.settings).items()
    ]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>terraport</title>'
        f"<h1>terraport</h1><ul>\n{listed}\n</ul>"
        f"<p>{' · '.join(links)}</p>{_NOT_BUILT if service.settings.viewer else ''}</html>\n"
    )
