"""HTTP connections that answer requests for payload themselves, where that needs no wait.

In their turn and within every bound of :class:`HttpConnection`; all other requests, and of these
whatever :mod:`short_answers` has no answer for, go to the application.
"""

from __future__ import annotations

import asyncio
import os
from typing import Final

from terraport_server.http_connection import HttpConnection, http_protocol_class
from terraport_server.service import Service
from terraport_server.settings import Settings
from terraport_server.short_answers import Asked, ShortAnswer, ShortAnswers, read_request

__all__ = ["PayloadConnection", "answering_class"]

_MAX_FILE_BYTES: Final = 4 << 20
"""Longer bodies are looked for in the page cache as they are sent, not before."""

_MAX_READ_BYTES: Final = 1 << 20
"""The same where the connection takes no files, and they are in memory until they are sent."""

_MAX_HEAD_BYTES: Final = 4 << 10
"""What came is looked at as a whole as long as it is no more."""


class PayloadConnection(HttpConnection):
    """One HTTP connection."""

    short_answers: ShortAnswers

    _asked: Asked | None = None
    """What was last asked for the short way, or waits for its turn."""
    _sending: ShortAnswer | None = None
    """Whose body the socket has not all of yet."""
    _idle_since_s = 0.0
    """When the last answer of the short way ended."""
    _ends = False
    """Whether the answer under way is the last."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Look at what a head may have at most."""
        self._max_head_bytes = min(_MAX_HEAD_BYTES, self.limits.header_bytes)
        super().connection_made(transport)

    def shutdown(self) -> None:
        """Close, after the answer that is under way."""
        if self._sending is None:
            super().shutdown()
        else:
            self._ends = True

    def timeout_keep_alive_handler(self) -> None:
        """Close if it has been silent for so long; answers of the short way leave the timer be."""
        self.timeout_keep_alive_task = None
        left_s = self._idle_since_s + self.timeout_keep_alive - self.loop.time()
        if self._waits:  # an answer is under way, or is due
            left_s = self.timeout_keep_alive
        if left_s > 0:
            self._wait_for_more(left_s)
        else:
            super().timeout_keep_alive_handler()

    def _begin_next(self) -> None:
        asked = self._ask_short()
        if asked is None:
            self._take_piece()
        else:
            self._wait(self._answer_short, asked.headers)

    def _ask_short(self) -> Asked | None:
        """Return the request that what came begins with, if it may be answered the short way."""
        if (
            self._in_request
            or self._full is not None
            or len(self._unread) > self._max_head_bytes
            or not (self.cycle is None or self.cycle.response_complete)
        ):
            return None
        asked = read_request(self._unread, self._asked)
        if asked is not None:
            self._asked = asked
        return asked

    def _answer_short(self) -> None:
        """Answer what was asked, or let the application do it."""
        if self._over or self.transport.is_closing():
            return
        assert self._asked is not None
        files, defaults = self._files, self.server_state.default_headers
        answer = None
        # Nothing may be overtaken; and who asks for the end of connections is heard the long way.
        if not self.transport.get_write_buffer_size() and len(defaults) == 1:
            most_bytes = _MAX_READ_BYTES if files is None else _MAX_FILE_BYTES
            answer = self.short_answers.find(self._asked, defaults[0], most_bytes)
        if answer is None:
            self._waits = False
            self._take_piece()
            return
        self._unread = self._unread[self._asked.size :]
        self._header_deadline.stop()
        self.answered(answer.file.part.status)
        try:
            if self._send_short(answer):
                self._short_sent(None)
        except OSError as error:
            self._short_sent(error)

    def _send_short(self, answer: ShortAnswer) -> bool:
        """Send head and body; False where the socket takes the rest later."""
        self._sending, body = answer, answer.body
        answer.file.served.hold()
        if body is None:
            self.transport.write(answer.head)
        elif self._files is not None:
            return self._files.begin(answer.head, *body[:3], self._short_sent)
        else:
            data = os.pread(body.descriptor, body.length, body.offset)
            if len(data) < body.length:
                raise OSError(f"the file ends {body.length - len(data)} bytes before its range")
            self.transport.write(answer.head)
            self.transport.write(data)
        return True

    def _short_sent(self, error: OSError | None) -> None:
        """Go on after an answer."""
        assert self._sending is not None
        answer, self._sending, self._waits = self._sending, None, False
        answer.file.served.release()
        if error is not None:
            if not isinstance(error, ConnectionError):
                answer.file.tell_failure(error)
            self.transport.abort()
            return
        self.server_state.total_requests += 1
        self._let_go()
        if self._ends:
            self.transport.close()
            self._abort_soon()
        if self.transport.is_closing():
            return
        self._idle_since_s = self.loop.time()
        if self.timeout_keep_alive_task is None:
            self._wait_for_more(self.timeout_keep_alive)
        if not self._unread:
            self._read_on()
            return
        asked = self._ask_short()
        if asked is None:
            self._wait(self._read_on)
        else:
            self._wait(self._answer_short, asked.headers)

    def _wait_for_more(self, wait_s: float) -> None:
        handler = self.timeout_keep_alive_handler
        self.timeout_keep_alive_task = self.loop.call_later(wait_s, handler)


def answering_class(settings: Settings, service: Service) -> type[PayloadConnection]:
    """Return a class for uvicorn's ``http`` option, with its bounds set."""
    bounded = http_protocol_class(settings, service.note_refusal)
    members = {"short_answers": ShortAnswers(service)}
    return type("PayloadConnection", (PayloadConnection, bounded), members)
