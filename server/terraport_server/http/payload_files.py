"""Payload files by their addresses: who may have them, which bytes, and what the answer says.

``/scenes/ID/segments/N.glb`` is the GLB that a landing streams, ``/scenes/ID/v-.../segments.pack``
the pack of a version. Nothing is read here, and nothing is waited for.
"""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import NamedTuple

from terraport_server.auth.gate import bearer_token
from terraport_server.errors import AccessError, RequestError, UnknownSceneError
from terraport_server.http.answers import caching_headers
from terraport_server.http.byte_ranges import Part, choose_part
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.service import Service
from terraport_store import PayloadRange

__all__ = ["FileAnswer", "Headers", "PayloadFiles", "segment_number"]

Headers = Sequence[tuple[bytes, bytes]]
"""Of a request: lower-case names."""


class FileAnswer(NamedTuple):
    """What is answered to one request."""

    served: ServedScene
    part: Part
    lines: bytes
    """Header lines, each with its end."""
    segment: int | None
    """None for a pack."""

    @property
    def headers(self) -> list[tuple[bytes, bytes]]:
        """The lines as names and values."""
        pairs = [line.partition(b": ") for line in self.lines.split(b"\r\n")[:-1]]
        return [(name, value) for name, _, value in pairs]

    def where(self) -> PayloadRange | None:
        """Where the part lies; None where it is in no file, or its hash was not compared yet.

        Raises
        ------
        StoreError
            When the file has no such bytes.
        """
        scene, part = self.served.scene, self.part
        if self.segment is None:
            return scene.pack_range("glb", part.offset, part.length)
        if not scene.is_verified(self.segment, "glb"):
            return None
        return scene.payload_range(self.segment, "glb", part.offset, part.length)

    def tell_failure(self, error: Exception) -> None:
        """Log that the file could not be sent; a segment's hash is compared again."""
        if self.segment is not None:
            self.served.desk.distrust(self.segment)
        self.served.tell_failure("segment_lost", self.segment, error)


class PayloadFiles:
    """Finds what requests ask for.

    Parameters
    ----------
    service
        Its scenes and its gate.
    """

    def __init__(self, service: Service) -> None:
        self._service = service

    def segment(
        self, method: str, scene_id: str, number: str, query: bytes, headers: Headers
    ) -> FileAnswer:
        """Answer for one segment.

        Raises
        ------
        AccessError, UnknownSceneError, RequestError
            When there is no such thing for this request.
        """
        self._check_token(headers, scene_id)
        version = _version(query) if query else None
        served = self._service.registry.get(scene_id, version)
        segment = segment_number(number, len(served.lengths))
        etag = f'"{served.hashes[segment]:016x}"'
        part = choose_part(method, headers, etag, served.lengths[segment])
        return self._answer(served, part, "model/gltf-binary", etag, version, segment)

    def pack(self, method: str, scene_id: str, path: str, headers: Headers) -> FileAnswer:
        """Answer for a pack, by its path in the scene's folder; raises as :meth:`segment`."""
        self._check_token(headers, scene_id)
        served = self._service.registry.find_pack(scene_id, path)
        if served.scene.pack_range("glb", 0, 0) is None:  # in object storage, or mapped
            raise UnknownSceneError(scene_id)
        manifest = served.scene.manifest
        pack = manifest.files[manifest.encodings["glb"].pack]
        etag = f'"{pack.xxh3}"'
        part = choose_part(method, headers, etag, pack.bytes)
        version = served.version
        return self._answer(served, part, "application/octet-stream", etag, version, None)

    def _answer(
        self,
        served: ServedScene,
        part: Part,
        kind: str,
        etag: str,
        version: str | None,
        segment: int | None,
    ) -> FileAnswer:
        """Say what every answer says; a 304 has no length."""
        length = f"content-length: {part.length}\r\n"
        if part.status is HTTPStatus.NOT_MODIFIED:
            length = ""
        caching = caching_headers(etag, version, is_open=self._service.gate.is_open)
        lines = f"content-type: {kind}\r\n{length}accept-ranges: bytes\r\n"
        for name, value in caching.items():
            lines += f"{name.lower()}: {value}\r\n"
        if part.content_range is not None:
            lines += f"content-range: {part.content_range}\r\n"
        return FileAnswer(served, part, lines.encode("latin-1"), segment)

    def _check_token(self, headers: Headers, scene_id: str) -> None:
        """Raise AccessError where the request may not see the scene."""
        token = None
        for name, value in headers:
            if name == b"authorization":
                token = bearer_token(value.decode("latin-1"))
                break
        code = self._service.gate.check(token, scene_id)
        if code is not None:
            raise AccessError(code)


def _version(query: bytes) -> str | None:
    """Return the last ``v`` of a query, as it stands: a version needs no escapes."""
    for field in reversed(query.split(b"&")):
        if field.startswith(b"v="):
            return field[2:].decode("latin-1")
    return None


def segment_number(text: str, count: int) -> int:
    """Return the number of a segment in an address; raises RequestError."""
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 40):
        raise RequestError(400, "invalid_field", "got a wrong value of: segment")
    if text.startswith("-") or int(digits) >= count:
        expected = f"got segment {text}, expected 0 to {count - 1}"
        raise RequestError(404, "unknown_segment", expected)
    return int(digits)
