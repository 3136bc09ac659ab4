"""WebSocket connection for uvicorn's ``ws`` option.

uvicorn hands over the transport and the bytes of the handshake. The ``websockets`` library parses
them without I/O; the ASGI application finds the connection in the scope's extensions
(:func:`connection_of`), and sends payload through its writer.

A client below the level of messages is bounded: size of a message, messages that wait, fragments
and control frames per second, pongs that wait, and the time that closing may take.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable
from http import HTTPStatus
from time import monotonic
from typing import Any, Final, cast
from urllib.parse import unquote

import uvicorn
from uvicorn.server import ServerState
from websockets.datastructures import Headers
from websockets.frames import Frame, Opcode
from websockets.http11 import Request, Response
from websockets.protocol import State
from websockets.server import ServerProtocol

from terraport_server.session.rate_limit import RateLimit
from terraport_server.stream.frame_writer import (
    MAX_UNREAD_BYTES,
    ClientDisconnected,
    FrameWriter,
)

__all__ = ["EXTENSION", "REFUSED_CLOSE_S", "Connection", "connection_class", "connection_of"]

EXTENSION: Final = "terraport.connection"

REFUSED_CLOSE_S: Final = 1.0
"""Time that a refused client may take to answer the close frame."""

MAX_FIRST_MESSAGE_BYTES: Final = 64 << 10
"""Longest message before authentication: a ``hello`` takes 17 KB at most, and a ``land`` that does
not wait for the welcome 33 KB."""

MAX_FIRST_FRAMES: Final = 64
"""Fragments and control frames before authentication."""

FRAMES_PER_MESSAGE: Final = 20
"""Fragments and control frames allowed per message that ``max_messages_per_s`` allows."""

_MAX_WAITING: Final = 4
"""Messages that wait for the application; with more, the socket is not read."""

_LEAST_SLICE_BYTES: Final = 512
_MOST_SLICE_BYTES: Final = 64 << 10
"""Bytes parsed at once: the least hold at most 85 frames; limits are checked in between."""

_MAX_LATE_BYTES: Final = 1 << 20
"""Bytes read after our close frame while waiting for the client's."""

_TCP_NOTSENT_LOWAT: Final = getattr(socket, "TCP_NOTSENT_LOWAT", 25)

_LOGGER: Final = logging.getLogger("terraport.server")
_QUIET: Final = logging.getLogger("terraport.websocket")
"""The library logs each handshake; only faults are of interest."""
_QUIET.setLevel(logging.WARNING)


class Connection(asyncio.Protocol):
    """One WebSocket connection; the parameters are those that uvicorn passes."""

    notsent_lowat_bytes = 0
    max_frames_per_s = 1200.0
    close_timeout_s = 5.0

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self._config = config
        self._server_state = server_state
        self._app_state = app_state
        self._loop = _loop or asyncio.get_running_loop()
        most_bytes = min(MAX_FIRST_MESSAGE_BYTES, config.ws_max_size)
        self._protocol = ServerProtocol(max_size=most_bytes, logger=_QUIET)
        self.heard_s = monotonic()
        """Time at which data was last received."""
        self.on_shutdown: Callable[[], None] | None = None
        """Called when the server stops, instead of closing the connection."""
        self._unparsed = bytearray()
        self._fragments: list[bytes] = []
        self._is_text = False
        self._events: list[dict[str, Any]] = []
        self._reader: asyncio.Future[None] | None = None
        self._deliver: Callable[[dict[str, Any]], bool] | None = None
        self._is_held = False
        """Whether the sender takes no message now."""
        self._slice_bytes = _LEAST_SLICE_BYTES
        self._parses_later = False
        self._is_reading = True
        self._pongs = b""
        self._first_frames = 0
        self._frame_rate: RateLimit | None = None
        """None until the client is authenticated."""
        self._late_bytes = 0
        self._response: Response | None = None
        """Answer to the handshake, until it is sent."""
        self._denial: dict[str, Any] = {}
        self._close_timer: asyncio.TimerHandle | None = None
        self._ping_timer: asyncio.TimerHandle | None = None

    # Called by asyncio and uvicorn.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take over the transport and set the socket's options."""
        self._transport = cast("asyncio.Transport", transport)
        self.writer = FrameWriter(self._transport)
        self._server_state.connections.add(cast("Any", self))
        raw = transport.get_extra_info("socket")
        if raw is None or raw.family not in {socket.AF_INET, socket.AF_INET6}:
            return
        if self.notsent_lowat_bytes:
            with contextlib.suppress(OSError):  # not on this system
                raw.setsockopt(socket.IPPROTO_TCP, _TCP_NOTSENT_LOWAT, self.notsent_lowat_bytes)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        """Notify the application and release all buffers."""
        self._server_state.connections.discard(cast("Any", self))
        self._unparsed.clear()
        self._add_event({"type": "websocket.disconnect", "code": 1006})
        self.writer.lose()
        for timer in (self._close_timer, self._ping_timer):
            if timer is not None:
                timer.cancel()

    def data_received(self, data: bytes) -> None:
        """Parse received data, as far as the limits allow."""
        self.heard_s = monotonic()
        if not self.writer.ending:
            self._unparsed += data
            self._parse()

    def pause_writing(self) -> None:
        """Stop writing: the socket is full."""
        self.writer.pause()

    def resume_writing(self) -> None:
        """Continue writing: the socket has room."""
        pongs, self._pongs = self._pongs, b""
        if pongs and not self.writer.closing:
            self.writer.append(pongs)
        self.writer.resume()

    def shutdown(self) -> None:
        """Close, or let the session finish: the server stops."""
        if self.on_shutdown is not None and not self.writer.closing:
            self.on_shutdown()
        else:
            self.close(1012, "")

    # Called by the endpoint and the sender.

    def authenticate(self) -> None:
        """Apply the limits of a known client from here on."""
        self._frame_rate = RateLimit(self.max_frames_per_s, now_s=self.heard_s)
        self._protocol.max_message_size = self._config.ws_max_size

    def deliver_to(self, call: Callable[[dict[str, Any]], bool] | None) -> None:
        """Set the callback for ASGI events, which replaces :meth:`receive`.

        It returns whether another message may come; if not, call :meth:`read_on` later.
        """
        self._deliver = call
        events, self._events = self._events, []
        for event in events:
            self._add_event(event)
        self._parse()

    def read_on(self) -> None:
        """Continue to read messages."""
        if self._is_held:
            self._is_held = False
            self._parse_later()

    def close_within(self, seconds: float) -> None:
        """Shorten the time that the client may take to answer a close frame."""
        self.close_timeout_s = min(self.close_timeout_s, seconds)

    def close(self, code: int, reason: str) -> None:
        """Send a close frame, and wait for the client's until the close timeout."""
        if self.writer.closing or self.writer.lost:
            return
        self._add_event({"type": "websocket.disconnect", "code": code, "reason": reason})
        if self._protocol.state is not State.OPEN:
            self._end()
            return
        self._protocol.send_close(code, reason)
        self._flush()
        self.writer.closing = True
        self._close_timer = self._loop.call_later(self.close_timeout_s, self.abort)
        self._parse_later()

    def abort(self) -> None:
        """Drop the connection and everything buffered."""
        self._transport.abort()

    # Frames of the client.

    def _parse(self) -> None:
        while self._unparsed and self._may_parse():
            piece = bytes(self._unparsed[: self._slice_bytes])
            del self._unparsed[: self._slice_bytes]
            self._protocol.receive_data(piece)
            events = self._protocol.events_received()
            if self._protocol.parser_exc is not None:
                # Its close frame waits behind pongs already: nothing may be answered any more.
                self._end()
                return
            self._slice_bytes = min(2 * self._slice_bytes, _MOST_SLICE_BYTES)
            if events:
                self._slice_bytes = _LEAST_SLICE_BYTES
            for event in events:
                if isinstance(event, Request):
                    self._begin(event)
                elif isinstance(event, Frame):
                    self._on_frame(event)
            if self._protocol.handshake_exc is not None:
                self._end()
                return
            if events and self._unparsed:  # others first
                self._parse_later()
                break
        should_read = not self._unparsed
        if should_read != self._is_reading and not self._transport.is_closing():
            self._is_reading = should_read
            if should_read:
                self._transport.resume_reading()
            else:
                self._transport.pause_reading()

    def _parse_later(self) -> None:
        if not self._parses_later:
            self._parses_later = True
            self._loop.call_soon(self._parse_now)

    def _parse_now(self) -> None:
        self._parses_later = False
        if not self.writer.lost:
            self._parse()

    def _may_parse(self) -> bool:
        if not self.writer.closing:
            return not self._is_held and len(self._events) < _MAX_WAITING
        self._late_bytes += self._slice_bytes
        return self._late_bytes <= _MAX_LATE_BYTES

    def _on_frame(self, frame: Frame) -> None:
        if frame.opcode is Opcode.CLOSE:
            self._end()
            return
        is_message = frame.fin and frame.opcode in {Opcode.TEXT, Opcode.BINARY}
        if self.writer.closing or not (is_message or self._count_frame()):
            self._protocol.data_to_send()  # no pong follows a close frame
        elif frame.opcode is Opcode.PING:
            self._send_pongs(b"".join(self._protocol.data_to_send()))
        elif frame.opcode is not Opcode.PONG:
            if frame.opcode is not Opcode.CONT:
                self._is_text = frame.opcode is Opcode.TEXT
            self._fragments.append(bytes(frame.data))
            if frame.fin:
                data, self._fragments = b"".join(self._fragments), []
                self._on_message(data)

    def _on_message(self, data: bytes) -> None:
        if not self._is_text:
            self._add_event({"type": "websocket.receive", "bytes": data})
            return
        try:
            self._add_event({"type": "websocket.receive", "text": data.decode()})
        except UnicodeDecodeError:
            self.close(1007, "got text that is not UTF-8")

    def _send_pongs(self, pongs: bytes) -> None:
        """Answer pings; of many that wait for room only the newest are answered."""
        if not self.writer.is_full:
            self.writer.append(pongs)
            self.writer.flush()
        elif len(self._pongs) + len(pongs) <= MAX_UNREAD_BYTES:
            self._pongs += pongs
        else:
            self._pongs = pongs

    def _count_frame(self) -> bool:
        """Count a fragment or control frame; close where there are too many."""
        if self._frame_rate is None:
            self._first_frames += 1
            is_allowed = self._first_frames <= MAX_FIRST_FRAMES
        else:
            is_allowed = self._frame_rate.take(self.heard_s)
        if not is_allowed:
            self.close(4429, "too_many")
        return is_allowed

    def _ping(self) -> None:
        """Ask an idle client for a pong."""
        interval_s = self._config.ws_ping_interval
        if interval_s and not (self.writer.closing or self.writer.lost):
            if self._ping_timer is not None and self.writer.is_writable:
                self._protocol.send_ping(b"")
                self._flush()
            self._ping_timer = self._loop.call_later(interval_s, self._ping)

    def _flush(self) -> None:
        """Send pending data of the library."""
        self.writer.append(b"".join(self._protocol.data_to_send()))
        self.writer.flush()

    def _end(self) -> None:
        """Send the library's last data and end the connection."""
        received = self._protocol.close_rcvd
        code, reason = (1006, "") if received is None else (received.code, received.reason)
        self._add_event({"type": "websocket.disconnect", "code": code, "reason": reason})
        self._unparsed.clear()
        self._flush()
        if self._close_timer is None:
            self._close_timer = self._loop.call_later(self.close_timeout_s, self.abort)
        self.writer.close()

    # The ASGI application.

    def _begin(self, request: Request) -> None:
        """Start the application for a handshake."""
        self._response = self._protocol.accept(request)
        if self._response.status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            self._respond(self._response)
            return
        path, _, query = request.path.partition("?")
        peer, own = map(self._transport.get_extra_info, ("peername", "sockname"))
        is_secure = self._transport.get_extra_info("sslcontext") is not None
        root = self._config.root_path
        offered = request.headers.get_all("Sec-WebSocket-Protocol")
        scope = {
            "type": "websocket",
            "asgi": {"version": self._config.asgi_version, "spec_version": "2.4"},
            "http_version": "1.1",
            "scheme": "wss" if is_secure else "ws",
            "server": own[:2] if isinstance(own, tuple) else None,
            "client": peer[:2] if isinstance(peer, tuple) else None,
            "root_path": root,
            "path": root + unquote(path),
            "raw_path": (root + path).encode("latin-1"),
            "query_string": query.encode("latin-1"),
            "headers": [
                (name.lower().encode("latin-1"), value.encode("latin-1", "replace"))
                for name, value in request.headers.raw_items()
            ],
            "subprotocols": [name.strip() for line in offered for name in line.split(",")],
            "state": self._app_state.copy(),
            "extensions": {"websocket.http.response": {}, EXTENSION: self},
        }
        self._add_event({"type": "websocket.connect"})
        task = self._loop.create_task(self._run(scope))
        self._server_state.tasks.add(task)
        task.add_done_callback(self._server_state.tasks.discard)

    async def _run(self, scope: dict[str, Any]) -> None:
        try:
            await self._config.loaded_app(scope, self.receive, self.send)
        except ClientDisconnected:
            pass
        except Exception:
            _LOGGER.exception("WebSocket application failed")
        if self._response is not None and not self.writer.closing:
            self._respond(self._protocol.reject(HTTPStatus.INTERNAL_SERVER_ERROR, ""))
        self.close(1011, "")

    async def receive(self) -> dict[str, Any]:
        """Return the next ASGI event; called by one task at a time."""
        while not self._events:
            self._reader = self._loop.create_future()
            await self._reader
        event = self._events.pop(0)
        self._parse()
        return event

    async def send(self, message: dict[str, Any]) -> None:
        """Carry out an ASGI event when the socket has room."""
        if not await self.writer.until_writable():
            raise ClientDisconnected
        kind, response = message["type"], self._response
        if kind == "websocket.accept" and response is not None:
            self._accept(response, message)
        elif kind == "websocket.http.response.start":
            self._denial = message | {"body": b""}
        elif kind == "websocket.http.response.body" and self._denial:
            self._denial["body"] += message.get("body", b"")
            if not message.get("more_body", False):
                self._deny(self._denial)
        elif kind == "websocket.close" and response is not None:
            self._respond(self._protocol.reject(HTTPStatus.FORBIDDEN, ""))
        elif kind == "websocket.close":
            self.close(message.get("code", 1000), message.get("reason") or "")
        elif kind == "websocket.send" and message.get("bytes") is not None:
            self._protocol.send_binary(message["bytes"])
            self._flush()
        elif kind == "websocket.send":
            self._protocol.send_text(message["text"].encode())
            self._flush()
        else:
            raise RuntimeError(f"got ASGI message {kind!r}, expected one that fits the state")

    def _accept(self, response: Response, message: dict[str, Any]) -> None:
        for name, value in message.get("headers", []):
            response.headers[name.decode("latin-1")] = value.decode("latin-1")
        if message.get("subprotocol"):
            response.headers["Sec-WebSocket-Protocol"] = message["subprotocol"]
        self._protocol.send_response(response)
        self._response = None
        self._flush()
        self._ping()

    def _deny(self, denial: dict[str, Any]) -> None:
        status, body = HTTPStatus(denial["status"]), denial["body"]
        lines = [(key.decode("latin-1"), text.decode("latin-1")) for key, text in denial["headers"]]
        headers = Headers([*lines, ("Connection", "close")])
        self._respond(Response(status, status.phrase, headers, body))

    def _respond(self, response: Response) -> None:
        """Answer the handshake with a plain HTTP response, and close."""
        self._protocol.send_response(response)
        self._response = None
        self._end()

    def _add_event(self, event: dict[str, Any]) -> None:
        if self._deliver is not None:
            self._is_held = not self._deliver(event)
            return
        self._events.append(event)
        if self._reader is not None and not self._reader.done():
            self._reader.set_result(None)


def connection_class(
    *,
    notsent_lowat_bytes: int,
    max_messages_per_s: float = 60.0,
    close_timeout_s: float = 5.0,
) -> type[Connection]:
    """Return a class for uvicorn's ``ws`` option.

    Parameters
    ----------
    notsent_lowat_bytes
        TCP_NOTSENT_LOWAT: unsent bytes in the kernel, which no newer landing can replace; 0 = the
        system's.
    max_messages_per_s
        Bounds fragments and control frames, too.
    close_timeout_s
        Time that a client may take to answer a close frame.
    """
    attributes = {
        "notsent_lowat_bytes": notsent_lowat_bytes,
        "max_frames_per_s": FRAMES_PER_MESSAGE * max_messages_per_s,
        "close_timeout_s": close_timeout_s,
    }
    return type("ConfiguredConnection", (Connection,), attributes)


def connection_of(scope: Any) -> Connection:
    """Return the connection of an ASGI scope; KeyError where the server is not set up for it."""
    connection: Connection = scope["extensions"][EXTENSION]
    return connection
