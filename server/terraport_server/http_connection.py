"""uvicorn's HTTP protocol with bounds on what a connection may take, and for how long.

Requests and handshakes are begun one at a time, addresses in turn (:mod:`entrance`).

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
from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Any, Final, cast

from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

from terraport_server.bounded_requests import BoundedRequests
from terraport_server.client_addresses import too_many_of_address
from terraport_server.deadline import Deadline
from terraport_server.descriptors import NO_DESCRIPTOR, first_reserved
from terraport_server.entrance import PROXIES, Entrance
from terraport_server.file_sender import FILES, FileSender, with_files
from terraport_server.http_limits import HttpLimits
from terraport_server.peer_limits import BoundedPeer
from terraport_server.settings import Settings
from terraport_server.small_reads import SmallReads

__all__ = ["ANSWERED", "HttpConnection", "http_protocol_class"]

ANSWERED: Final = "terraport.answered"
"""Extension of a request's scope: called with the status of its answer."""

MAX_PIPELINED: Final = 16
"""Requests in one piece of what came. What is behind a request waits for its answer, unparsed."""

_FLOOD: Final = 2
"""Connections one too many are answered as long as there are fewer than so many times the bound;
more are dropped unheard."""

Headers = Sequence[tuple[bytes, bytes]]


class HttpConnection(BoundedRequests):
    """One HTTP connection, until it ends or becomes a WebSocket."""

    entrance: Entrance
    refused: Callable[[str, str, str], None]
    """Told reason, text and client of each refusal, for metric and log."""
    first_reserved: int | None = None
    """Lowest descriptor number with which a connection is refused; None = unlimited."""

    _end_timer: asyncio.TimerHandle | None = None
    _counted: str | None = None
    _full: str | None = None
    """Why this connection is one too many; said when it asks for something."""
    _files: FileSender | None = None
    """Sends ranges of files past the transport, where the connection takes them."""
    _waits = False
    """Whether it waits for its turn, and is not read meanwhile."""
    _in_vain = True
    """Whether it got nothing but refusals so far."""
    _refusals = 0
    _weight = 0
    """Bytes that came and were not answered yet."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.timeout_keep_alive = self.limits.keep_alive_s  # type: ignore[assignment]
        limits = self.limits
        self._header_deadline = Deadline(self.loop, limits.header_timeout_s, self._on_slow)
        self._stall_deadline = Deadline(self.loop, limits.stall_timeout_s, self._on_stall)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count the connection, and begin to wait for a request."""
        super().connection_made(transport)
        if FileSender.can_serve(transport):
            self._files = FileSender(transport)
        limits, entrance = self.limits, self.entrance
        open_now, most = len(self.connections), limits.max_connections
        if open_now > most and not entrance.make_room():
            self._full = f"got connection {open_now}, expected at most {most}"
        raw = transport.get_extra_info("socket")
        if None not in (raw, self.first_reserved) and raw.fileno() >= self.first_reserved:
            self._full = NO_DESCRIPTOR
        key = entrance.addresses.counted(None if self.client is None else self.client[0])
        if key is not None:
            self._counted = key
            entrance.strangers.enter(self, key)
            of_address, most = entrance.addresses.enter(key), limits.max_connections_per_ip
            if of_address > most:
                self._full = too_many_of_address(of_address, most)
        if open_now > _FLOOD * limits.max_connections:
            self._drop("connections", self._full or "")
        self._header_deadline.start()

    def give_way(self, text: str) -> None:
        """Leave, to make room for somebody else."""
        self._drop("connections", text)

    def answered(self, status: int) -> None:
        """Hear how a request was answered."""
        if status < HTTPStatus.BAD_REQUEST:
            self._in_vain = False
        elif self._in_vain and self._counted is not None:
            if self._refusals:  # the first counts when the connection ends
                self.entrance.addresses.came_in_vain(self._counted, self.loop.time())
            self._refusals += 1

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timers and count the connection out."""
        if self._end_timer is not None:
            self._end_timer.cancel()
        self._uncount()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        self._unbind()

    def _unbind(self) -> None:
        """Hold nothing that holds this connection.

        A ring is freed by the search for garbage alone: what a flood of connections left behind had
        it stop the loop for 40 ms at a time.
        """
        self._header_deadline.end()
        self._stall_deadline.end()
        if self._files is not None:
            self._files.close()
            self._files = None
        self.pipeline.clear()
        self.parser = self.cycle = self.scope = None  # type: ignore[assignment]

    def data_received(self, data: bytes) -> None:
        """Read on, within the bounds."""
        self._weight += len(data)
        self.entrance.weigh(self, len(data))
        if self._over:  # also because that was too much
            return
        self._unread += data
        if self._waits or not self._may_parse:
            self.transport.pause_reading()  # what one read brought is enough
        elif self._counted is None:
            self._begin_next()  # whose turn it has to be, a proxy says in the headers
        else:
            self._waits = True
            self.entrance.ask(self._counted, self._read_on)

    def _begin_next(self) -> None:
        """Begin with what came."""
        self._take_piece()

    def _take_piece(self) -> None:
        """Parse some of what came; the rest in another turn."""
        self._parse_piece()
        is_done = not self._unread and self._counted is None and self.transport.is_reading()
        if not (self._waits or self._over or is_done):
            self._wait(self._read_on)
        # After the parser: what came with these bytes may have been the end of the headers.
        if self._over or not self._in_headers or not self._header_bytes:
            return
        if self._header_bytes > self.limits.header_bytes:
            text = f"got headers of more than {self.limits.header_bytes} bytes, expected fewer"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "http_headers", text)
        elif not self._header_deadline.is_running:
            self._header_deadline.start()

    def on_message_begin(self) -> None:
        """Say in the scope of a request that its answer may be a file."""
        super().on_message_begin()
        self._in_request = True
        if self._files is not None:
            self.scope["extensions"] = {FILES: {}}

    def on_headers_complete(self) -> None:
        """Look at what the headers announce."""
        if self._over:
            return
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        if self._full is not None:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, "connections", self._full)
        elif size > self.limits.header_bytes:
            text = f"got headers of {size} bytes, expected at most {self.limits.header_bytes}"
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "http_headers", text)
        elif self._announced_bytes() > self.limits.body_bytes:  # refused while it can be answered
            self._refuse_body()
        elif len(self.pipeline) >= MAX_PIPELINED:
            self._drop("http_malformed", f"got more than {MAX_PIPELINED} requests ahead of answers")
        else:
            self._in_headers = False
            self._header_bytes = self._body_bytes = self._content_bytes = 0
            scope = cast("dict[str, Any]", self.scope)
            scope.setdefault("extensions", {})[ANSWERED] = self.answered
            super().on_headers_complete()

    def on_message_complete(self) -> None:
        """Begin to count the next request's headers."""
        if self._over:
            return
        self._header_deadline.stop()
        if self.cycle is not None:
            self.cycle.waiting_for_100_continue = False  # there is nothing to go on with
        super().on_message_complete()
        self._in_headers = True
        self._in_request = False
        self._header_bytes = 0
        self._tail = b""

    def on_response_complete(self) -> None:
        """Go on with what came meanwhile; make sure that a connection closed now does close."""
        super().on_response_complete()
        self._let_go()
        if self._refusals > 1 and self._in_vain and self._counted is not None:
            text = self.entrance.is_in_vain(self._counted, self.loop.time())
            if text is not None:
                self._drop("connections", text)
                return
        if self.transport.is_closing():
            self._abort_soon()
        elif self._unread and not (self._waits or self._over):
            self._wait(self._read_on)

    def _let_go(self) -> None:
        """Count what came no more where it was answered."""
        self.entrance.weigh(self, len(self._unread) - self._weight)
        self._weight = len(self._unread)

    def timeout_keep_alive_handler(self) -> None:
        """Close a silent connection, and make sure of it."""
        super().timeout_keep_alive_handler()
        self._abort_soon()

    def handle_websocket_upgrade(self) -> None:
        """Hand over when it is this one's turn; nothing of it is read until then."""
        self._header_deadline.stop()
        if not self._over:
            self.transport.pause_reading()
            self._wait(self._upgrade)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP in the form of every other refusal."""
        self._refuse(HTTPStatus.BAD_REQUEST, "http_malformed", msg.lower().rstrip("."))

    def pause_writing(self) -> None:
        """Begin to wait for a client that does not read."""
        super().pause_writing()
        self._stall_deadline.start()

    def resume_writing(self) -> None:
        """Note that it reads."""
        super().resume_writing()
        if not self._over and not self.transport.is_closing():
            self._stall_deadline.stop()
        if self._files is not None:
            self._files.on_room()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        """Begin one request at a time; uvicorn comes by here for each."""
        start = super()._start_asgi_task
        run = app if self._files is None else with_files(self._files, cycle, app)

        def begin() -> None:
            if not (self._over or self.transport.is_closing()):  # else nobody waits for an answer
                start(cycle, run)

        self.entrance.wait(self._turn_key(self.headers), begin)

    def _turn_key(self, headers: Headers | None) -> str:
        """Return whose turn it has to be: a proxy asks for many, each with turns of its own."""
        if self._counted is not None:
            return self._counted
        for name, value in reversed(headers or ()):
            if name == b"x-forwarded-for":
                client = value.rpartition(b",")[2].strip().decode("latin-1")
                return self.entrance.addresses.counted(client) or PROXIES
        return PROXIES

    def _wait(self, step: Callable[[], None], headers: Headers | None = None) -> None:
        """Take a step when it is this one's turn; no more than one read comes meanwhile."""
        self._waits = True
        self.entrance.wait(self._turn_key(headers or self.headers), step)

    def _read_on(self) -> None:
        self._waits = False
        if self._over or self.transport.is_closing():
            return
        if self._unread:
            if self._may_parse:
                self._begin_next()
        elif not self.flow.read_paused:
            self.transport.resume_reading()

    def _upgrade(self) -> None:
        """Become a WebSocket, with what this one counts for."""
        self._waits = False
        if self._over or self.transport.is_closing():
            return
        super().handle_websocket_upgrade()
        heir = self.transport.get_protocol()
        if isinstance(heir, BoundedPeer):
            self.entrance.strangers.leave(self)
            heir.count_by(self.entrance, self._counted, self.limits.max_connections_per_ip)
            self._counted = None
            self.transport.set_protocol(SmallReads(heir, self.entrance.room))
            if not heir.handshake_initiated:
                # It read no handshake, for a body or too long a header, and waits for nothing.
                text = "got no WebSocket handshake, expected one without a body"
                self._refuse(HTTPStatus.BAD_REQUEST, "http_malformed", text)
        self._unbind()
        if not self._over:
            self.transport.resume_reading()

    def _refuse(self, status: HTTPStatus, reason: str, text: str) -> None:
        """Answer where nothing was answered yet, and close."""
        if self._over or self.transport.is_closing():
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
            if self.cycle is not None:
                self.cycle.disconnected = True  # before an answer under way meets a closed handle
            self.transport.abort()

    def _tell(self, reason: str, text: str) -> None:
        self.refused(reason, text, "unknown" if self.client is None else self.client[0])

    def _on_slow(self) -> None:
        text = f"got no whole request in {self.limits.header_timeout_s:g} s, expected one"
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "http_slow", text)

    def _on_stall(self) -> None:
        text = f"got no byte of an answer read in {self.limits.stall_timeout_s:g} s"
        self._drop("http_slow", text)

    def _abort_soon(self) -> None:
        """Drop the connection if its last bytes are not taken."""
        self._stall_deadline.end()
        if self._end_timer is None:
            wait_s = self.limits.stall_timeout_s
            self._end_timer = self.loop.call_later(wait_s, self.transport.abort)

    def _uncount(self) -> None:
        if self._counted is not None:
            addresses = self.entrance.addresses
            addresses.leave(self._counted)
            if self._in_vain and self._full is None:
                addresses.came_in_vain(self._counted, self.loop.time())
            self._counted = None
            self.entrance.strangers.leave(self)


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
            "entrance": Entrance(
                settings.forwarded_allow_ips,
                settings.max_stranger_bytes,
                settings.max_connections_per_ip,
            ),
            "refused": staticmethod(refused),
            "first_reserved": first_reserved(),
        },
    )
