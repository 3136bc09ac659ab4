"""What endpoints share: the service behind a request, and what an answer says of its keeping."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Iterable
from pathlib import Path
from typing import Annotated, Final

from fastapi import Depends, Request
from fastapi.responses import FileResponse
from starlette.types import Receive, Scope, Send

from terraport_server.auth.gate import bearer_token
from terraport_server.errors import AccessError
from terraport_server.http.byte_ranges import is_match
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_server.stream.scheduler import Rank, Turns
from terraport_store import open_inside, path_inside

__all__ = [
    "CHECK",
    "FOREVER",
    "PIECE_BYTES",
    "PRIVATE_FOREVER",
    "OpenFileResponse",
    "SceneOfRequest",
    "ServiceOfRequest",
    "caching_headers",
    "in_turns",
    "is_unchanged",
    "token_of",
]

FOREVER: Final = "public, max-age=31536000, immutable"
PRIVATE_FOREVER: Final = "private, max-age=31536000, immutable"
CHECK: Final = "no-cache"
"""Keep it, and ask each time whether it is still the same."""

PIECE_BYTES: Final = 64 << 10
"""Of a long answer that are sent at a time."""

_HAS_DESCRIPTORS: Final = Path("/dev/fd").is_dir()
"""Whether an open file can be opened again by its number; Windows has no such folder."""


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
    """Answers with a file of a scene that is opened at once.

    Between a look at its path and its opening, whoever can write to a scene could put a link there.

    Parameters
    ----------
    folder
        The scene.
    path
        Relative to it.

    Raises
    ------
    OSError
        As :func:`terraport_store.open_inside`.
    """

    def __init__(self, folder: Path, path: str, media_type: str, headers: dict[str, str]) -> None:
        self._descriptor = open_inside(folder, path)
        opened = f"/dev/fd/{self._descriptor}"
        super().__init__(
            opened if _HAS_DESCRIPTORS else path_inside(folder, path),
            media_type=media_type,
            headers=headers,
            stat_result=os.fstat(self._descriptor),
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            os.close(self._descriptor)


async def in_turns(pieces: Iterable[bytes], turns: Turns) -> AsyncIterator[bytes]:
    """Write a long answer as it is read, so much at a time: nobody holds a copy of all of it.

    One piece of all such answers is put together in a step of the event loop, however many there
    are.

    Parameters
    ----------
    pieces
        Made when they are asked for; put together until they have `PIECE_BYTES`.
    turns
        Of all that is sent.
    """
    gathered: list[bytes] = []
    size = 0
    for piece in pieces:
        gathered.append(piece)
        size += len(piece)
        if size >= PIECE_BYTES:
            await turns.take(Rank.LANDING, _nothing_yet)
            yield b"".join(gathered)
            gathered, size = [], 0
    yield b"".join(gathered)


def _nothing_yet() -> None:
    """Be the turn: what is sent is sent by whoever waited for it."""


def is_unchanged(request: Request, etag: str) -> bool:
    """Whether the client has what `etag` (quotes included) names (RFC 9110, 13.1.2)."""
    return is_match(request.headers.get("if-none-match", ""), etag)
