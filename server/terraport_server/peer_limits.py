"""uvicorn's WebSocket protocol, with bounds on what a peer can do below the level of messages.

Messages are counted by the session. What never becomes one is counted here: pings, pongs and
fragments. Found by ``fuzz/server.py``: a client that sends pings and reads nothing made the process
hold every pong (one byte of memory per byte sent), and frames without content cost a core.

Messages reach the application one at a time: the next is looked at when the one before was taken,
in another step of the event loop, however many came at once, and when it is this client's turn
among all clients (:mod:`client_turns`).

Whoever is not let in yet has no more than one message looked at, a few frames, and is read when it
is his turn among all who are not (:mod:`entrance`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final, cast

from uvicorn._types import ASGIReceiveEvent, ASGISendEvent
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.protocol import State

from terraport_server.frame_cutter import FrameCutter
from terraport_server.session.rate_limit import RateLimit
from terraport_server.stream.client_turns import ClientTurns
from terraport_server.stream.priced_queue import Account
from terraport_server.stream.signals import Inbox, Signal
from terraport_wire import MAX_CLIENT_MESSAGE_BYTES, CloseCode, ErrorCode

__all__ = ["FRAMES_PER_MESSAGE", "MAX_UNREAD_BYTES", "REFUSED_CLOSE_S", "BoundedPeer"]

FRAMES_PER_MESSAGE: Final = 20
"""Frames allowed per message that ``max_messages_per_s`` allows: a megabyte may come in fragments
of 50 KB."""

MAX_UNREAD_BYTES: Final = 64 << 10
"""What may wait for a client and still be followed by a pong. Beyond it only the newest pings,
those that came in one piece, are answered when the client has read (RFC 6455, section 5.5.3)."""

REFUSED_CLOSE_S: Final = 1.0
"""How long a peer that was not let in may take to close its side: a round trip, and some.

Until then it counts for its address, so that whoever comes again and again and never answers is
soon dropped unheard. That costs a seventh of a handshake (0.09 ms, not 0.63)."""

FRAMES_AT_ONCE: Final = 32
"""Frames of one peer that are parsed before it is everybody else's turn: a quarter of a
millisecond."""

MAX_LATE_BYTES: Final = MAX_CLIENT_MESSAGE_BYTES + MAX_UNREAD_BYTES
"""What is read behind our close, in search of the peer's own: a message that was under way. Of a
peer that was never let in `MAX_UNREAD_BYTES`."""

MAX_LATE_FRAMES: Final = 256

_FRAME_COST: Final = 50
"""Of a frame that is parsed, in segments that a plan looks at: 8 us."""

_BYTES_PER_COST: Final = 64
"""Of a table, such as that of ``held``: five rows take as long as a segment of a plan."""

MAX_FIRST_BYTES: Final = 512 << 10
"""Of the one message before the session is open: a hello that offers as many segments as it may
takes 400 KB."""

MAX_FIRST_FRAMES: Final = 64
"""Control frames and fragments before the session is open: a hello of 400 KB in pieces of 8 KB, and
some pings."""

_BAD_TEXT: Final = 1007

_FAULTS: Final = logging.getLogger("uvicorn.error.websocket")
"""Where the lines of uvicorn and of the library go: only what is a fault. The others are several
for each handshake, whoever comes; metrics count those."""
_FAULTS.setLevel(logging.WARNING)


class BoundedPeer(WebSocketsSansIOProtocol):
    """One WebSocket connection whose peer may be hostile."""

    max_frames_per_s: float = 60.0 * FRAMES_PER_MESSAGE
    """Control frames and fragments, averaged over 10 s; more is closed with 4429."""

    is_let_in = False
    """Whether the session is open: :meth:`let_in` was called."""

    turns: ClientTurns
    """Of all clients of the event loop."""

    _entrance: Any = None
    on_shutdown: Callable[[], None] | None = None
    """Called where the server ends: the session takes no new landing, and closes by itself."""

    _counted: str | None = None
    _most_of_address = 0
    _frame_rate: RateLimit | None = None
    _newest_pong: bytes | None = None
    _is_over = False
    """Whether the peer broke the rules of WebSocket, or a bound, and was closed for it."""
    _goes_on = False
    """Whether the rest of what came is looked at in a later step of the event loop: of who is not
    let in, when it is his turn."""
    _in_vain = True
    """Whether its end counts as that of a connection which led nowhere."""
    _first_bytes = 0
    _first_frames = 0
    _late_bytes = 0
    _late_frames = 0
    _parsed_frames = 0

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.account = Account()
        """Of this client, in the turns of all."""
        self._cutter = FrameCutter()
        self.queue = cast("asyncio.Queue[ASGIReceiveEvent]", Inbox[ASGIReceiveEvent]())
        self.writable = cast("asyncio.Event", Signal(is_set=True))
        self.logger = self.conn.logger = _FAULTS

    def shutdown(self) -> None:
        """Let the session finish its landing where there is one, else close now."""
        if self.on_shutdown is None:
            super().shutdown()
        else:
            self.on_shutdown()

    def let_in(self) -> None:
        """Note that the session is open: from here on the bounds of a client hold."""
        self.is_let_in = True
        self.account.address = self._counted
        self.turns.come(self.account)
        self._in_vain = False
        for name in ("request", "response"):  # 4 KB that nobody asks for any more
            handshake = vars(self).pop(name, None)
            if handshake is not None:
                handshake.headers.clear()  # the library's parser keeps the request
        if self._entrance is not None:
            self._entrance.strangers.leave(self)
            # Which way it reads, a transport decides as it begins to.
            if not self.read_paused:
                self.transport.pause_reading()
            self.transport.set_protocol(self)
            if not self.read_paused:
                self.transport.resume_reading()

    def excuse(self) -> None:
        """Note that it is no fault of the peer's that it is not let in."""
        self._in_vain = False

    def give_way(self, text: str) -> None:  # noqa: ARG002 - metrics count it with the others
        """Leave, to make room for somebody else."""
        self.transport.abort()

    def leave_within(self, seconds: float) -> None:
        """Give the peer no more time than that to close its side; to be said before the close."""
        self.close_timeout = min(self.close_timeout, seconds)

    def connection_lost(self, exc: Exception | None) -> None:
        """Drop what waits and count the connection out of its address."""
        self._cutter.clear()
        if self.is_let_in:
            self.turns.leave(self.account)
        if self._entrance is not None and self._counted is not None:
            addresses = self._entrance.addresses
            addresses.leave(self._counted)
            if self._in_vain:
                addresses.came_in_vain(self._counted, self.loop.time())
            self._counted = None
            self._entrance.strangers.leave(self)
        super().connection_lost(exc)
        # Holds nothing that holds this one, or the search for garbage has to find it (and stops the
        # loop meanwhile): the library's parser is a generator of its own connection.
        self.conn.parser.close()
        for fault in (self.conn.parser_exc, self.conn.handshake_exc):
            if fault is not None:
                fault.with_traceback(None)  # its frames, and so whatever they held

    async def run_asgi(self) -> None:
        """Serve; the handshake's scope names this connection and is not needed afterwards."""
        try:
            await super().run_asgi()
        finally:
            del self.scope

    def data_received(self, data: bytes) -> None:
        """Take what came frame by frame, and no message before the last one was taken."""
        if not self.handshake_initiated:  # the request, which uvicorn hands over whole
            super().data_received(data)
            return
        self._cutter.add(data)
        if self._stranger_key is None and not self._goes_on:
            self._go_on()
            return
        self._stop_reading()  # what one read brought is enough
        self._go_on()
        if self._stranger_key is not None and self._entrance is not None:
            self._first_bytes += len(data)
            self._entrance.weigh(self, len(data))

    async def receive(self) -> ASGIReceiveEvent:
        """Hand over what came next; read on only then."""
        event = await self.queue.get()
        if self._cutter:
            self._go_on()
        else:
            self._read_on()
        return event

    def handle_parser_exception(self) -> None:
        """Close, and remember that it was not the application that did."""
        self._is_over = True
        super().handle_parser_exception()

    async def send(self, message: ASGISendEvent) -> None:
        """Send; a connection that was closed below the application is lost, not misused."""
        try:
            if self._is_over:
                raise ClientDisconnected
            await super().send(message)
        except RuntimeError:
            if self._is_over:
                raise ClientDisconnected from None
            raise
        if self.close_sent:
            self._go_on()  # the peer's own close may be among what waits

    def send_500_response(self) -> None:
        """Answer a handshake that failed, once: a service that ends has done so already."""
        if not self.transport.is_closing():
            super().send_500_response()

    def handle_ping(self) -> None:
        """Answer now, or later where the client does not read what it was sent."""
        may_answer = self._may_send_frame()
        pong = b"".join(self.conn.data_to_send())
        if not may_answer:  # else the pong would wait in the library, for whatever is written next
            return
        if not pong:  # went with the first ping of those that came together
            return
        if self.transport.get_write_buffer_size() > MAX_UNREAD_BYTES:
            self._newest_pong = pong
        else:
            self.transport.write(pong)

    def handle_pong(self, event: Frame) -> None:
        """Pass a pong on, within the bound on frames per second."""
        if self._may_send_frame():
            super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        """Pass a fragment on, within the bound on frames per second."""
        if self._may_send_frame():
            super().handle_cont(event)

    def resume_writing(self) -> None:
        """Answer the ping that has waited."""
        self.answer_ping()
        super().resume_writing()

    def answer_ping(self) -> None:
        """Answer the ping that has waited, where there is one."""
        pong, self._newest_pong = self._newest_pong, None
        if pong is not None and not self.close_sent:
            self.transport.write(pong)

    def send_receive_event_to_app(self) -> None:
        """Hand a whole message on; text that is no UTF-8 ends the connection, without a trace."""
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self._end(_BAD_TEXT, "no UTF-8")
                return
        super().send_receive_event_to_app()

    @property
    def _stranger_key(self) -> str | None:
        """Among whose turns those of a stranger are; None where they are among those of clients."""
        return None if self.is_let_in or self._entrance is None else self._counted

    def _take_turn(self) -> int:
        """Parse as much as one turn may; return what it cost."""
        frames, waiting_bytes = self._parsed_frames, len(self._cutter)
        self._take_frames()
        taken_bytes = waiting_bytes - len(self._cutter)
        return _FRAME_COST * (self._parsed_frames - frames) + taken_bytes // _BYTES_PER_COST

    def _take_frames(self) -> None:
        """Parse what came up to the next message; a few frames at most."""
        self._goes_on = False
        if not (self.is_let_in or self.close_sent) and (
            self._cutter.frame_bytes > MAX_FIRST_BYTES
            or self._first_bytes > MAX_FIRST_BYTES + MAX_UNREAD_BYTES
        ):
            self._end(int(CloseCode.TOO_LARGE), ErrorCode.TOO_LARGE)
        for _ in range(FRAMES_AT_ONCE):
            if self.transport.is_closing():
                self._cutter.clear()
                return
            if not (self.close_sent or self.queue.empty()):
                self._stop_reading()
                return
            piece = self._cutter.next()
            if not piece:
                self._read_on()
                return
            if self.close_sent and not self._may_come_late(piece):
                return
            self._parsed_frames += 1
            super().data_received(piece)
        self._stop_reading()
        self._go_on()

    def _may_come_late(self, piece: bytes) -> bool:
        """Count what comes behind our close; read no more where it is too much."""
        self._late_bytes += len(piece)
        self._late_frames += 1
        most_bytes = MAX_LATE_BYTES if self.is_let_in else MAX_UNREAD_BYTES
        if self._late_bytes <= most_bytes and self._late_frames <= MAX_LATE_FRAMES:
            return True
        self._cutter.clear()
        self._stop_reading()
        return False

    def _go_on(self) -> None:
        if self._goes_on:
            return
        self._goes_on = True
        key = self._stranger_key
        if self._entrance is None or key is None:
            self.turns.ask(self.account, self._take_turn)
        else:
            self._entrance.wait(key, self._take_frames)

    def _stop_reading(self) -> None:
        if not self.read_paused:
            self.read_paused = True
            self.transport.pause_reading()

    def _read_on(self) -> None:
        if self.read_paused and not self._goes_on and (self.close_sent or self.queue.empty()):
            self.read_paused = False
            self.transport.resume_reading()

    def _may_send_frame(self) -> bool:
        """Count a frame that is no message; close where there are too many."""
        if self.close_sent:
            return False
        now_s = self.loop.time()
        if not self.is_let_in:
            self._first_frames += 1
            if self._first_frames > MAX_FIRST_FRAMES:
                self._end(int(CloseCode.TOO_MANY), ErrorCode.TOO_MANY)
                return False
        if self._frame_rate is None:
            self._frame_rate = RateLimit(self.max_frames_per_s, now_s=now_s)
        if self._frame_rate.take(now_s):
            return True
        self._end(int(CloseCode.TOO_MANY), ErrorCode.TOO_MANY)
        return False

    def _end(self, code: int, reason: str) -> None:
        """Close as uvicorn does when it cannot parse."""
        self.frames = []
        if self.conn.state is State.OPEN:  # else the peer's own close came in the same piece
            self.conn.send_close(code, reason)
        if self.conn.close_sent is None:
            self.transport.abort()
        else:
            self.handle_parser_exception()
