"""Payload over HTTP at addresses whose bytes never change: one segment's GLB, and whole packs.

Plain ASGI, below the routing and beside FastAPI's: an answer costs what its bytes cost, not ten
times as much. The bytes go from the page cache to the socket by ``sendfile`` where the connection
takes files, else through memory, a window at a time.

A segment's hash is compared once, when it is first asked for by anybody, in a thread; after that
its entity tag is the hash that the scene's index has. Of packs, which clients that pull fetch in
ranges, nothing is compared: they compare each segment.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from starlette.responses import Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from terraport_server.auth import bearer_token
from terraport_server.byte_ranges import Part, choose_part
from terraport_server.errors import AccessError, RequestError, UnknownSceneError
from terraport_server.file_sender import FILES
from terraport_server.http_answers import caching_headers
from terraport_server.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import OriginError, PayloadRange, StoreError

__all__ = ["payload_routes"]

WINDOW_BYTES: Final = 1 << 20
"""What is looked for in the page cache, or brought there by a thread, before it is sent."""


def payload_routes(service: Service) -> list[Route]:
    """Return the routes of payload files."""
    return [
        Route(
            "/scenes/{scene_id}/segments/{segment}.glb",
            _Segments(service),
            methods=["GET", "HEAD"],
        ),
        Route("/scenes/{scene_id}/{folder}/{name}", _Packs(service), methods=["GET", "HEAD"]),
    ]


class _Segments:
    """``GET /scenes/{id}/segments/{segment}.glb``: the very bytes that a landing streams."""

    def __init__(self, service: Service) -> None:
        self._service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        service = self._service
        served, version = _find_scene(scope, service)
        index = served.scene.index
        segment = _number(scope["path_params"]["segment"], len(index))
        etag = f'"{int(index.xxh3[segment]):016x}"'
        total = int(index.length[segment])
        part = choose_part(scope["method"], scope["headers"], etag, total)
        headers = caching_headers(etag, version, is_open=service.gate.is_open)
        if not part.length or scope["method"] == "HEAD":
            await _send_head(part, headers, scope, receive, send)
            return
        served.hold()
        try:
            with self._faults(served, segment):
                where = await served.desk.whole(segment)
                if isinstance(where, PayloadRange):
                    where = where._replace(offset=where.offset + part.offset, length=part.length)
                    await _send_file(scope, send, part, headers, served, where)
                    return
            body = where[part.offset : part.offset + part.length]
            await send(_start(part, headers))
            await send({"type": "http.response.body", "body": body})
        finally:
            served.release()

    @contextmanager
    def _faults(self, served: ServedScene, segment: int) -> Iterator[None]:
        """Say what a client is told of a payload that is not there, or not whole."""
        service = self._service
        try:
            yield
        except (OriginError, FileNotFoundError) as error:
            served.tell_failure("segment_lost", segment, error)
            text = f"segment {segment} cannot be had now; try again later"
            raise RequestError(503, "segment_unavailable", text) from None
        except StoreError:
            served.desk.distrust(segment)
            service.metrics.corrupt_segments.labels(service.metrics.scene_label(served.id)).inc()
            text = f"segment {segment} is not whole on the server's disk"
            raise RequestError(500, "segment_corrupt", text) from None


class _Packs:
    """``GET /scenes/{id}/{folder}/{name}``: the pack of a version, by its path in the folder."""

    def __init__(self, service: Service) -> None:
        self._service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        service = self._service
        path = scope["path_params"]
        _check_token(scope, service)
        served = service.registry.find_pack(path["scene_id"], f"{path['folder']}/{path['name']}")
        manifest = served.scene.manifest
        pack = manifest.files[manifest.encodings["glb"].pack]
        part = choose_part(scope["method"], scope["headers"], f'"{pack.xxh3}"', pack.bytes)
        where = served.scene.pack_range("glb", part.offset, part.length)
        if where is None:  # in object storage, or mapped
            raise UnknownSceneError(served.id)
        headers = caching_headers(f'"{pack.xxh3}"', served.version, is_open=service.gate.is_open)
        headers["Content-Type"] = "application/octet-stream"
        if not part.length or scope["method"] == "HEAD":
            await _send_head(part, headers, scope, receive, send)
            return
        served.hold()
        try:
            await _send_file(scope, send, part, headers, served, where)
        except StoreError:
            text = "the pack is not whole on the server's disk"
            raise RequestError(500, "pack_corrupt", text) from None
        finally:
            served.release()


def _check_token(scope: Scope, service: Service) -> None:
    """Raise AccessError where the request may not see the scene."""
    token = None
    for name, value in scope["headers"]:
        if name == b"authorization":
            token = bearer_token(value.decode("latin-1"))
            break
    code = service.gate.check(token, scope["path_params"]["scene_id"])
    if code is not None:
        raise AccessError(code)


def _find_scene(scope: Scope, service: Service) -> tuple[ServedScene, str | None]:
    """Return the scene that a request may see, and the version that it asks for."""
    _check_token(scope, service)
    version = None
    query = scope["query_string"]
    if query:
        version = _version(query)
    return service.registry.get(scope["path_params"]["scene_id"], version), version


def _version(query: bytes) -> str | None:
    """Return the last ``v`` of a query, as it stands: a version needs no escapes."""
    for field in reversed(query.split(b"&")):
        if field.startswith(b"v="):
            return field[2:].decode("latin-1")
    return None


def _number(text: str, count: int) -> int:
    """Return the number of a segment in an address; raises RequestError."""
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 40):
        raise RequestError(400, "invalid_field", "got a wrong value of: segment")
    if text.startswith("-") or int(digits) >= count:
        expected = f"got segment {text}, expected 0 to {count - 1}"
        raise RequestError(404, "unknown_segment", expected)
    return int(digits)


async def _send_head(
    part: Part, headers: dict[str, str], scope: Scope, receive: Receive, send: Send
) -> None:
    """Answer without a body: 304, 416, or a HEAD."""
    headers = _with_part(part, headers)
    if part.status == 304:
        headers.pop("Content-Length")
    await Response(status_code=part.status, headers=headers)(scope, receive, send)


async def _send_file(
    scope: Scope,
    send: Send,
    part: Part,
    headers: dict[str, str],
    served: ServedScene,
    where: PayloadRange,
) -> None:
    """Send a range of a file, window by window: none is waited for on the event loop."""
    takes_files = FILES in scope.get("extensions", {})
    begun = False
    offset, left = where.offset, where.length
    while left:
        window = where._replace(offset=offset, length=min(left, WINDOW_BYTES))
        offset, left = offset + window.length, left - window.length
        # Before the head: what is not there must not be promised.
        body = await served.desk.window(window, as_file=takes_files)
        if not begun:
            await send(_start(part, headers))
            begun = True
        message: dict[str, Any] = {"more_body": left > 0}
        if body is None:
            message |= {
                "type": FILES,
                "file": window.descriptor,
                "offset": window.offset,
                "count": window.length,
            }
        else:
            message |= {"type": "http.response.body", "body": body}
        await send(message)


def _start(part: Part, headers: dict[str, str]) -> dict[str, Any]:
    raw = [
        (name.lower().encode("latin-1"), value.encode("latin-1"))
        for name, value in _with_part(part, headers).items()
    ]
    return {"type": "http.response.start", "status": int(part.status), "headers": raw}


def _with_part(part: Part, headers: dict[str, str]) -> dict[str, str]:
    headers = {
        "Content-Type": "model/gltf-binary",
        "Content-Length": str(part.length),
        "Accept-Ranges": "bytes",
        **headers,
    }
    if part.content_range is not None:
        headers["Content-Range"] = part.content_range
    return headers
