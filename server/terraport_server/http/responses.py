"""Parts that HTTP endpoints share: request dependencies, caching headers, file responses."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import AsyncIterator, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final

from fastapi import Depends, Request
from fastapi.responses import FileResponse
from starlette.types import Receive, Scope, Send

from terraport_server.auth.gate import bearer_token
from terraport_server.errors import AccessError
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import open_inside, path_inside
from terraport_store.layout import ENCODING

__all__ = [
    "CHECK",
    "FOREVER",
    "PIECE_BYTES",
    "PRIVATE_FOREVER",
    "OpenFileResponse",
    "PackResponse",
    "SceneOfRequest",
    "ServiceOfRequest",
    "caching_headers",
    "in_pieces",
    "is_unchanged",
    "token_of",
]

FOREVER: Final = "public, max-age=31536000, immutable"
PRIVATE_FOREVER: Final = "private, max-age=31536000, immutable"
CHECK: Final = "no-cache"
"""Caches keep the answer and revalidate it each time."""

PIECE_BYTES: Final = 64 << 10
"""Size of the pieces in which a long generated answer is sent."""

_HAS_DESCRIPTORS: Final = Path("/dev/fd").is_dir()
"""Whether an open file can be opened again by its number; Windows has no such folder."""

_REOPENS: Final = Path("/proc/self/fd").is_dir()
"""Whether that gives a file position of its own, as Linux does; others share the position."""

_ONE_RANGE: Final = re.compile(r"bytes[ \t]*=[ \t]*([0-9]{0,19})[ \t]*-[ \t]*([0-9]{0,19})[ \t]*")


async def _service(request: Request) -> Service:
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


ServiceOfRequest = Annotated[Service, Depends(_service)]
"""Type of a parameter that is given the service."""


def caching_headers(etag: str, version: str | None, *, is_open: bool) -> dict[str, str]:
    """Cache for ever what names its version; ask again about what is "the newest".

    Parameters
    ----------
    etag
        Quotes included.
    version
        That the request names.
    is_open
        Whether anybody may read it, and so any cache may keep it.
    """
    forever = FOREVER if is_open else PRIVATE_FOREVER
    return {
        "ETag": etag,
        "Cache-Control": CHECK if version is None else forever,
        "Vary": "Authorization",
    }


def token_of(request: Request) -> str | None:
    """Return the bearer token of a request; None without one."""
    return bearer_token(request.headers.get("authorization"))


async def _scene(  # async as all that strangers meet: no thread is taken up to refuse them
    request: Request, scene_id: str, service: ServiceOfRequest, v: str | None = None
) -> ServedScene:
    """Return the scene that a request may see, in the version ``v`` or the newest."""
    code = service.gate.check(token_of(request), scene_id)
    if code is not None:
        raise AccessError(code)
    return service.registry.get(scene_id, v)


SceneOfRequest = Annotated[ServedScene, Depends(_scene)]
"""Type of a parameter that is given the scene, where the request may see it."""


class OpenFileResponse(FileResponse):
    """Response with a file of a scene, or one byte range of it; the file is opened immediately.

    Between a check of the path and the opening, anybody who can write to the scene could put a
    link there. One range is answered; of several, the whole, which RFC 9110, 14.2 allows.

    Parameters
    ----------
    folder
        The scene.
    path
        Relative to it.
    headers
        With the ``ETag``.

    Raises
    ------
    OSError
        As :func:`terraport_store.open_inside`.
    """

    chunk_size = 1 << 18
    """Bytes read by a thread at once, and the most that a slow client holds in memory. Starlette's
    64 KiB take several times the CPU of a long file, 1 MiB no less than this."""

    def __init__(
        self, folder: Path, path: str, media_type: str, headers: Mapping[str, str]
    ) -> None:
        self._use(open_inside(folder, path), path_inside(folder, path), media_type, headers)

    def _use(
        self, descriptor: int, path: Path, media_type: str, headers: Mapping[str, str]
    ) -> None:
        self._descriptor = descriptor
        super().__init__(
            f"/dev/fd/{descriptor}" if _HAS_DESCRIPTORS else path,
            media_type=media_type,
            headers=headers,
            stat_result=os.fstat(descriptor),
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        given = [value.decode("latin-1") for name, value in scope["headers"] if name == b"range"]
        if given and _one_range(scope["method"], given) is None:
            others = [pair for pair in scope["headers"] if pair[0] != b"range"]
            scope = {**scope, "headers": others}
        try:
            await super().__call__(scope, receive, send)
        finally:
            os.close(self._descriptor)


class PackResponse(OpenFileResponse):
    """Response with the pack of an open version, whose file may have been deleted since.

    Parameters
    ----------
    served
        A scene in a folder.
    headers
        With the ``ETag``.

    Raises
    ------
    OSError
        When the pack cannot be opened again.
    """

    def __init__(self, served: ServedScene, headers: Mapping[str, str]) -> None:
        path = served.scene.path / served.pack_path
        if _REOPENS:
            pack = served.scene.pack_range(ENCODING, 0, 0)
            assert pack is not None
            descriptor = os.open(f"/proc/self/fd/{pack.descriptor}", os.O_RDONLY | os.O_CLOEXEC)
        else:
            descriptor = open_inside(served.scene.path, served.pack_path)
        self._use(descriptor, path, "application/octet-stream", headers)


def _one_range(method: str, values: list[str]) -> tuple[str, str] | None:
    """Return first and last byte of the range that is to be answered; None where that is the whole.

    Only GET has ranges (14.2); an invalid one counts as absent (14.1.1).
    """
    match = _ONE_RANGE.fullmatch(values[0]) if method == "GET" and len(values) == 1 else None
    if match is None or not any(match.groups()):
        return None
    first, last = match.groups()
    return None if first and last and int(last) < int(first) else (first, last)


async def in_pieces(pieces: Iterable[bytes]) -> AsyncIterator[bytes]:
    """Join small pieces of a long response to 64 KiB each; the event loop runs in between."""
    gathered: list[bytes] = []
    size = 0
    for piece in pieces:
        gathered.append(piece)
        size += len(piece)
        if size >= PIECE_BYTES:
            yield b"".join(gathered)
            gathered, size = [], 0
            await asyncio.sleep(0)
    yield b"".join(gathered)


def is_unchanged(request: Request, etag: str) -> bool:
    """Return whether the client already has what an entity tag names (RFC 9110, 13.1.2).

    Parameters
    ----------
    etag
        Quotes included; compared weakly.
    """
    if_none_match = request.headers.get("if-none-match", "")
    return if_none_match.strip() == "*" or etag in {
        entry.strip().removeprefix("W/") for entry in if_none_match.split(",")
    }
