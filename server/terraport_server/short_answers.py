"""The short way to payload: what needs no wait is answered without a task, a scope or a middleware.

A request for a payload file that is a plain GET, whole in what was read, of bytes that are checked
and in the page cache: all of these, or it goes the long way, through uvicorn and the application,
which answers it (or refuses it) with the same words. What both ways decide, they decide by the same
functions; what differs is only who carries the bytes. docs/decisions/0050 has what it gives.
"""

from __future__ import annotations

import re
from http import HTTPStatus
from typing import Final, NamedTuple

from terraport_server.errors import ServerError
from terraport_server.http.guard import EVERYWHERE, RequestRules
from terraport_server.http.payload_files import FileAnswer, Headers, PayloadFiles
from terraport_server.service import Service
from terraport_store import PayloadRange, StoreError

__all__ = ["Asked", "ShortAnswer", "ShortAnswers", "read_request"]

_REQUEST: Final = re.compile(
    rb"GET /scenes/([A-Za-z0-9._~-]{1,64})/"
    rb"(?:segments/([0-9]{1,10})\.glb|((?!segments/)[A-Za-z0-9_-]{1,64}/[A-Za-z0-9._-]{1,64}))"
    rb"(?:\?([A-Za-z0-9._~=&-]*))? HTTP/1\.1\r\n"
    rb"((?:[A-Za-z0-9-]+:[\x20-\x7e]*\r\n)*)\r\n"
)
"""Stricter than HTTP: what it does not match may still be right, and goes the long way."""

_LINE: Final = re.compile(rb"([A-Za-z0-9-]+):[ ]*([\x20-\x7e]*?)[ ]*\r\n")

_ONLY_LONG: Final = frozenset(
    (b"content-length", b"expect", b"origin", b"te", b"trailer", b"transfer-encoding", b"upgrade")
)
"""Headers that mean more than this looks at: a body, another protocol, a page of another origin."""

_EVERYWHERE_LINES: Final = b"".join(b"%b: %b\r\n" % pair for pair in EVERYWHERE)

_STATUS_LINES: Final = {
    status: f"HTTP/1.1 {status.value} {status.phrase}\r\n".encode()
    for status in (HTTPStatus.OK, HTTPStatus.PARTIAL_CONTENT, HTTPStatus.NOT_MODIFIED)
}


class Asked(NamedTuple):
    """One request that may be answered the short way."""

    scene_id: str
    segment: str | None
    pack: str | None
    query: bytes
    block: bytes
    """The header lines, as they came."""
    headers: Headers
    size: int
    """Bytes that it took of what was read."""


class ShortAnswer(NamedTuple):
    """Head and body of one answer."""

    file: FileAnswer
    head: bytes
    body: PayloadRange | None
    """None where there is none: 304."""


def read_request(data: bytes, before: Asked | None) -> Asked | None:
    r"""Read one request off the beginning of what came; None where it goes the long way.

    Parameters
    ----------
    data
        What follows the last request of the connection.
    before
        The connection's last one: its headers are mostly the same again.

    Examples
    --------
    >>> head = b"GET /scenes/pit/segments/7.glb HTTP/1.1\r\nHost: x\r\n\r\n"
    >>> asked = read_request(head, None)
    >>> asked.segment, asked.headers, asked.size
    ('7', [(b'host', b'x')], 52)
    """
    match = _REQUEST.match(data)
    if match is None:
        return None
    scene_id, segment, pack, query, block = match.groups()
    if before is not None and before.block == block:
        headers = before.headers
    else:
        read = _headers(block)
        if read is None:
            return None
        headers = read
    return Asked(
        scene_id.decode(),
        None if segment is None else segment.decode(),
        None if pack is None else pack.decode(),
        query or b"",
        block,
        headers,
        match.end(),
    )


def _headers(block: bytes) -> Headers | None:
    """Return names and values; None where one of them is for the long way."""
    headers = [(name.lower(), value) for name, value in _LINE.findall(block)]
    for name, value in headers:
        if name in _ONLY_LONG or (name == b"connection" and value.lower() != b"keep-alive"):
            return None
    return headers


class ShortAnswers:
    """Answers of one process.

    Parameters
    ----------
    service
        Its scenes, gate, settings and metrics.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._files = PayloadFiles(service)
        self._rules = RequestRules(service.settings)
        self._varies = bool(service.settings.allowed_origins)
        """Whether a page of another origin would be answered with one more header."""

    def find(self, asked: Asked, date: tuple[bytes, bytes], most_bytes: int) -> ShortAnswer | None:
        """Answer a request; None where it goes the long way. Never waits.

        Parameters
        ----------
        asked
        date
            Header of every answer of the process.
        most_bytes
            Longest body that may go this way.
        """
        try:
            if self._rules.refusal(asked.headers) is not None:
                return None
            if asked.segment is not None:
                file = self._files.segment(
                    "GET", asked.scene_id, asked.segment, asked.query, asked.headers
                )
            else:
                assert asked.pack is not None
                file = self._files.pack("GET", asked.scene_id, asked.pack, asked.headers)
            status_line = _STATUS_LINES.get(file.part.status)
            if status_line is None or file.part.length > most_bytes:
                return None
            body = None
            if file.part.length:
                body = file.where()
                if body is None or not file.served.desk.is_near(body):
                    return None
        except (ServerError, StoreError, OSError):
            return None  # the long way says what is wrong
        self._service.metrics.answered(file.part.status)
        said = file.lines
        if self._varies:
            said = said.replace(b"vary: Authorization\r\n", b"vary: Authorization, Origin\r\n")
        lines = (status_line, *date, said, _EVERYWHERE_LINES)
        return ShortAnswer(file, b"%b%b: %b\r\n%b%b\r\n" % lines, body)
