"""Payload over HTTP at addresses whose bytes never change: one segment's GLB, and whole packs.

Plain ASGI, below the routing and beside FastAPI's. The bytes go from the page cache to the socket
by ``sendfile`` where the connection takes files, else through memory, a window at a time.

A segment's hash is compared once, when it is first asked for by anybody, in a thread; after that
its entity tag is the hash that the scene's index has. Of packs, which clients that pull fetch in
ranges, nothing is compared: they compare each segment.

What can be answered without a wait never comes here: :mod:`terraport_server.short_answers`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from terraport_server.errors import RequestError, UnknownSceneError
from terraport_server.file_sender import FILES
from terraport_server.http.payload_files import FileAnswer, PayloadFiles
from terraport_server.scenes.payload_reader import WINDOW_BYTES
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import OriginError, PayloadRange, StoreError

__all__ = ["payload_routes", "segment_faults"]


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
        self._files = PayloadFiles(service)

    async def __call__(self, scope: Scope, _receive: Receive, send: Send) -> None:
        """Answer one request."""
        path, query, headers = scope["path_params"], scope["query_string"], scope["headers"]
        scene_id, number = path["scene_id"], path["segment"]
        answer = self._files.segment(scope["method"], scene_id, number, query, headers)
        served, part = answer.served, answer.part
        assert answer.segment is not None
        if not part.length or scope["method"] == "HEAD":
            await _send_body(answer, send, b"")
            return
        served.hold()
        try:
            with segment_faults(self._service, served, answer.segment):
                where = await served.desk.whole(answer.segment)
                if isinstance(where, PayloadRange):
                    where = where._replace(offset=where.offset + part.offset, length=part.length)
                    await _send_file(answer, scope, send, where)
                    return
            await _send_body(answer, send, where[part.offset : part.offset + part.length])
        finally:
            served.release()


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
        self._files = PayloadFiles(service)

    async def __call__(self, scope: Scope, _receive: Receive, send: Send) -> None:
        """Answer one request."""
        path = scope["path_params"]
        pack, headers = f"{path['folder']}/{path['name']}", scope["headers"]
        answer = self._files.pack(scope["method"], path["scene_id"], pack, headers)
        served = answer.served
        if not answer.part.length or scope["method"] == "HEAD":
            await _send_body(answer, send, b"")
            return
        served.hold()
        try:
            where = answer.where()
            if where is None:
                raise UnknownSceneError(served.id)
            await _send_file(answer, scope, send, where)
        except StoreError:
            text = "the pack is not whole on the server's disk"
            raise RequestError(500, "pack_corrupt", text) from None
        finally:
            served.release()


async def _send_body(answer: FileAnswer, send: Send, body: bytes) -> None:
    await send(_start(answer))
    await send({"type": "http.response.body", "body": body})


async def _send_file(answer: FileAnswer, scope: Scope, send: Send, where: PayloadRange) -> None:
    """Send a range of a file, window by window: none is waited for on the event loop."""
    takes_files = FILES in scope.get("extensions", {})
    begun = False
    offset, left = where.offset, where.length
    while left:
        window = where._replace(offset=offset, length=min(left, WINDOW_BYTES))
        offset, left = offset + window.length, left - window.length
        # Before the head: what is not there must not be promised.
        body = await answer.served.desk.window(window, as_file=takes_files)
        if not begun:
            await send(_start(answer))
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


def _start(answer: FileAnswer) -> dict[str, Any]:
    status = int(answer.part.status)
    return {"type": "http.response.start", "status": status, "headers": answer.headers}
