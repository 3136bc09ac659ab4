"""Requests taken apart a piece at a time, within bounds on what one may take.

httptools has no limit of its own, and makes objects of whatever it is given: a kilobyte of short
headers takes ten times that. What came is parsed up to the end of one request's headers, and what
is behind them when that was answered.
"""

from __future__ import annotations

from http import HTTPStatus
from typing import Final

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from terraport_server.http_limits import HttpLimits

__all__ = ["MAX_HEADERS", "MAX_TARGET_BYTES", "BoundedRequests"]

MAX_HEADERS: Final = 128
"""Of one request, trailers among them: each takes ten times the memory of its bytes. Browsers send
some twenty."""

MAX_TARGET_BYTES: Final = 8 << 10
"""Path and query: they are decoded, split and looked up."""

_PIECE_BYTES: Final = 4 << 10
"""What is parsed of one connection in a turn: one read may hold 4,000 requests, which took the
parser 100 ms to the end even where the seventeenth was one too many."""


class BoundedRequests(HttpToolsProtocol):
    """Reads the requests of one connection."""

    limits: HttpLimits

    _in_headers = True
    """Whether a request's headers are waited for, or are not whole yet."""
    _header_bytes = 0
    _body_bytes = 0
    """Read since the present request's headers, chunks' lengths among them."""
    _content_bytes = 0
    """Of its body."""
    _over = False
    """Whether this connection is being closed for a bound: nothing more is read from it."""
    _unread = b""
    """What came and was not parsed yet."""
    _in_request = False
    """Whether the parser is within a request."""
    _tail = b""
    """The last bytes of the present request that were parsed."""

    def _refuse(self, status: HTTPStatus, reason: str, text: str) -> None:
        """Answer where nothing was answered yet, and close."""
        raise NotImplementedError

    @property
    def _may_parse(self) -> bool:
        """Whether no request waits for its answer: one at a time is taken apart."""
        return self._in_request or self.cycle is None or self.cycle.response_complete

    def _parse_piece(self) -> None:
        """Parse some of what came."""
        size = min(len(self._unread), _PIECE_BYTES)
        if self._in_headers:
            size = self._head_size(size)
            self._header_bytes += size
        else:
            self._body_bytes += size
        data, self._unread = self._unread[:size], self._unread[size:]
        self._tail = (self._tail + data)[-3:]
        super().data_received(data)
        if self._body_bytes > self.limits.body_bytes and not (self._in_headers or self._over):
            self._refuse_body()

    def _head_size(self, most: int) -> int:
        """Return up to where what came belongs to the present request's headers."""
        end = (self._tail + self._unread[:most]).find(b"\r\n\r\n")
        return most if end < 0 else end + 4 - len(self._tail)

    def on_url(self, url: bytes) -> None:
        """Take no longer target than anybody could need."""
        if self._over:
            return
        super().on_url(url)
        if len(self.url) > MAX_TARGET_BYTES:
            text = f"got a target of more than {MAX_TARGET_BYTES} bytes, expected fewer"
            self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG, "http_headers", text)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take no more headers than anybody could need."""
        if self._over:
            return
        super().on_header(name, value)
        if len(self.headers) > MAX_HEADERS:
            text = f"got more than {MAX_HEADERS} headers, expected fewer"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "http_headers", text)

    def on_body(self, body: bytes) -> None:
        """Take some of a body; its bytes, chunked or not, are counted as they come.

        Here too: the piece that goes beyond the bound may be the one that ends the body.
        """
        if self._over:
            return
        self._content_bytes += len(body)
        if self._content_bytes > self.limits.body_bytes:
            self._refuse_body()
        else:
            super().on_body(body)

    def _announced_bytes(self) -> int:
        """Return how long the present request's headers say that its body is."""
        for name, value in self.headers:
            if name == b"content-length":  # the parser took it: digits
                return int(value)
        return 0

    def _refuse_body(self) -> None:
        text = f"got a body of more than {self.limits.body_bytes} bytes, expected none"
        self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "http_body", text)
