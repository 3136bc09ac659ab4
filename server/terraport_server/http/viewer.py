"""The web viewer at ``/`` with its files.

Its files are public, also where tokens are required: they contain no scene, and the viewer asks its
user for the token. They are read once, at the start: 2 MB. The build writes compressed twins
(``NAME.br``, ``NAME.gz``) of the files that get smaller; nothing is compressed while serving.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import xxhash
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from terraport_server.http.responses import CHECK, FOREVER, is_unchanged
from terraport_server.settings import Settings

__all__ = [
    "BUILT_PAGE",
    "VIEWER_POLICY",
    "ViewerPage",
    "chosen_coding",
    "has_viewer",
    "read_viewer",
    "viewer_routes",
]

BUILT_PAGE: Final = Path(__file__).parents[1] / "page"
"""Output of the build of ``client_sdk/web``; part of a wheel."""

INDEX: Final = "index.html"
ASSETS: Final = "assets/"
"""Folder of files whose names contain a hash of their content."""

_CODINGS: Final = (("br", ".br"), ("gzip", ".gz"))
"""Content codings with their file suffixes, the smallest first."""

_MEDIA_TYPES: Final = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".ico": "image/x-icon",
    ".jpg": "image/jpeg",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
}
"""Tables of operating systems differ, and with ``nosniff`` a wrong type is an error."""


@dataclass(frozen=True, slots=True)
class PageFile:
    """One file of the viewer, plain and in each content coding that was built."""

    name: str
    """Path below the page's folder, with slashes."""
    media_type: str
    digest: str
    """XXH3-64 of the file itself, hexadecimal."""
    forms: Mapping[str, bytes]
    """Bytes by content coding; "" is the file itself."""

    @property
    def is_fixed(self) -> bool:
        """Whether its name contains its hash, so that caches need not revalidate it."""
        return self.name.startswith(ASSETS)

    def etag(self, coding: str) -> str:
        """Return the strong entity tag of one coding, quotes included."""
        return f'"{self.digest}-{coding}"' if coding else f'"{self.digest}"'


class ViewerPage:
    """Files of the built viewer by path, read once; one of them is ``index.html``."""

    def __init__(self, folder: Path) -> None:
        self._files = {file.name: file for file in _read(folder)}

    def find(self, name: str) -> PageFile | None:
        """Return a file by its path below the folder; None where there is none."""
        return self._files.get(name)


def has_viewer(settings: Settings) -> bool:
    """Return whether the viewer is switched on and built."""
    return settings.viewer and ((settings.viewer_dir or BUILT_PAGE) / INDEX).is_file()


def read_viewer(settings: Settings) -> ViewerPage | None:
    """Read the viewer that the settings choose; None where it is switched off or not built."""
    return ViewerPage(settings.viewer_dir or BUILT_PAGE) if has_viewer(settings) else None


def chosen_coding(accepted: str | None, available: Collection[str]) -> str:
    """Return the content coding to answer with (RFC 9110, 12.5.3).

    Parameters
    ----------
    accepted
        ``Accept-Encoding``; None where the request has none.
    available
        Available codings; "" always is.

    Returns
    -------
    str
        The smallest that the client accepts; "" for the file itself. Weights other than 0 are
        ignored: the smaller is better for both sides.
    """
    taken: dict[str, bool] = {}
    for entry in (accepted or "").lower().split(","):
        coding, _, parameters = entry.partition(";")
        weight = parameters.replace(" ", "").removeprefix("q=")
        taken[coding.strip()] = not weight or weight.strip("0.") != ""
    for coding, _ in _CODINGS:
        if coding in available and taken.get(coding, taken.get("*", False)):
            return coding
    return ""


VIEWER_POLICY: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
    "style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors "
)
"""Content-Security-Policy: no other origin, no inline script or style; the framing origins follow.
The decoders are WebAssembly. Sent with every file: a worker has the policy of its own script.
"""

PERMISSIONS: Final = (
    "xr-spatial-tracking=(self), camera=(), geolocation=(), microphone=(), payment=(), usb=()"
)

_NO_VIEWER: Final = (
    "This service has no viewer. Its scenes: GET /scenes. In a checkout, `pip install -e .` builds "
    "the viewer; a released wheel contains it.\n"
)


async def get_file(request: Request) -> Response:
    """Return the viewer's page, or a file next to it: icon, licences."""
    return _answer(request, request.path_params.get("name", INDEX))


async def get_asset(request: Request) -> Response:
    """Return one of the viewer's scripts, styles or pictures."""
    return _answer(request, ASSETS + request.path_params["name"])


# Not FastAPI's: they are no part of the API, and its routes take .003 s each at the start.
viewer_routes: Final = [
    Route("/", get_file),
    Route("/assets/{name}", get_asset),
    Route("/{name}", get_file),
]
"""To be added after all other routes."""


def _answer(request: Request, name: str) -> Response:
    viewer: ViewerPage | None = request.app.state.viewer
    if viewer is None and name == INDEX:
        return PlainTextResponse(_NO_VIEWER, 404)
    file = None if viewer is None else viewer.find(name)
    if file is None:
        raise HTTPException(404)
    ancestors = request.app.state.service.settings.frame_ancestors
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


def _read(folder: Path) -> Iterator[PageFile]:
    suffixes = {suffix for _, suffix in _CODINGS}
    for path in sorted(folder.rglob("*")):
        names = path.relative_to(folder).parts
        # Names that begin with a dot are notes of the build.
        if path.suffix in suffixes or not path.is_file() or any(p.startswith(".") for p in names):
            continue
        data = path.read_bytes()
        forms = {"": data}
        for coding, suffix in _CODINGS:
            twin = path.with_name(path.name + suffix)
            if twin.is_file():
                forms[coding] = twin.read_bytes()
        media_type = _MEDIA_TYPES.get(path.suffix, "application/octet-stream")
        yield PageFile("/".join(names), media_type, xxhash.xxh3_64_hexdigest(data), forms)
