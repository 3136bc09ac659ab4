"""The client's half of the wire protocol as a state machine.

WebSocket messages in; events, and messages to send, out.

The shell (:mod:`terraport.client`) owns sockets, tasks, files and clocks. It calls

* :meth:`ClientSession.connected`, :meth:`~ClientSession.receive`,
  :meth:`~ClientSession.connection_lost` as the connection lives and dies;
* :meth:`~ClientSession.land`, :meth:`~ClientSession.aim`, :meth:`~ClientSession.pick` for its user;
* :meth:`~ClientSession.restored`, :meth:`~ClientSession.lost`,
  :meth:`~ClientSession.stored_on_disk`,
  :meth:`~ClientSession.removed_from_disk` for its disk cache;

and after each of them drains :meth:`~ClientSession.events` and :meth:`~ClientSession.data_to_send`.

Section numbers in comments are those of ``spec/wire-protocol.md``.

PURE: no I/O, no clock, no task.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable, Sequence

from terraport.aim_counts import AimCounts
from terraport.aim_state import AimState
from terraport.cache import CachedSegment, SegmentCache, SegmentFacts
from terraport.errors import ProtocolViolationError
from terraport.events import (
    Dropped,
    Event,
    LandingSent,
    Noticed,
    Opened,
    Refused,
    Superseded,
)
from terraport.group_state import GroupState
from terraport.holdings import Holdings
from terraport.landing_state import LandingState
from terraport.offer import HeldOffer
from terraport.options import SessionOptions, checked, point
from terraport.pick_state import PickState
from terraport.pull_ranges import PackAddress
from terraport.transfers import Transfers
from terraport_wire import (
    PROTOCOL,
    Bye,
    Credit,
    DecodeError,
    Degraded,
    Direction,
    Error,
    HeldChecked,
    Land,
    Message,
    Notice,
    PayloadFrame,
    Picked,
    Plan,
    Prefetch,
    PullInfo,
    Ready,
    Unknown,
    Welcome,
    decode,
    decode_frame,
    encode,
    is_payload,
)
from terraport_wire import Superseded as SupersededMessage

__all__ = ["ClientSession", "SessionOptions"]

_PACK_PATH = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}/[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
"""Of a version's file, as the scene format has it (section 1)."""


class ClientSession:
    """The state machine. It outlives connections. Not thread-safe.

    Parameters
    ----------
    options : SessionOptions
        What is told to the server.
    cache : SegmentCache
        Payloads in memory; from now on owned by the session.
    on_disk : mapping of int to int, optional
        xxh3 by segment id of what the disk cache holds of this scene.
    server : str, optional
        Server URL, which relative addresses of packs begin at; None never pulls.
    """

    def __init__(
        self,
        options: SessionOptions,
        cache: SegmentCache,
        on_disk: dict[int, int] | None = None,
        server: str | None = None,
    ) -> None:
        self.options = options
        self._server = server
        self._pulls = options.pull and server is not None
        """Whether to ask for payload by ranges."""
        self.version: str | None = None
        """Scene version of the newest connection."""
        self.holdings = Holdings(cache, on_disk)
        """What is held here, in memory and on disk."""
        self._events: deque[Event] = deque()
        self._outbox: deque[Message] = deque()
        self._unsent: LandingState | None = None
        """The landing whose ``land`` is in the outbox."""
        self._leaving: list[int] = []
        """Those whose ``land`` was given out to be sent."""
        self._transfers = Transfers(
            self.holdings, say=self._outbox.append, report=self._events.append
        )
        self._open = self._greeting = False
        self._generation = self._landings = self._requests = 0
        self._queued: LandingState | None = None
        self._aim = AimState()
        self._offer = HeldOffer()
        self.group = GroupState(
            say=self._outbox.append,
            report=self._events.append,
            is_open=lambda: self._open,
            take_request=self._take_request,
        )
        """The seat in a group; to be given commands by the shell."""
        self._picks = PickState(self._events.append)
        self._credit_step = 1
        self._max_radius_m = math.inf
        """Of the newest connection."""
        self._taken_bytes = 0

    @property
    def open(self) -> bool:
        """Whether the server has said welcome on the present connection."""
        return self._open

    @property
    def has_aim(self) -> bool:
        """Whether an aim waits for :meth:`flush_aim`."""
        return self._aim.waits and self._open

    @property
    def visible(self) -> tuple[int, ...]:
        """Ids that the last ready landing shows, ascending."""
        return self._transfers.visible

    @property
    def repeated_bytes(self) -> int:
        """Payload bytes received of segments in memory already; 0 with a right server."""
        return self._transfers.repeated_bytes

    @property
    def aims(self) -> AimCounts:
        """What aims have brought, and what of it was used."""
        return self._transfers.aims

    @property
    def unfinished(self) -> int | None:
        """Number of the newest landing that is not ready; None when there is none."""
        landing = self._queued or self._transfers.unfinished
        return None if landing is None else landing.number

    # ---- output

    def events(self) -> list[Event]:
        """Return, once, what has happened since the last call."""
        events = list(self._events)
        self._events.clear()
        return events

    def data_to_send(self) -> list[bytes]:
        """Return, once, the WebSocket messages to send, in order."""
        data = [encode(message) for message in self._outbox]
        self._outbox.clear()
        if self._unsent is not None:
            self._leaving.append(self._unsent.number)
            self._unsent = None
        return data

    def sent(self) -> bool:
        """Note that what :meth:`data_to_send` gave is on its way; whether that is an event."""
        self._events.extend(LandingSent(number) for number in self._leaving)
        has_events = bool(self._leaving)
        self._leaving.clear()
        return has_events

    # ---- connection

    def connected(self, *, offer_held: bool = True) -> None:
        """Open a connection: the first message is ``hello`` with what is held.

        Parameters
        ----------
        offer_held : bool
            False after a server found the offer too large: it is made after its welcome, which
            says how large it may be.
        """
        self._outbox.clear()
        self._open = False
        self._greeting = True
        held_rows = self._offer.first(self.holdings.offer(), in_hello=offer_held)
        self._outbox.append(self.options.hello(held_rows, pull=self._pulls))

    def connection_lost(self) -> None:
        """Note that the connection is gone.

        The newest landing that is not ready waits for the next connection, and so do the newest aim
        after it, picks and the seat in a group. Parts of segments are forgotten (10.2).
        """
        self._open = self._greeting = False
        self._outbox.clear()
        self._unsent = None
        self._leaving.clear()
        self._taken_bytes = 0  # credit belongs to the connection (8)
        self._aim.connection_lost(self._transfers.aim_done)
        self._queue(self._transfers.connection_lost())
        self.group.connection_lost()

    def receive(self, data: bytes | str) -> None:
        """Take one whole WebSocket message.

        Raises
        ------
        ProtocolViolationError
            The server sent what the protocol does not allow; the connection must be closed with
            4400.
        """
        try:
            if is_payload(data):
                assert not isinstance(data, str)
                frame = decode_frame(data)
                if isinstance(frame, PayloadFrame):
                    self._transfers.on_frame(frame)
                    self._grant(len(frame.chunk))
                return
            message = decode(data, Direction.SERVER_TO_CLIENT)
        except DecodeError as error:
            raise ProtocolViolationError(str(error)) from error
        if not isinstance(message, Unknown):
            self._on_message(message)

    # ---- commands

    def land(
        self,
        position: Sequence[float],
        radius_m: float,
        *,
        inner_radius_m: float | None = None,
        deadline_ms: int | None = None,
        stall_ms: int | None = None,
        coarse_radius_m: float | None = None,
    ) -> int:
        """Ask for a landing; it supersedes every one before that is not ready.

        Returns
        -------
        int
            Its number in the events. It stays the same when a reconnect asks again under a new
            generation.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        landing = LandingState(
            self._landings + 1,
            point(position),
            radius_m,
            inner_radius_m,
            deadline_ms,
            stall_ms,
            coarse_radius_m,
        )
        checked(lambda: landing.message(0))
        self._landings += 1
        self._aim.clear()
        if self._open:
            self._send_landing(landing)
        else:
            self._queue(landing)
        return landing.number

    def aim(
        self, position: Sequence[float], radius_m: float, coarse_radius_m: float | None = None
    ) -> None:
        """Note where the user points; only the newest is kept until :meth:`flush_aim`.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        self._aim.note(position, radius_m, coarse_radius_m)

    def flush_aim(self) -> None:
        """Send the newest aim, if there is one and the connection is open."""
        if self.has_aim:
            self._transfers.tell_fetched()
            self._send_evictions()
            self._generation += 1
            self._outbox.append(self._aim.take(self._generation, self._max_radius_m))

    def pick(self, origin: Sequence[float], direction: Sequence[float] | None = None) -> int:
        """Ask what lies along a ray; return the request's number in the events.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        pick = self._picks.ask(self._requests + 1, origin, direction)
        if self._open:
            self._outbox.append(pick)
        return self._take_request()

    def drop_pick(self, request: int) -> None:
        """Forget a pick: its answer is skipped, a reconnect does not ask again."""
        self._picks.drop(request)

    def bye(self) -> None:
        """Say ``bye``, where there is a connection: the server then closes at once (5.6)."""
        if self._open:
            self._outbox.append(Bye())

    # ---- news from the disk cache

    def stored_on_disk(self, facts: SegmentFacts) -> None:
        """Note that the disk holds a segment: its payload may leave memory unreported."""
        self.holdings.add_disk(facts.segment, facts.xxh3)

    def removed_from_disk(self, segments: Iterable[int]) -> None:
        """Note that the disk no longer holds these."""
        for segment in segments:
            self.holdings.drop_disk(segment)

    def restored(self, entry: CachedSegment) -> None:
        """Take a segment that ``RestoreNeeded`` asked for, verified by the caller."""
        self._transfers.restored(entry)

    def lost(self, segment: int) -> None:
        """Note that the disk cannot give a segment that it was asked for."""
        self._transfers.lost(segment)

    # ---- payload that is fetched

    def fetched(self, segment: int, payload: bytes) -> None:
        """Take a payload that ``FetchNeeded`` asked for; its hash is compared here."""
        self._transfers.on_fetched(segment, payload)

    def tell_fetched(self) -> None:
        """Tell the server what was fetched since it was last told."""
        if self._open:
            self._transfers.tell_fetched()

    def stop_pulling(self) -> None:
        """Ask for payload in frames, from the next connection on: the pack is out of reach."""
        self._pulls = False

    # ---- messages

    def _on_message(self, message: Message) -> None:
        transfers = self._transfers
        if isinstance(message, Welcome):
            self._on_welcome(message)
        elif isinstance(message, Error):
            self._on_error(message)
        elif not self._open:
            raise ProtocolViolationError(f"got {message.TYPE} first, expected welcome or error")
        elif isinstance(message, Plan):
            transfers.on_plan(message)
        elif isinstance(message, Ready):
            transfers.on_ready(message)
        elif isinstance(message, Degraded):
            transfers.on_degraded(message)
        elif isinstance(message, SupersededMessage):
            transfers.on_superseded(message)
        elif isinstance(message, Prefetch):
            transfers.on_prefetch(message)
        elif isinstance(message, Picked):
            self._picks.answered(message)
        elif isinstance(message, Notice):
            noticed = Noticed(message.kind, message.version, message.reconnect_after_ms)
            self._events.append(noticed)
        elif isinstance(message, HeldChecked):
            self._on_dropped(message.dropped.tolist())
        else:
            self.group.receive(message)

    def _on_welcome(self, welcome: Welcome) -> None:
        if self._open or not self._greeting:
            raise ProtocolViolationError("got a second welcome, expected one")
        if welcome.protocol[0] != PROTOCOL[0]:
            raise ProtocolViolationError(
                f"got protocol {welcome.protocol[0]}.{welcome.protocol[1]}, "
                f"expected {PROTOCOL[0]}.x"
            )
        self._open, self._greeting = True, False
        changed = self.version is not None and self.version != welcome.scene.version
        self.version = welcome.scene.version
        if changed:  # visible ids meant segments of the version before (5.4)
            self._transfers.hide_all()
        credit = min(self.options.credit_bytes, welcome.limits.max_credit_bytes)
        self._transfers.pull = self._address_of(welcome.pull)
        # Granted in halves: the server never runs dry while a grant is on its way (8).
        self._credit_step = max(1, credit // 2)
        self._max_radius_m = welcome.limits.max_radius_m
        self._events.append(
            Opened(welcome.scene, welcome.limits, welcome.session, welcome.held_count, changed)
        )
        # In this order (5.3): what is held is offered whole before the landing, whose plan counts
        # on it; what a connection left unanswered is asked again.
        self._on_dropped(welcome.dropped.tolist())
        messages, untold = self._offer.rest(welcome)
        self._outbox.extend(messages)
        # A server that takes no table cannot be told: what it does not know of is not held (10.2).
        # Its files stay for other runs.
        self.holdings.forget(untold)
        if untold:
            self._events.append(Dropped(tuple(untold), ()))
        self._outbox.extend(self._picks.waiting())
        self.group.connected(welcome.limits.groups)
        if self._queued is not None:
            landing, self._queued = self._queued, None
            self._send_landing(landing)

    def _on_dropped(self, segments: Sequence[int]) -> None:
        """Free what the server does not count as held."""
        dropped = tuple(segments)
        if dropped:
            on_disk = self.holdings.disk_hashes(dropped)
            self.holdings.forget(dropped)
            self._events.append(Dropped(dropped, on_disk))

    def _on_error(self, error: Error) -> None:
        # A request's own answer: nothing else was refused, unless the connection ends with it.
        is_answer = self._picks.refused(error) or self.group.refused(error)
        if is_answer and not error.fatal:
            return
        self._aim.refused(error.generation)
        refused = None if error.fatal else self._transfers.refused(error.generation)
        number = None if refused is None else refused.number
        self._events.append(Refused(error.code, error.message, error.fatal, number))

    # ---- state

    def _address_of(self, pull: PullInfo | None) -> PackAddress | None:
        """Return where the pack is, as welcome says (17); None where payload comes in frames."""
        if pull is None or not self._pulls:
            return None
        if not _PACK_PATH.fullmatch(pull.pack):
            raise ProtocolViolationError(f"got the pack {pull.pack[:64]!r}, expected FOLDER/NAME")
        if pull.base.startswith(("http://", "https://")):
            return PackAddress(pull.base + pull.pack, pull.pack_bytes, is_ours=False)
        if pull.base.startswith("/") or ":" in pull.base or ".." in pull.base:
            raise ProtocolViolationError(
                f"got the base address {pull.base[:64]!r}, expected http(s) or a relative path"
            )
        return PackAddress(f"{self._server}/{pull.base}{pull.pack}", pull.pack_bytes, is_ours=True)

    def _take_request(self) -> int:
        self._requests += 1
        return self._requests

    def _queue(self, landing: LandingState | None) -> None:
        """Keep the newest landing for the next connection; what waited before is superseded."""
        if landing is None:
            return
        if self._queued is not None:
            self._events.append(Superseded(self._queued.number, landing.number))
        self._queued = landing

    def _send_landing(self, landing: LandingState) -> None:
        self._withdraw_unsent(landing)
        self._transfers.tell_fetched()
        # Evictions go first: the plan must not keep what is gone here (6.7).
        self._send_evictions()
        self._generation += 1
        landing.generation = self._generation
        self._transfers.ask(landing)
        self._outbox.append(landing.message(self._generation, self._max_radius_m))
        self._unsent = landing

    def _withdraw_unsent(self, newer: LandingState) -> None:
        """Replace one that never left: however often the user lands, one ``land`` waits."""
        if self._unsent is None:
            return
        for message in [waiting for waiting in self._outbox if isinstance(waiting, Land)]:
            self._outbox.remove(message)
        if self._transfers.withdraw(self._unsent):
            self._events.append(Superseded(self._unsent.number, newer.number))

    def _send_evictions(self) -> None:
        # What may not be told now (6.7, rule 2) is told before the next land or aim.
        if not self._transfers.awaits_plan:
            self._outbox.extend(self.holdings.evictions(self._transfers.open_plan))

    def _grant(self, taken_bytes: int) -> None:
        self._taken_bytes += taken_bytes
        if self._taken_bytes < self._credit_step:
            return
        granted, self._taken_bytes = self._taken_bytes, 0
        # One that was not sent yet grows: what waits must not grow with what comes.
        for at, message in enumerate(self._outbox):
            if isinstance(message, Credit):
                self._outbox[at] = Credit(bytes=message.bytes + granted)
                return
        self._outbox.append(Credit(bytes=granted))
