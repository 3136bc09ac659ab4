"""HTTP response bodies by ``sendfile``: the ASGI extension ``http.response.zerocopysend``.

uvicorn does not implement it. It sends a range of an open file from the page cache to the socket;
the response head and the first bytes of the body leave in one segment. When the socket is full, one
small piece is written to the transport, which calls ``resume_writing`` once the socket has accepted
it: waiting needs no second descriptor. Under TLS the file is read piece by piece, as the socket
accepts it, through one buffer for all connections: a slow client holds at most one piece in memory.
The extension is not available on every system: an application checks the scope.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, Final

from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

from terraport_server.sending_transport import READ_ROOM_BYTES, SendingTransport

__all__ = ["FILES", "FileSender", "with_files"]

FILES: Final = "http.response.zerocopysend"
"""Name of the extension, and type of its message (ASGI, extensions)."""

Done = Callable[[OSError | None], None]

_PIECE_BYTES: Final = 16 << 10
"""Maximum bytes that are copied instead of sent by ``sendfile``: those sent with the head, and
those that the transport buffers while the socket is full."""

_REASONS: Final = {
    status.value: f"HTTP/1.1 {status.value} {status.phrase}\r\n".encode() for status in HTTPStatus
}


class FileSender:
    """Sender of the responses of one connection, one response at a time.

    Parameters
    ----------
    transport
        Transport of the connection, whose protocol calls :meth:`on_room` in ``resume_writing``.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._secure = transport if isinstance(transport, SendingTransport) else None
        transport.set_write_buffer_limits(0)  # the transport is empty: then a file continues
        self._loop = asyncio.get_running_loop()
        self._done: Done | None = None
        """Called when the body is sent, or lost; None without a body in progress."""
        self._rest: tuple[bytes, int, int, int] = (b"", -1, 0, 0)
        """What is left of it: head, descriptor, offset, bytes."""

    @staticmethod
    def can_serve(transport: asyncio.Transport) -> bool:
        """Whether the connection is one that takes files."""
        if isinstance(transport, SendingTransport):
            return hasattr(os, "preadv")
        return transport.get_extra_info("socket") is not None and hasattr(os, "sendfile")

    def begin(self, head: bytes, file: int, offset: int, count: int, done: Done) -> bool:
        """Send bytes and a range of a file; never waits.

        Parameters
        ----------
        head
            Response head, sent first.
        file, offset, count
            File descriptor and byte range.
        done
            Called once if this returns False: with None when socket and transport have accepted
            everything, else with the error.

        Returns
        -------
        bool
            True if socket and transport accepted everything at once.

        Raises
        ------
        OSError
            The connection is closed, or the file cannot be read or is too short.
        """
        self._rest = (head, file, offset, count)
        if self._push():
            return True
        self._done = done  # on_room continues: no task is woken for a part of a body
        return False

    async def answer(
        self, cycle: RequestResponseCycle, start: Any, message: Any, *, more_body: bool
    ) -> None:
        """Send a part of a body, and before the first one the head; waits for the socket.

        Parameters
        ----------
        cycle
            The request.
        start
            The message ``http.response.start``; None where it was sent.
        message
            ``file`` (a descriptor), ``offset``, ``count``.
        more_body
            Whether another part follows.

        Raises
        ------
        OSError
            When the file ends before `count`, or cannot be read: the client was promised more, so
            the connection is dropped.
        """
        if cycle.disconnected:
            return
        head = b"" if start is None else _head(cycle, start)
        cycle.response_started = True
        cycle.waiting_for_100_continue = False
        try:
            await self._send_file(head, message)
        except ConnectionError:
            cycle.disconnected = True
            self._transport.abort()
            return
        except OSError:
            self._transport.abort()
            raise
        if cycle.disconnected or more_body:
            return
        cycle.response_complete = True
        cycle.message_event.set()
        if not cycle.keep_alive:
            self._transport.close()
        cycle.on_response()

    def close(self) -> None:
        """Report to the sender of a body that the connection is closed."""
        if self._done is not None:
            self._end(ConnectionResetError())

    async def _send_file(self, head: bytes, message: Any) -> None:
        room = self._loop.create_future()

        def done(error: OSError | None) -> None:
            if room.done():
                return
            if error is None:
                room.set_result(None)
            else:
                room.set_exception(error)

        if self.begin(head, message["file"], message["offset"], message["count"], done):
            return
        try:
            await room
        finally:
            if self._done is done:  # cancelled
                self._end(None)

    def _push(self) -> bool:
        """Send what the socket accepts now; return whether that was everything."""
        if self._transport.is_closing():
            raise ConnectionResetError
        if self._transport.get_write_buffer_size():
            return False  # keep the order of bytes
        if self._secure is not None:
            return self._push_secure(self._secure)
        head, descriptor, offset, left = self._rest
        while head or left:
            if not head:
                offset, left = self._send_file_now(descriptor, offset, left)
            piece = os.pread(descriptor, min(left, _PIECE_BYTES), offset)
            if left and not piece:
                raise OSError(f"the file ends {left} bytes before its range")
            if head or piece:
                self._transport.write(head + piece)
            head, offset, left = b"", offset + len(piece), left - len(piece)
            if self._transport.is_closing():
                raise ConnectionResetError
            if self._transport.get_write_buffer_size():
                break
        self._rest = (head, descriptor, offset, left)
        return not left

    def _send_file_now(self, descriptor: int, offset: int, left: int) -> tuple[int, int]:
        """Send as much of the file as the socket accepts; return the remaining offset and count."""
        number = self._transport.get_extra_info("socket").fileno()
        try:
            while left and (sent := os.sendfile(number, descriptor, offset, left)):
                offset, left = offset + sent, left - sent
        except BlockingIOError:
            pass
        return offset, left

    def _push_secure(self, secure: SendingTransport) -> bool:
        head, descriptor, offset, left = self._rest
        while head or left:
            piece = secure.read_room[: min(left, READ_ROOM_BYTES)]
            if left and os.preadv(descriptor, [piece], offset) < len(piece):
                raise OSError(f"the file ends before {offset + left}, the end of its range")
            taken = secure.send_now([part for part in (head, piece) if part])
            of_head = min(taken, len(head))
            head, taken_of_file = head[of_head:], taken - of_head
            offset, left = offset + taken_of_file, left - taken_of_file
            if secure.get_write_buffer_size():
                self._rest = (head, descriptor, offset, left)
                return not (head or left)
            if secure.is_closing():
                raise ConnectionResetError
        return True

    def on_room(self) -> None:
        """Go on: the transport has nothing left to send."""
        if self._done is None:
            return
        try:
            if not self._push():
                return
        except OSError as error:
            self._end(error)
        else:
            self._end(None)

    def _end(self, error: OSError | None) -> None:
        assert self._done is not None
        done, self._done = self._done, None
        done(error)


def _head(cycle: RequestResponseCycle, start: Any) -> bytes:
    """Return status line and headers; the application has said the length."""
    lines = [_REASONS[start["status"]]]
    for name, value in (*cycle.default_headers, *start["headers"]):
        if name != b"connection":
            lines.append(b"%b: %b\r\n" % (name, value))
        elif value == b"close":  # a process that goes asks for it, with every answer
            cycle.keep_alive = False
    if not cycle.keep_alive:
        lines.append(b"connection: close\r\n")
    lines.append(b"\r\n")
    return b"".join(lines)


def with_files(files: FileSender, cycle: RequestResponseCycle, app: Any) -> Any:
    """Let an application send files (`http.response.zerocopysend`) beside bytes."""

    async def run(scope: Any, receive: Any, send: Any) -> None:
        start = None  # kept until it is known what follows: a file's head goes with its bytes

        async def send_any(message: Any) -> None:
            nonlocal start
            if message["type"] == FILES:
                head, start = start, None
                more_body = message.get("more_body", False)
                await files.answer(cycle, head, message, more_body=more_body)
                return
            if message["type"] == "http.response.start":
                start = message
                return
            if start is not None:
                head, start = start, None
                await send(head)
            await send(message)

        await app(scope, receive, send_any)

    return run
