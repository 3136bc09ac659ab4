"""State machine of one client's session: messages and time in, actions out.

PURE: no I/O, no clock, no task. Times are seconds on one monotonic clock of the caller.

The caller feeds :meth:`Session.receive`, :meth:`Session.refuse`, :meth:`Session.heard`,
:meth:`Session.tick` and events of the server, and carries out what :meth:`Session.next_action`
returns, in that order, until it returns ``None``. Messages precede plans, plans precede payload,
and a landing's payload precedes a prefetch's. Section numbers are those of spec/protocol.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from terraport_server.groups.state import Place
from terraport_server.session.interface import (
    Action,
    Authorise,
    Close,
    GroupPort,
    MakePlan,
    Observer,
    RunPick,
    SceneView,
    SendChunk,
    SendMessage,
    SessionLimits,
)
from terraport_server.session.landings import Landings
from terraport_server.session.rate_limit import RateLimit
from terraport_wire import (
    CLOSE_CODES,
    Arrived,
    Bye,
    CloseCode,
    Credit,
    DecodeError,
    Error,
    ErrorCode,
    FieldError,
    Gather,
    Hello,
    Hit,
    Join,
    Joined,
    Land,
    Leave,
    Limits,
    Message,
    Notice,
    Pick,
    Picked,
    Prefetch,
    SceneFacts,
    Unknown,
    Welcome,
)

__all__ = ["INTERNAL_TEXT", "UNAUTHORISED_TEXT", "Session", "no_hello_text"]

INTERNAL_TEXT = "the server failed; the operator's log has the reason"
"""Text of every internal error; details are logged, never sent."""

UNAUTHORISED_TEXT = "got no token that opens this scene, expected one"

_MAX_ERROR_TEXT = 1024
"""Maximum characters of an error's text."""

_GroupMessage = Join | Leave | Gather | Arrived


def no_hello_text(timeout_s: float) -> str:
    """Return the error text for a client that sent no ``hello`` in time."""
    return f"got no hello in {timeout_s:g} s, expected it first"


class Session:
    """State machine of one connection; not thread-safe.

    Parameters
    ----------
    scene
        The served scene.
    limits
        Limits of the session.
    session_id
        Identifies the session in the logs of client and server.
    now_s
        Time when the connection was accepted.
    authorise
        Checks ``hello.token``; ``None`` if the handshake already authorised the client.
    observer
        Receives events for metrics and logs, synchronously.
    groups
        Access to the groups of this process; ``None`` if groups are not served.
    """

    def __init__(
        self,
        scene: SceneView,
        limits: SessionLimits,
        *,
        session_id: str,
        now_s: float,
        authorise: Authorise | None = None,
        observer: Observer | None = None,
        groups: GroupPort | None = None,
    ) -> None:
        self.id = session_id
        self._scene = scene
        self._limits = limits
        self._authorise = authorise
        self._observer = observer or Observer()
        self._actions: list[Action] = []  # an empty deque would take 0.8 KB per session
        self._group_news: dict[str, Message] = {}
        """Newest message of each type about the group, sent after all actions (10.4)."""
        self.closing = False
        """Whether the session is over except for its pending actions."""
        self._groups = groups
        self._place: Place | None = None
        """Centre of the newest accepted landing: the member's position on joining (10.1)."""
        self._opened_s = self._heard_s = now_s
        self._rate = RateLimit(limits.max_messages_per_s, now_s=now_s)
        self._draining_until_s: float | None = None
        self._generation: int | None = None
        self._open_picks = 0
        self._published: str | None = None
        """Newest scene version published before the welcome."""
        self._landings: Landings | None = None

    @property
    def pending(self) -> int:
        """Number of queued actions, excluding payload and group news.

        Only messages of the client add actions: to bound their number, stop reading.
        """
        return len(self._actions)

    @property
    def is_open(self) -> bool:
        """Whether the client was welcomed."""
        return self._landings is not None

    @property
    def credit_bytes(self) -> int:
        """Payload bytes that may still be sent."""
        return 0 if self._landings is None else self._landings.credit_bytes

    def upcoming(self, most: int) -> list[int]:
        """Return at most ``most`` of the next segments in sending order."""
        return [] if self._landings is None else self._landings.upcoming(most)

    def wake_at_s(self) -> float:
        """Return the time at which :meth:`tick` must be called."""
        if self._landings is None:
            due_s = self._opened_s + self._limits.handshake_timeout_s
        else:
            due_s = self._heard_s + self._limits.idle_timeout_s
        if self._draining_until_s is not None:
            due_s = min(due_s, self._draining_until_s)
        return due_s

    def next_action(self) -> Action | None:
        """Return the next action; ``None`` if there is none.

        A :class:`SendChunk` or :class:`MakePlan` is returned until it is carried out; every other
        action once.
        """
        if self._actions:
            return self._actions.pop(0)
        if self.closing:
            return None
        if self._group_news:
            return SendMessage(self._group_news.pop(next(iter(self._group_news))))
        if self._landings is None:
            return None
        if self._landings.plan_is_due:
            return MakePlan()
        chunks = self.next_chunks(1)
        return chunks[0] if chunks else None

    def make_plan(self, now_s: float) -> int:
        """Carry out :class:`MakePlan`: plan the newest landing or prefetch, if one still waits.

        Returns
        -------
        int
            Number of segments examined: the cost of the plan.
        """
        if self._landings is None or self.closing:
            return 0
        looked_at = self._landings.make_plan(now_s)
        self._close_if_drained()
        return looked_at

    def next_chunks(self, most_bytes: int) -> list[SendChunk]:
        """Return payload to send, ending with the chunk that reaches ``most_bytes``.

        Empty while other actions are queued. Report the chunks sent to :meth:`chunks_sent`.
        """
        if self._landings is None or self._actions or self._group_news or self.closing:
            return []
        return self._landings.next_chunks(most_bytes)

    def receive(self, message: Message | Unknown, now_s: float) -> None:
        """Handle one decoded message; before ``hello`` any other message is fatal."""
        if not self._admit(now_s):
            return
        if isinstance(message, Unknown):
            if self._landings is None:
                text = "got an unknown type first, expected hello"
                self._fatal(ErrorCode.OUT_OF_ORDER, text)
        elif isinstance(message, Hello):
            self._on_hello(message)
        elif self._landings is None:
            self._fatal(ErrorCode.OUT_OF_ORDER, f"got {message.TYPE} first, expected hello")
        elif isinstance(message, Credit):
            self._landings.grant(message.bytes)
        elif isinstance(message, Pick):
            self._on_pick(message)
        elif isinstance(message, _GroupMessage):
            self._on_group_message(message, now_s)
        elif isinstance(message, Bye):
            self._leave_group(now_s)
            self._actions.clear()
            self._close(CloseCode.NORMAL, "bye")
        elif isinstance(message, Prefetch):
            self._on_prefetch(message, self._landings, now_s)

    def _on_prefetch(self, wanted: Prefetch, landings: Landings, now_s: float) -> None:
        """Handle a landing, or a prefetch."""
        if not (self._take_generation(wanted.generation) and self._may_go(wanted)):
            return
        if isinstance(wanted, Land):
            landings.land(wanted, now_s)
            self._place = wanted.position
            if self._groups is not None:
                self._groups.landed(wanted.position, now_s)
        else:
            landings.prefetch(wanted)

    def refuse(self, error: DecodeError, now_s: float) -> None:
        """Handle a message that could not be decoded: fatal, or an error of its request."""
        if not self._admit(now_s):
            return
        generation = request = None
        if isinstance(error, FieldError):
            generation, request = error.generation, error.request
        if error.fatal or self._landings is None:
            self._fatal(error.code, str(error), generation=generation)
        elif generation is None or self._take_generation(generation):
            self._error(error.code, str(error), generation=generation, request=request)

    def heard(self, now_s: float) -> None:
        """Record that data, if only a pong, was received."""
        self._heard_s = max(self._heard_s, now_s)

    def tick(self, now_s: float) -> None:
        """Handle timeouts."""
        if self.closing:
            return
        limits = self._limits
        if self._draining_until_s is not None and now_s >= self._draining_until_s:
            self._close(CloseCode.DRAINING, ErrorCode.DRAINING)
        elif self._landings is None:
            if now_s >= self._opened_s + limits.handshake_timeout_s:
                self._fatal(ErrorCode.TIMEOUT, no_hello_text(limits.handshake_timeout_s))
        elif now_s >= self._heard_s + limits.idle_timeout_s:
            text = f"got nothing for {limits.idle_timeout_s:g} s, expected at least pongs"
            self._fatal(ErrorCode.TIMEOUT, text)

    def chunks_sent(self, chunks: Sequence[SendChunk], now_s: float) -> None:
        """Record as sent the chunk of :meth:`next_action`, or the first of :meth:`next_chunks`."""
        assert self._landings is not None
        self._landings.chunks_sent(chunks, now_s)
        self._close_if_drained()

    def payload_failed(self, now_s: float) -> None:
        """Report as missing the segment of the next chunk: it cannot be read or verified."""
        assert self._landings is not None
        self._landings.payload_failed(now_s)
        self._close_if_drained()

    def plan_sent(self, generation: int, now_s: float) -> None:
        """Record that the plan of a generation was handed to the socket."""
        if self._landings is not None:
            self._landings.plan_sent(generation, now_s)

    def picked(self, request: int, hit: Hit | None) -> None:
        """Answer a pick."""
        self._open_picks -= 1
        if not self.closing:
            self._send(Picked(request=request, hit=hit))

    def pick_failed(self, request: int) -> None:
        """Answer a pick with an error; the session continues."""
        self._open_picks -= 1
        if not self.closing:
            self._error(ErrorCode.INTERNAL, INTERNAL_TEXT, request=request)

    def scene_published(self, version: str) -> None:
        """Notify the client, after the welcome, of a newer version that new sessions get."""
        if self.closing:
            return
        if self._landings is None:
            self._published = version
        else:
            self._send(Notice(kind="scene_published", version=version))

    def drain(
        self, now_s: float, timeout_s: float, *, reconnect_after_ms: int | None = None
    ) -> None:
        """Finish the open landing within ``timeout_s``, then close (9).

        ``reconnect_after_ms`` is sent to the client; None: that of the limits.
        """
        if self.closing or self._draining_until_s is not None:
            return
        self._draining_until_s = now_s + timeout_s
        if self._landings is not None:
            after_ms = reconnect_after_ms
            if after_ms is None:
                after_ms = self._limits.reconnect_after_ms
            self._send(Notice(kind="draining", reconnect_after_ms=after_ms))
            self._landings.end_prefetch()
        self._close_if_drained()

    def withdraw(self, text: str) -> None:
        """End the session because its token no longer opens the scene."""
        self._fatal(ErrorCode.UNAUTHORISED, text)

    def tell_group(self, message: Message) -> None:
        """Send a message of the group; only the newest of each type waits (10.4)."""
        if isinstance(message, Joined):
            self._group_news.clear()  # of the group joined before
            self._send(message)
        elif not self.closing:
            self._group_news.pop(message.TYPE, None)
            self._group_news[message.TYPE] = message

    def _on_hello(self, hello: Hello) -> None:
        """Check a hello and answer it with a welcome."""
        if self._landings is not None:
            self._fatal(ErrorCode.OUT_OF_ORDER, "got a second hello, expected one")
            return
        refused = None if self._authorise is None else self._authorise(hello.token)
        if refused is not None:
            self._fatal(*refused)
            return
        self._landings = Landings(
            self._scene, self._limits, hello, send=self._send, observer=self._observer
        )
        self._send(self._welcome())
        if self._published is not None:
            self.scene_published(self._published)

    def _welcome(self) -> Welcome:
        scene, limits = self._scene, self._limits
        return Welcome(
            server=limits.server,
            session=self.id,
            scene=SceneFacts(
                id=scene.id,
                name=scene.name,
                version=scene.version,
                segment_count=scene.table.segment_count,
                base_faces=scene.hidden_faces.base_faces,
                levels=scene.table.levels,
            ),
            limits=Limits(
                max_radius_m=limits.max_radius_m,
                max_message_bytes=limits.max_message_bytes,
                max_messages_per_s=limits.max_messages_per_s,
                max_credit_bytes=limits.max_credit_bytes,
                idle_timeout_s=limits.idle_timeout_s,
                groups=limits.groups,
            ),
        )

    def _on_pick(self, pick: Pick) -> None:
        most = self._limits.max_picks
        if self._open_picks >= most:
            text = f"got {self._open_picks + 1} picks at once, expected at most {most}"
            self._error(ErrorCode.TOO_MANY, text, request=pick.request)
            return
        self._open_picks += 1
        self._actions.append(RunPick(pick.request, pick.origin, pick.direction))

    def _on_group_message(self, message: _GroupMessage, now_s: float) -> None:
        if isinstance(message, Join | Gather):
            refusal = self._request_group(message, now_s)
            self._observer.grouped(message.TYPE if refusal is None else "refused")
            if refusal is not None:
                self._error(ErrorCode.GROUP_REFUSED, refusal, request=message.request)
        elif isinstance(message, Leave):
            self._leave_group(now_s)
        elif self._groups is not None:
            self._groups.arrived(message)

    def _request_group(self, message: Join | Gather, now_s: float) -> str | None:
        """Pass on a join or gather; return the reason of a refusal."""
        most_m = self._limits.max_radius_m
        if self._groups is None:
            return f"got {message.TYPE}, expected none: no groups are served here"
        if self._draining_until_s is not None:
            return f"got {message.TYPE} while the server goes away, expected a new connection"
        if isinstance(message, Join):
            return self._groups.join(message, self._place, now_s)
        if message.radius_m > most_m:
            return f"gather.radius_m: got {message.radius_m:g}, expected at most {most_m:g}"
        return self._groups.gather(message, now_s)

    def _leave_group(self, now_s: float) -> None:
        self._group_news.clear()
        if self._groups is not None:
            self._groups.leave(now_s)

    def _admit(self, now_s: float) -> bool:
        if self.closing:
            return False
        self.heard(now_s)
        if self._rate.take(now_s):
            return True
        self._fatal(ErrorCode.TOO_MANY, self._rate.broken_text)
        return False

    def _take_generation(self, generation: int) -> bool:
        newest = self._generation
        if newest is not None and generation <= newest:
            text = f"got generation {generation}, expected one above {newest}"
            self._fatal(ErrorCode.OUT_OF_ORDER, text, generation=generation)
            return False
        self._generation = generation
        return True

    def _may_go(self, message: Prefetch) -> bool:
        """Check a landing or prefetch against the limits; refuse it if needed."""
        most_m = self._limits.max_radius_m
        if self._draining_until_s is not None:
            if not isinstance(message, Land):
                return False  # the open landing goes on
            text = f"got {message.TYPE} while the server goes away, expected a new connection"
            self._fatal(ErrorCode.DRAINING, text, generation=message.generation)
            return False
        name = "radius_m" if message.coarse_radius_m is None else "coarse_radius_m"
        largest_m: float = getattr(message, name)
        if largest_m > most_m:
            text = f"{message.TYPE}.{name}: got {largest_m:g}, expected at most {most_m:g}"
            self._error(ErrorCode.RADIUS_TOO_LARGE, text, generation=message.generation)
            return False
        return True

    def _close_if_drained(self) -> None:
        lands = self._landings is not None and self._landings.landing_open
        if not (self.closing or self._draining_until_s is None or lands):
            self._close(CloseCode.DRAINING, ErrorCode.DRAINING)

    def _send(self, message: Message) -> None:
        self._actions.append(SendMessage(message))

    def _error(
        self,
        code: ErrorCode,
        text: str,
        *,
        fatal: bool = False,
        generation: int | None = None,
        request: int | None = None,
    ) -> None:
        error = Error(
            code=code,
            message=text[:_MAX_ERROR_TEXT],
            fatal=fatal,
            generation=generation,
            request=request,
        )
        self._send(error)
        self._observer.refused(error)

    def _fatal(self, code: ErrorCode, text: str, *, generation: int | None = None) -> None:
        """Send a fatal error and close; ignored once the session is closing."""
        if not self.closing:
            self._error(code, text, fatal=True, generation=generation)
            self._close(CLOSE_CODES[code], code)

    def _close(self, code: CloseCode, reason: str) -> None:
        """Close after the pending actions."""
        self.closing = True
        self._observer.ending(reason)
        self._actions.append(Close(code, reason))
