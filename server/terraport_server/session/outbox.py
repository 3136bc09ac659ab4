"""What a session has to do and to say, in order.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from terraport_server.session.actions import Action, Close, Observer, SendMessage
from terraport_wire import CLOSE_CODES, CloseCode, Error, ErrorCode, Message

__all__ = ["Outbox"]

_LONGEST_TEXT = 1024


class Outbox:
    """Actions that wait to be carried out.

    Answers go in the order in which they were given; their number is bounded by the caller, who
    stops reading from a client while there are many. News of others (:meth:`post`) waits behind
    them, of each type only the newest: what others do never makes a slow client's outbox grow
    (spec/wire-protocol.md, section 16.4).

    Parameters
    ----------
    observer
        Is told of errors and of the end.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._actions: list[Action] = []  # short: an empty deque takes 0.8 KB of every session
        self._news: dict[str, Message] = {}
        self.closing = False
        """Whether a close is the last action; nothing can be added behind it."""

    def __len__(self) -> int:
        """Return how many actions wait, news not counted."""
        return len(self._actions)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits, and something may still come."""
        return not (self._actions or self._news or self.closing)

    def pop(self) -> Action | None:
        """Return the next action, once."""
        if self._actions:
            return self._actions.pop(0)
        if self._news and not self.closing:
            return SendMessage(self._news.pop(next(iter(self._news))))
        return None

    def add(self, action: Action) -> None:
        """Put an action last."""
        self._actions.append(action)

    def say(self, message: Message) -> None:
        """Put a message last."""
        self._actions.append(SendMessage(message))

    def post(self, message: Message) -> None:
        """Take news; an older one of the same type that still waits is dropped."""
        self._news.pop(message.TYPE, None)
        self._news[message.TYPE] = message

    def unpost(self) -> None:
        """Drop all news that wait."""
        self._news.clear()

    def error(
        self,
        code: ErrorCode,
        text: str,
        *,
        fatal: bool = False,
        generation: int | None = None,
        request: int | None = None,
        protocols: tuple[tuple[int, int], ...] | None = None,
    ) -> None:
        """Say that something was refused or failed."""
        error = Error(
            code=code,
            message=text[:_LONGEST_TEXT],
            fatal=fatal,
            generation=generation,
            request=request,
            protocols=protocols,
        )
        self.say(error)
        self._observer.refused(error)

    def fatal(
        self,
        code: ErrorCode,
        text: str,
        *,
        generation: int | None = None,
        protocols: tuple[tuple[int, int], ...] | None = None,
    ) -> None:
        """Say why the session cannot go on, and close."""
        if not self.closing:
            self.error(code, text, fatal=True, generation=generation, protocols=protocols)
            self.close(CLOSE_CODES[code], code)

    def close(self, code: CloseCode, reason: str, *, at_once: bool = False) -> None:
        """Close after what waits, or without it."""
        if at_once:
            self._actions.clear()
        self.closing = True
        self._observer.ending(reason)
        self._actions.append(Close(code, reason))
