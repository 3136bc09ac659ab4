"""One client's session: messages and time in, actions out.

PURE: no I/O, no clock, no task. Times are seconds on any one monotonic clock of the caller's.

The caller feeds :meth:`Session.receive`, :meth:`Session.refuse`, :meth:`Session.heard`,
:meth:`Session.tick` and a few news, and carries out what :meth:`Session.next_action` returns, in
that order, until it returns ``None``. Messages go before plans, plans before payload, a landing's
payload before an aim's. Section numbers in comments are those of spec/wire-protocol.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from terraport_server.session.actions import (
    Action,
    Authorise,
    GroupPort,
    MakePlan,
    Observer,
    SceneView,
    SendChunk,
    SessionLimits,
)
from terraport_server.session.deliveries import Deliveries
from terraport_server.session.greeting import check_hello, make_welcome, no_hello_text
from terraport_server.session.group_talk import GroupMessage, GroupTalk
from terraport_server.session.outbox import Outbox
from terraport_server.session.pick_talk import INTERNAL_TEXT, PickTalk
from terraport_server.session.rate import HELD_ROWS_PER_MESSAGE, RateLimit
from terraport_wire import (
    Aim,
    Bye,
    CloseCode,
    Credit,
    DecodeError,
    ErrorCode,
    Evict,
    FieldError,
    Held,
    HeldChecked,
    Hello,
    Hit,
    Land,
    Message,
    Notice,
    Pick,
    Reject,
    Unknown,
)

__all__ = ["INTERNAL_TEXT", "Session"]


class Session:
    """The state machine. One per connection; not thread-safe.

    Parameters
    ----------
    scene
        What is served.
    limits
        What the client may do.
    session_id
        For the logs of both sides.
    now_s
        When the connection was accepted.
    authorise
        Decides on ``hello.token``; ``None`` where that is settled already.
    observer
        Told of what happens, synchronously.
    groups
        Way to the groups of this process; ``None`` where there are none.
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
        self._out = Outbox(self._observer)
        self._groups = GroupTalk(
            groups, self._out, max_radius_m=limits.max_radius_m, observer=self._observer
        )
        self._opened_s = self._heard_s = now_s
        self._rate = RateLimit(limits.max_messages_per_s, now_s=now_s)
        self._draining_until_s: float | None = None
        self._generation: int | None = None
        self._picks = PickTalk(self._out, limits.max_picks)
        self._news: str | None = None
        self._deliveries: Deliveries | None = None

    @property
    def pending(self) -> int:
        """Actions waiting to be carried out, payload not counted.

        It grows only by what the client sends, so a caller that stops reading while it is high
        keeps it bounded.
        """
        return len(self._out)

    @property
    def closing(self) -> bool:
        """Whether the session is over but for what is pending."""
        return self._out.closing

    @property
    def generation(self) -> int | None:
        """The newest generation, for logs."""
        return self._generation

    @property
    def encoding(self) -> str:
        """The payload encoding; only once it is welcome."""
        assert self._deliveries is not None
        return self._deliveries.encoding

    @property
    def deliveries(self) -> Deliveries | None:
        """What the client holds and is being sent, once it is welcome; to look at only."""
        return self._deliveries

    def upcoming(self, most: int) -> list[int]:
        """Return the segments that are sent next, in order, ``most`` of them at most."""
        return [] if self._deliveries is None else self._deliveries.upcoming(most)

    def wake_at_s(self) -> float:
        """When :meth:`tick` has something to do at the latest."""
        if self._deliveries is None:
            times = [self._opened_s + self._limits.handshake_timeout_s]
        else:
            times = [self._heard_s + self._limits.idle_timeout_s]
            if self._deliveries.deadline_s is not None:
                times.append(self._deliveries.deadline_s)
        if self._draining_until_s is not None:
            times.append(self._draining_until_s)
        return min(times)

    def next_action(self) -> Action | None:
        """Return what to do next; ``None`` until something happens.

        A :class:`SendChunk` or :class:`MakePlan` is returned again until it is answered; everything
        else once.
        """
        action = self._out.pop()
        if action is not None or self._deliveries is None or self._out.closing:
            return action
        if self._deliveries.plan_is_due:
            return MakePlan()
        chunks = self.next_chunks(1)
        return chunks[0] if chunks else None

    def make_plan(self, now_s: float) -> int:
        """Answer :class:`MakePlan`: plan the newest landing or aim, if one still waits.

        Returns
        -------
        int
            How many segments were looked at: what it cost.
        """
        if self._deliveries is None or self._out.closing:
            return 0
        looked_at = self._deliveries.make_plan(now_s)
        self._close_if_drained()
        return looked_at

    def next_chunks(self, most_bytes: int) -> list[SendChunk]:
        """Return payload to send, ending with the chunk that reaches so many bytes.

        None while anything else goes first. Answer for those sent by :meth:`chunks_sent`.
        """
        if self._deliveries is None or not self._out.is_idle:
            return []
        return self._deliveries.next_chunks(most_bytes)

    def receive(self, message: Message | Unknown, now_s: float) -> None:
        """Act on one decoded message; before ``hello`` every other one is fatal."""
        if not self._admit(now_s):
            return
        deliveries = self._deliveries
        if isinstance(message, Hello):
            self._on_hello(message)
        elif deliveries is None:
            what = "an unknown type" if isinstance(message, Unknown) else message.TYPE
            self._out.fatal(ErrorCode.OUT_OF_ORDER, f"got {what} first, expected hello")
        elif isinstance(message, Land | Aim):
            if self._take_generation(message.generation) and self._may_go(message):
                if isinstance(message, Land):
                    deliveries.land(message, now_s)
                    self._groups.landed(message.position, now_s)
                else:
                    deliveries.aim(message, now_s)
        elif isinstance(message, Credit):
            deliveries.grant(message.bytes, now_s)
        elif isinstance(message, Evict):
            self._on_evict(message, deliveries)
        elif isinstance(message, Reject):
            self._on_reject(message, deliveries, now_s)
        elif isinstance(message, Pick):
            self._picks.receive(message)
        elif isinstance(message, Held):
            self._on_held(message, deliveries, now_s)
        elif isinstance(message, GroupMessage):
            self._groups.receive(message, now_s, draining=self._draining_until_s is not None)
        elif isinstance(message, Bye):
            self._groups.leave(now_s)
            self._out.close(CloseCode.NORMAL, "bye", at_once=True)

    def refuse(self, error: DecodeError, now_s: float) -> None:
        """Answer one message that could not be decoded: fatal, or an error of its request."""
        if not self._admit(now_s):
            return
        generation = request = None
        if isinstance(error, FieldError):
            generation, request = error.generation, error.request
        if error.fatal or self._deliveries is None:
            self._out.fatal(error.code, str(error), generation=generation)
        elif generation is None or self._take_generation(generation):
            self._out.error(error.code, str(error), generation=generation, request=request)

    def heard(self, now_s: float) -> None:
        """Note that something, if only a pong, came from the client."""
        self._heard_s = max(self._heard_s, now_s)

    def tick(self, now_s: float) -> None:
        """Act on what time alone decides."""
        if self._out.closing:
            return
        limits, deliveries = self._limits, self._deliveries
        if self._draining_until_s is not None and now_s >= self._draining_until_s:
            self._out.close(CloseCode.DRAINING, ErrorCode.DRAINING)
        elif deliveries is None:
            if now_s >= self._opened_s + limits.handshake_timeout_s:
                self._out.fatal(ErrorCode.TIMEOUT, no_hello_text(limits.handshake_timeout_s))
        elif now_s >= self._heard_s + limits.idle_timeout_s:
            text = f"got nothing for {limits.idle_timeout_s:g} s, expected at least pongs"
            self._out.fatal(ErrorCode.TIMEOUT, text)
        else:
            deliveries.settle(now_s)

    def chunks_sent(self, chunks: Sequence[SendChunk], now_s: float) -> None:
        """Book as sent the chunk of :meth:`next_action`, or the first of :meth:`next_chunks`."""
        assert self._deliveries is not None
        self._deliveries.chunks_sent(chunks, now_s)
        self._close_if_drained()

    def payload_failed(self, chunk: SendChunk, now_s: float) -> None:
        """Note that the segment of that chunk cannot be read whole and right: it is missing."""
        assert self._deliveries is not None
        self._deliveries.payload_failed(chunk, now_s)
        self._close_if_drained()

    def plan_sent(self, generation: int, now_s: float) -> None:
        """Note that the plan of that generation was handed to the socket."""
        if self._deliveries is not None:
            self._deliveries.plan_sent(generation, now_s)

    def picked(self, request: int, hit: Hit | None) -> None:
        """Answer a pick."""
        self._picks.picked(request, hit)

    def pick_failed(self, request: int) -> None:
        """Say that a pick could not be answered; the session goes on."""
        self._picks.failed(request)

    def scene_published(self, version: str) -> None:
        """Tell, after the welcome at the earliest, that new sessions get a newer version."""
        if self._out.closing:
            return
        if self._deliveries is None:
            self._news = version
        else:
            self._out.say(Notice(kind="scene_published", version=version))

    def drain(
        self, now_s: float, timeout_s: float, *, reconnect_after_ms: int | None = None
    ) -> None:
        """Go away: finish the open landing within the time, then close (10).

        ``reconnect_after_ms`` is what the client is told; None: what the limits say.
        """
        if self._out.closing or self._draining_until_s is not None:
            return
        self._draining_until_s = now_s + timeout_s
        if self._deliveries is not None:
            after_ms = reconnect_after_ms
            if after_ms is None:
                after_ms = self._limits.reconnect_after_ms
            self._out.say(Notice(kind="draining", reconnect_after_ms=after_ms))
            self._deliveries.end_aims(by=None)
        self._close_if_drained()

    def withdraw(self, text: str) -> None:
        """End the session because its token opens the scene no more; the text says why."""
        self._out.fatal(ErrorCode.UNAUTHORISED, text)

    def tell_group(self, message: Message) -> None:
        """Pass on a message of the group."""
        self._groups.tell(message)

    def ended(self) -> None:
        """Settle the accounts: the connection is gone."""
        if self._deliveries is not None:
            self._deliveries.end()

    def fail(self) -> None:
        """End the session for a fault of our own, without telling what it was."""
        self._out.fatal(ErrorCode.INTERNAL, INTERNAL_TEXT)

    def _on_hello(self, hello: Hello) -> None:
        if self._deliveries is not None:
            self._out.fatal(ErrorCode.OUT_OF_ORDER, "got a second hello, expected one")
            return
        scene, limits = self._scene, self._limits
        refusal = check_hello(hello, scene, limits, self._authorise)
        if refusal is not None:
            self._out.fatal(refusal.code, refusal.text, protocols=refusal.protocols)
            return
        self._deliveries = Deliveries(
            scene, limits, hello, say=self._out.say, observer=self._observer
        )
        self._out.say(make_welcome(hello, scene, limits, self._deliveries, self.id))
        if self._news is not None:
            self.scene_published(self._news)

    def _on_held(self, held: Held, deliveries: Deliveries, now_s: float) -> None:
        rows, most = len(held.segments), self._limits.max_held_segments
        if not deliveries.may_offer:
            text = "got held after an aim or land, expected it before the first one"
            self._out.fatal(ErrorCode.OUT_OF_ORDER, text)
        elif rows > most:
            text = f"got {rows} held segments, expected at most {most}"
            self._out.fatal(ErrorCode.TOO_LARGE, text)
        elif self._admit(now_s, rows // HELD_ROWS_PER_MESSAGE):
            dropped = deliveries.take_held(held.segments, now_s)
            self._out.say(HeldChecked(dropped=dropped, held_count=len(deliveries.held)))
            self._close_if_drained()

    def _on_evict(self, evict: Evict, deliveries: Deliveries) -> None:
        wrong = deliveries.evict(evict.segments)
        if wrong is not None:
            self._out.fatal(ErrorCode.OUT_OF_ORDER, wrong)

    def _on_reject(self, reject: Reject, deliveries: Deliveries, now_s: float) -> None:
        if reject.segment >= deliveries.payload_count:
            text = f"got segment {reject.segment}, expected one below {deliveries.payload_count}"
            self._out.fatal(ErrorCode.INVALID_FIELD, f"reject.segment: {text}")
            return
        deliveries.reject(reject, now_s)
        self._close_if_drained()

    def _admit(self, now_s: float, count: int = 1) -> bool:
        if self._out.closing:
            return False
        self.heard(now_s)
        if self._rate.take(now_s, count):
            return True
        self._out.fatal(ErrorCode.TOO_MANY, self._rate.broken_text)
        return False

    def _take_generation(self, generation: int) -> bool:
        newest = self._generation
        if newest is not None and generation <= newest:
            text = f"got generation {generation}, expected one above {newest}"
            self._out.fatal(ErrorCode.OUT_OF_ORDER, text, generation=generation)
            return False
        self._generation = generation
        return True

    def _may_go(self, message: Land | Aim) -> bool:
        """Check an aim or land against what this server allows now."""
        most_m = self._limits.max_radius_m
        if self._draining_until_s is not None:
            text = f"got {message.TYPE} while the server goes away, expected a new connection"
            self._out.fatal(ErrorCode.DRAINING, text, generation=message.generation)
            return False
        name = "radius_m" if message.coarse_radius_m is None else "coarse_radius_m"
        largest_m: float = getattr(message, name)
        if largest_m > most_m:
            text = f"{message.TYPE}.{name}: got {largest_m:g}, expected at most {most_m:g}"
            self._out.error(ErrorCode.RADIUS_TOO_LARGE, text, generation=message.generation)
            return False
        return True

    def _close_if_drained(self) -> None:
        lands = self._deliveries is not None and self._deliveries.landing_open
        if not (self._out.closing or self._draining_until_s is None or lands):
            self._out.close(CloseCode.DRAINING, ErrorCode.DRAINING)
