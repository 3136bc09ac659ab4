"""uvicorn's WebSocket protocol, with bounds on what a peer can do below the level of messages.

Messages are counted by the session. What never becomes one is counted here: pings, pongs and
fragments. Found by ``fuzz/server.py``: a client that sends pings and reads nothing made the process
hold every pong (one byte of memory per byte sent), and frames without content cost a core.
"""

from __future__ import annotations

from typing import Final

from uvicorn._types import ASGISendEvent
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.protocol import State

from terraport_server.rate import RateLimit
from terraport_wire import CloseCode, ErrorCode

__all__ = ["FRAMES_PER_MESSAGE", "MAX_UNREAD_BYTES", "BoundedPeer"]

FRAMES_PER_MESSAGE: Final = 20
"""Frames allowed per message that ``max_messages_per_s`` allows: a megabyte may come in fragments
of 50 KB."""

MAX_UNREAD_BYTES: Final = 64 << 10
"""What may wait for a client and still be followed by a pong. Beyond it only the newest pings,
those that came in one piece, are answered when the client has read (RFC 6455, section 5.5.3)."""

_BAD_TEXT: Final = 1007


class BoundedPeer(WebSocketsSansIOProtocol):
    """One WebSocket connection whose peer may be hostile."""

    max_frames_per_s: float = 60.0 * FRAMES_PER_MESSAGE
    """Control frames and fragments, averaged over 10 s; more is closed with 4429."""

    _frame_rate: RateLimit | None = None
    _newest_pong: bytes | None = None
    _is_over = False
    """Whether the peer broke the rules of WebSocket, or a bound, and was closed for it."""

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

    def handle_ping(self) -> None:
        """Answer now, or later where the client does not read what it was sent."""
        if not self._may_send_frame():
            return
        pong = b"".join(self.conn.data_to_send())
        if not pong:  # went with the first ping of those that came together
            return
        if self.transport.get_write_buffer_size() > MAX_UNREAD_BYTES:
            self._newest_pong = pong
        else:
            self.transport.write(pong)

    def handle_pong(self, event: Frame) -> None:
        """Count it."""
        if self._may_send_frame():
            super().handle_pong(event)

    def handle_cont(self, event: Frame) -> None:
        """Count the fragment."""
        if self._may_send_frame():
            super().handle_cont(event)

    def resume_writing(self) -> None:
        """Answer the ping that has waited."""
        self.answer_ping()
        super().resume_writing()

    def answer_ping(self) -> None:
        """Answer the ping that has waited, where there is one."""
        if self._newest_pong is not None:
            pong, self._newest_pong = self._newest_pong, None
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

    def _may_send_frame(self) -> bool:
        """Count a frame that is no message; close where there are too many."""
        if self.close_sent:
            return False
        now_s = self.loop.time()
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
