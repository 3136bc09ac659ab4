"""uvicorn's HTTP protocol with bounds on what a connection may take, and for how long.

uvicorn itself bounds neither the size of headers (httptools has no limit) nor the time until a
request is whole, nor how long a client may leave an answer unread. Each of these holds a connection
for nothing, and ``max_connections`` of them would keep everybody else out. Behind a proxy that has
such bounds nothing of this is ever met; without one it must be here.

What is beyond a bound is answered with the error body of every other refusal where nothing was
answered yet, and the connection is closed.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from terraport_server.client_addresses import ARRIVALS_S, ClientAddresses, too_many_of_address
from terraport_server.peer_limits import BoundedPeer
from terraport_server.settings import Settings

__all__ = ["HttpConnection", "HttpLimits", "http_protocol_class"]

MAX_PIPELINED: Final = 16
"""Requests sent ahead of their answers. Browsers send none."""

_FLOOD: Final = 2
"""Connections one too many are answered as long as there are fewer than so many times the bound;
more are dropped unheard."""


_ARRIVALS: Final = 10
"""An address may connect anew so many times the bound in `ARRIVALS_S`: each second all of them."""


@dataclass(frozen=True, slots=True)
class HttpLimits:
    """Bounds of every connection; see docs/topics/limits.md."""

    header_bytes: int
    body_bytes: int
    header_timeout_s: float
    keep_alive_s: float
    stall_timeout_s: float
    max_connections: int
    max_connections_per_ip: int

    @classmethod
    def of(cls, settings: Settings) -> HttpLimits:
        """Return the bounds that the settings name."""
        return cls(
            header_bytes=settings.http_header_bytes,
            body_bytes=settings.http_body_bytes,
            header_timeout_s=settings.http_header_timeout_s,
            keep_alive_s=settings.http_keep_alive_s,
            stall_timeout_s=settings.http_stall_timeout_s,
            max_connections=settings.max_connections,
            max_connections_per_ip=settings.max_connections_per_ip,
        )


class HttpConnection(HttpToolsProtocol):
    """One HTTP connection, until it ends or becomes a WebSocket."""

    limits: HttpLimits
    addresses: ClientAddresses
    refused: Callable[[str, str, str], None]
    """Told reason, text and client of each refusal, for metric and log."""

    _header_timer: asyncio.TimerHandle | None = None
    _stall_timer: asyncio.TimerHandle | None = None
    _counted: str | None = None
    _full: str | None = None
    """Why this connection is one too many; said when it asks for something."""
    _in_headers = True
    """Whether a request's headers are waited for, or are not whole yet."""
    _header_bytes = 0
    _body_bytes = 0
    _over = False
    """Whether this connection is being closed for a bound: nothing more is read from it."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.timeout_keep_alive = self.limits.keep_alive_s  # type: ignore[assignment]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count the connection, and begin to wait for a request."""
        super().connection_made(transport)
        limits = self.limits
        open_now, most = len(self.connections), limits.max_connections
        if open_now > most:
            self._full = f"got connection {open_now}, expected at most {most}"
        key = self.addresses.counted(None if self.client is None else self.client[0])
        if key is not None:
            self._counted = key
            of_address, most = self.addresses.enter(key), limits.max_connections_per_ip
            if of_address > most:
                self._full = too_many_of_address(of_address, most)
            if of_address > _FLOOD * most:
                self._drop("connections", self._full or "")
            arrived, most = self.addresses.arrive(key, self.loop.time()), _ARRIVALS * most
            if arrived > most:
                text = f"got connection {arrived} of one address in {ARRIVALS_S:g} s"
                self._drop("connections", f"{text}, expected at most {most}")
        if open_now > _FLOOD * limits.max_connections:
            self._drop("connections", self._full or "")
        self._header_timer = self.loop.call_later(limits.header_timeout_s, self._on_slow)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timers and count the connection out."""
        self._stop_header_timer()
        self._stop_stall_timer()
        self._uncount()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read on, within the bounds."""
        if self._over:
            return
        if self._in_headers:
            self._header_bytes += len(data)
        super().data_received(data)
        # After the parser: what came with these bytes may have been the end of the headers.
        if self._over or not self._in_headers or not self._header_bytes:
            return
        if self._header_bytes > self.limits.header_bytes:
            text = f"got headers of more than {self.limits.header_bytes} bytes, expected fewer"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "http_headers", text)
        elif self._header_timer is None:
            self._header_timer = self.loop.call_later(self.limits.header_timeout_s, self._on_slow)

    def on_headers_complete(self) -> None:
        """Stop waiting; look at what the headers announce."""
        self._stop_header_timer()
        if self._over:
            return
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        if self._full is not None:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "connections", self._full)
        elif size > self.limits.header_bytes:
            text = f"got headers of {size} bytes, expected at most {self.limits.header_bytes}"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "http_headers", text)
        elif len(self.pipeline) >= MAX_PIPELINED:
            self._drop("http_malformed", f"got more than {MAX_PIPELINED} requests ahead of answers")
        else:
            self._in_headers = False
            self._header_bytes = self._body_bytes = 0
            super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Take no more of a body than anybody could need."""
        if self._over:
            return
        self._body_bytes += len(body)
        if self._body_bytes > self.limits.body_bytes:
            text = f"got a body of more than {self.limits.body_bytes} bytes, expected none"
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "http_body", text)
            return
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Begin to count the next request's headers."""
        if self._over:
            return
        super().on_message_complete()
        self._in_headers = True
        self._header_bytes = 0

    def on_response_complete(self) -> None:
        """Make sure that a connection that is closed now does close."""
        super().on_response_complete()
        if self.transport.is_closing():
            self._abort_soon()

    def timeout_keep_alive_handler(self) -> None:
        """Close a silent connection, and make sure of it."""
        super().timeout_keep_alive_handler()
        self._abort_soon()

    def handle_websocket_upgrade(self) -> None:
        """Hand over, with what it counts for; from here on the session's bounds hold."""
        self._stop_header_timer()
        if self._over:
            return
        super().handle_websocket_upgrade()
        heir = self.transport.get_protocol()
        if isinstance(heir, BoundedPeer):
            heir.count_by(self.addresses, self._counted, self.limits.max_connections_per_ip)
            self._counted = None

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP in the form of every other refusal."""
        self._refuse(HTTPStatus.BAD_REQUEST, "http_malformed", msg.lower().rstrip("."))

    def pause_writing(self) -> None:
        """Begin to wait for a client that does not read."""
        super().pause_writing()
        self._stop_stall_timer()
        self._stall_timer = self.loop.call_later(self.limits.stall_timeout_s, self._on_stall)

    def resume_writing(self) -> None:
        """Note that it reads."""
        super().resume_writing()
        if not self._over and not self.transport.is_closing():
            self._stop_stall_timer()

    def _refuse(self, status: HTTPStatus, reason: str, text: str) -> None:
        """Answer where nothing was answered yet, and close."""
        if self._over:
            return
        if self.cycle is not None and not self.cycle.response_complete:
            # Half an answer may be under way: no other may be mixed into it.
            self._drop(reason, text)
            return
        self._over = True
        self._tell(reason, text)
        body = json.dumps({"error": {"code": reason, "message": text}}).encode()
        head = (
            f"HTTP/1.1 {status.value} {status.phrase}\r\ncontent-type: application/json\r\n"
            f"content-length: {len(body)}\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()
        self._abort_soon()

    def _drop(self, reason: str, text: str) -> None:
        """Close without an answer."""
        if not self._over:
            self._over = True
            self._tell(reason, text)
            self.transport.abort()

    def _tell(self, reason: str, text: str) -> None:
        self.refused(reason, text, "unknown" if self.client is None else self.client[0])

    def _on_slow(self) -> None:
        self._header_timer = None
        text = f"got no whole request in {self.limits.header_timeout_s:g} s, expected one"
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "http_slow", text)

    def _on_stall(self) -> None:
        text = f"got no byte of an answer read in {self.limits.stall_timeout_s:g} s"
        self._drop("http_slow", text)

    def _abort_soon(self) -> None:
        """Drop the connection if its last bytes are not taken."""
        self._stop_stall_timer()
        wait_s = self.limits.stall_timeout_s
        self._stall_timer = self.loop.call_later(wait_s, self.transport.abort)

    def _stop_header_timer(self) -> None:
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None

    def _stop_stall_timer(self) -> None:
        if self._stall_timer is not None:
            self._stall_timer.cancel()
            self._stall_timer = None

    def _uncount(self) -> None:
        if self._counted is not None:
            self.addresses.leave(self._counted)
            self._counted = None


def http_protocol_class(
    settings: Settings, refused: Callable[[str, str, str], None]
) -> type[HttpConnection]:
    """Return a class for uvicorn's ``http`` option.

    Parameters
    ----------
    settings
        Where the bounds come from.
    refused
        Told reason, text and client of each refusal.
    """
    return type(
        "HttpConnection",
        (HttpConnection,),
        {
            "limits": HttpLimits.of(settings),
            "addresses": ClientAddresses(settings.forwarded_allow_ips),
            "refused": staticmethod(refused),
        },
    )
