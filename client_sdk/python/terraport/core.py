"""Session state of a protocol 2 client: messages in; events and messages to send out.

The shell (:mod:`terraport.session`) owns sockets, tasks, files and clocks. It passes in commands
and received messages, and after each call drains :meth:`SessionCore.events` and
:meth:`SessionCore.data_to_send`.

The server keeps no table of what the client holds: every ``land`` lists it. Segments that a
landing listed or received stay in memory until the landing is shown. Section numbers are those of
``spec/protocol.md``.

PURE: no I/O, no clock, no task.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np

import terraport_wire as wire
from terraport import events as core_events
from terraport.cache import Box, CachedSegment, SegmentCache
from terraport.errors import ProtocolViolationError
from terraport.options import SessionOptions, checked, point
from terraport.seat import Seat
from terraport_payload import PayloadError, box_distances_m, segment_bounds
from terraport_payload.types import AnyArray

__all__ = ["SessionCore"]

_NONE: Final = np.zeros(0, wire.KEY_DTYPE)
_MOST_FAILURES: Final = 2
"""Maximum deliveries of a damaged segment before its key is left out (4, rule 8)."""

Point = tuple[float, float, float]


@dataclass(slots=True)
class _Landing:
    """One landing that the caller asked for; it may be sent several times, as generations."""

    number: int
    """The session's own number, the same over generations."""
    wanted: wire.Land
    """The request, with generation 0 and an empty ``have``."""
    is_urgent: bool = False
    """Whether the inner set is enough: the deadline has passed."""
    sent: wire.Land | None = None
    """The message that was sent last; None while it waits to be sent."""
    plan: wire.Plan | None = None
    ready: wire.Ready | None = None
    hidden: bytes = b""
    """Base faces that are hidden when it is shown: one bit each, the lowest bit first."""
    waiting: set[int] = field(default_factory=set)
    """Keys of the plan that are neither in memory nor missing."""
    restoring: set[int] = field(default_factory=set)
    """Keys in `waiting` that are being read from disk."""
    protected: set[int] = field(default_factory=set)
    """Until the plan arrives: keys that ``have`` listed, and those that arrived since."""
    streamed: set[int] = field(default_factory=set)
    """Keys that the server sent since the landing was requested."""
    failures: Counter[int] = field(default_factory=Counter)
    """Number of failed deliveries by key."""
    given_up: dict[int, int] = field(default_factory=dict)
    """Segment id by key of segments that failed too often; left out of later requests."""
    has_begun: bool = False

    @property
    def needs(self) -> Collection[int]:
        """Keys that must not leave memory before it is shown."""
        return self.protected if self.plan is None else self.plan.show["key"].tolist()

    def shown_rows(self, count: int | None = None) -> AnyArray:
        """Return the first rows of the plan that are not missing."""
        assert self.plan is not None
        rows = self.plan.show[:count]
        if self.ready is not None and self.ready.missing is not None:
            rows = rows[~np.isin(rows["key"], self.ready.missing)]
        return rows


class SessionCore:
    """State of one session. It outlives connections. Not thread-safe.

    Parameters
    ----------
    options : SessionOptions
        Options of the session, among them the budgets in ``hello``.
    cache : SegmentCache
        Payloads in memory; from now on owned by the session.
    on_disk : mapping of int to Box, optional
        What the disk cache holds, by key.
    """

    def __init__(
        self,
        options: SessionOptions,
        cache: SegmentCache,
        on_disk: Mapping[int, Box] | None = None,
    ) -> None:
        self.options = options
        self.version: str | None = None
        """Scene version of the newest connection."""
        self.is_open = False
        """Whether the server has said welcome on the present connection."""
        self.shown = core_events.Shown(0, (), (), b"")
        """What is visible."""
        self.repeated_bytes = 0
        """Payload bytes of whole segments that were in memory already; 0 with a right server."""
        self.prefetched_bytes = 0
        """Payload bytes of segments that came while no landing waited for them."""
        self.shown_keys: frozenset[int] = frozenset()
        """Keys of what is visible."""
        self._cache = cache
        self._disk: dict[int, Box] = dict(on_disk or {})
        self._events: list[core_events.Event] = []
        self._outbox: list[wire.Message] = []
        self._departing: int | None = None
        """The landing whose ``land`` was given out to be sent."""
        self._greeting = False
        self._generation = self._landings = self._requests = 0
        self._open: list[_Landing] = []
        """Landings that are neither shown nor over, oldest first. The last one alone may be shown;
        the others go on if the server refuses it."""
        self._aim: wire.Prefetch | None = None
        self._picks: dict[int, wire.Pick] = {}
        self._part: tuple[int, int, bytearray] | None = None
        """Key, total and what has come of the segment that is under way."""
        self._taken_bytes = self._granted_bytes = self._acknowledged_bytes = 0
        self._credit_step = 1
        self._max_radius_m = math.inf
        self._base_faces = self._segment_count = 0
        self.seat = Seat(
            say=self._outbox.append,
            report=self._events.append,
            is_open=lambda: self.is_open,
            take_request=self._take_request,
        )
        """The seat in a group; the shell gives it commands."""

    @property
    def has_aim(self) -> bool:
        """Whether an aim waits for :meth:`flush_aim`."""
        return self._aim is not None and self.is_open

    @property
    def cache_bytes(self) -> int:
        """Payload bytes in memory."""
        return self._cache.bytes

    @property
    def needed(self) -> frozenset[int]:
        """Keys that must not leave memory or disk now: what is shown, and what open landings need.

        From ``land`` to the swap nothing that the server counts on may go (4, rule 4).
        """
        return self.shown_keys.union(*(landing.needs for landing in self._open))

    def peek(self, key: int) -> CachedSegment | None:
        """Return what memory has of a key."""
        return self._cache.peek(key)

    def is_on_disk(self, key: int) -> bool:
        """Whether the disk cache has a key."""
        return key in self._disk

    # ---- output

    def events(self) -> list[core_events.Event]:
        """Return, once, what has happened since the last call."""
        events = self._events[:]
        self._events.clear()
        return events

    def data_to_send(self) -> list[bytes]:
        """Return, once, the WebSocket messages to send, in order.

        The ``land`` message is built here, from what is held now: however often the user lands
        before the shell can send, only one ``land`` is sent.
        """
        messages = self._outbox[:]
        self._outbox.clear()
        landing = self._open[-1] if self._open else None
        is_leaving = any(isinstance(message, wire.Bye) for message in messages)
        if landing is not None and landing.sent is None and self.is_open and not is_leaving:
            messages.append(self._land_message(landing))
            self._departing = landing.number
        return [wire.encode(message) for message in messages]

    def sent(self) -> bool:
        """Record that :meth:`data_to_send` was carried out; return whether that is an event."""
        if self._departing is None:
            return False
        self._events.append(core_events.LandingSent(self._departing))
        self._departing = None
        return True

    # ---- connection

    def connected(self) -> None:
        """Open a connection: the first message is ``hello``."""
        self._outbox.clear()
        self.is_open, self._greeting = False, True
        self._generation = self._taken_bytes = self._acknowledged_bytes = 0
        self._granted_bytes = self.options.credit_bytes
        self._outbox.append(self.options.hello())

    def connection_lost(self) -> None:
        """Record that the connection was lost; a partly received segment is discarded.

        The newest open landing, picks and the seat in a group wait for the next connection.
        """
        self.is_open = self._greeting = False
        self._outbox.clear()
        self._departing = self._part = None
        self._end_before_newest()
        for landing in self._open:
            self._ask_again(landing)
        self.seat.connection_lost()

    def receive(self, data: bytes | str) -> None:
        """Take one whole WebSocket message.

        Raises
        ------
        ProtocolViolationError
            The server sent what the protocol does not allow; the connection must be closed with
            4400.
        """
        try:
            if wire.is_payload(data):
                assert not isinstance(data, str)
                frame = wire.decode_frame(data)
                if frame is not None:
                    self._on_frame(frame)
                return
            message = wire.decode(data, wire.Direction.SERVER_TO_CLIENT)
        except wire.DecodeError as error:
            raise ProtocolViolationError(str(error)) from error
        if not isinstance(message, wire.Unknown):
            self._on_message(message)

    # ---- commands

    def land(
        self,
        position: Sequence[float],
        radius_m: float,
        *,
        inner_radius_m: float | None = None,
        coarse_radius_m: float | None = None,
    ) -> int:
        """Request a landing; it replaces all earlier ones that are not shown yet.

        Returns
        -------
        int
            Its number in the events, the same over generations.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        wanted = checked(
            lambda: wire.Land(
                generation=0,
                position=point(position),
                radius_m=radius_m,
                inner_radius_m=inner_radius_m,
                coarse_radius_m=coarse_radius_m,
                have=_NONE,
                taken_bytes=0,
            )
        )
        self._landings += 1
        landing = _Landing(self._landings, wanted)
        self._aim = None
        if self._open and self._open[-1].sent is None:
            self._events.append(core_events.Superseded(self._open.pop().number, landing.number))
        self._open.append(landing)
        return landing.number

    def hurry(self, landing: int) -> None:
        """Accept the inner set of a landing from now on."""
        for one in self._open:
            if one.number == landing:
                one.is_urgent = True
        self._update()

    def aim(
        self, position: Sequence[float], radius_m: float, coarse_radius_m: float | None = None
    ) -> None:
        """Note where the user points; only the newest is kept until :meth:`flush_aim`.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        self._aim = checked(
            lambda: wire.Prefetch(
                generation=0,
                position=point(position),
                radius_m=radius_m,
                coarse_radius_m=coarse_radius_m,
                have=_NONE,
                taken_bytes=0,
            )
        )

    def flush_aim(self) -> None:
        """Send the newest aim, if there is one and the connection is open."""
        if self._aim is not None and self.is_open:
            aim, self._aim = self._aim, None
            self._generation += 1
            self._outbox.append(wire.Prefetch(**_fields(aim) | self._held_near(aim)))

    def pick(self, origin: Sequence[float], direction: Sequence[float] | None = None) -> int:
        """Pick along a ray; return the request's number in the events.

        Raises
        ------
        UsageError
            A number that the protocol does not allow; nothing has changed.
        """
        start, along = point(origin), None if direction is None else point(direction)
        pick = checked(lambda: wire.Pick(request=self._requests + 1, origin=start, direction=along))
        request = self._take_request()
        self._picks[request] = pick
        if self.is_open:
            self._outbox.append(pick)
        return request

    def drop_pick(self, request: int) -> None:
        """Forget a pick: its answer is skipped, a reconnect does not ask again."""
        self._picks.pop(request, None)

    def bye(self) -> None:
        """Send ``bye`` if the connection is open; the server then closes it."""
        if self.is_open:
            self._outbox.append(wire.Bye())

    # ---- disk cache

    def disk_changed(self, stored: CachedSegment | None, removed: Iterable[int]) -> None:
        """Record a segment written to disk, and those deleted to make room."""
        if stored is not None:
            self._disk[stored.key] = stored.box
        for key in removed:
            self._disk.pop(key, None)

    def restored(self, key: int, payload: bytes) -> None:
        """Take the bytes of a segment that :class:`RestoreNeeded` asked for."""
        entry = _checked_entry(key, payload)
        if entry is None:
            self.lost(key)
            return
        self._cache.put(entry)
        self._arrived(entry, restored=True)

    def lost(self, key: int) -> None:
        """Record that a segment cannot be read from disk; the landing is sent again."""
        self._disk.pop(key, None)
        number = None
        for landing in self._open:
            if key in landing.restoring:
                landing.restoring.discard(key)
                number = landing.number
        self._events.append(core_events.SegmentRejected(number, key, on_disk=True))
        self._update()

    # ---- messages

    def _on_message(self, message: wire.Message) -> None:
        if isinstance(message, wire.Welcome):
            self._on_welcome(message)
        elif isinstance(message, wire.Error):
            self._on_error(message)
        elif not self.is_open:
            raise ProtocolViolationError(f"got {message.TYPE} first, expected welcome or error")
        elif isinstance(message, wire.Plan):
            self._on_plan(message)
        elif isinstance(message, wire.Ready):
            landing = self._landing_of(message)
            if landing is not None and landing.plan is not None:
                landing.ready = message
                if message.missing is not None:
                    landing.waiting.difference_update(message.missing.tolist())
                    landing.hidden = self._bits(message.hidden)
                self._update()
        elif isinstance(message, wire.Picked):
            if self._picks.pop(message.request, None) is not None:
                self._events.append(core_events.PickAnswered(message.request, message.hit))
        elif isinstance(message, wire.Notice):
            self._events.append(message)
        else:
            self.seat.receive(message)

    def _on_welcome(self, welcome: wire.Welcome) -> None:
        if self.is_open or not self._greeting:
            raise ProtocolViolationError("got a second welcome, expected one")
        self.is_open, self._greeting = True, False
        changed = self.version is not None and self.version != welcome.scene.version
        self.version = welcome.scene.version
        if changed:  # segments of the previous version do not belong to this scene
            self.shown, self.shown_keys = core_events.Shown(0, (), (), b""), frozenset()
        # Granted in halves: the server never runs dry while a grant is on its way (6).
        credit = min(self.options.credit_bytes, welcome.limits.max_credit_bytes)
        self._credit_step = max(1, credit // 2)
        self._base_faces = welcome.scene.base_faces
        self._segment_count = welcome.scene.segment_count
        self._max_radius_m = welcome.limits.max_radius_m
        self._events.append(
            core_events.Opened(welcome.scene, welcome.limits, welcome.session, changed)
        )
        self._outbox.extend(self._picks.values())
        self.seat.connected(welcome.limits.groups)

    def _on_error(self, error: wire.Error) -> None:
        # A request's own answer: nothing else was refused, unless the connection ends with it.
        is_answer = self.seat.refused(error)
        if error.request is not None and self._picks.pop(error.request, None) is not None:
            self._events.append(core_events.PickRefused(error.request, error.code, error.message))
            is_answer = True
        if is_answer and not error.fatal:
            return
        number = None
        for landing in [] if error.fatal else self._open:
            if landing.sent is not None and landing.sent.generation == error.generation:
                number = landing.number
                self._open.remove(landing)
                break
        self._events.append(core_events.Refused(error.code, error.message, error.fatal, number))
        self._update()  # an older landing continues (4, rule 7)

    def _on_plan(self, plan: wire.Plan) -> None:
        landing = self._landing_of(plan)
        if landing is None:
            return
        assert landing.sent is not None
        coarser = (plan.show["flags"] & wire.COARSER) > 0
        if coarser.any():
            show = plan.show.copy()
            show["id"][coarser] += self._segment_count  # one id a payload, as users have it
            plan = replace(plan, show=show)
        while self._open[0] is not landing:
            self._events.append(core_events.Superseded(self._open.pop(0).number, landing.number))
        landing.plan, landing.ready, landing.hidden = plan, None, self._bits(plan.hidden)
        here, restore = [], []
        landing.waiting = set()
        for key in plan.show["key"].tolist():
            entry = self._cache.get(key)
            if entry is not None:
                here.append(entry)
            else:
                landing.waiting.add(key)
                if key in self._disk:
                    restore.append(key)
        landing.restoring = set(restore)
        came = frozenset(entry.key for entry in here if entry.key in landing.streamed)
        self._events.append(
            core_events.Planned(landing.number, landing.sent, plan, tuple(here), came)
        )
        if restore:
            self._events.append(core_events.RestoreNeeded(tuple(restore)))
        self._trim()
        self._update()

    def _landing_of(self, message: wire.Plan | wire.Ready) -> _Landing | None:
        """Return the landing that a message is about; None for one that is over."""
        if message.generation > self._generation:
            raise ProtocolViolationError(
                f"got {message.TYPE} of generation {message.generation}, "
                f"expected at most {self._generation}"
            )
        for landing in self._open:
            if landing.sent is not None and landing.sent.generation == message.generation:
                return landing
        return None

    # ---- payload

    def _on_frame(self, frame: wire.Frame) -> None:
        if not self.is_open:
            raise ProtocolViolationError("got payload first, expected welcome or error")
        self._take_credit(len(frame.data))
        landing = self._open[-1] if self._open else None
        if landing is not None and landing.plan is not None and not landing.has_begun:
            landing.has_begun = True
            self._events.append(core_events.PayloadBegan(landing.number))
        if frame.offset == 0:
            self._part = (frame.key, frame.total, bytearray())
        part = self._part
        if part is None or (frame.key, frame.total, frame.offset) != (*part[:2], len(part[2])):
            of = "no segment" if part is None else f"byte {len(part[2])} of {part[0]:016x}"
            raise ProtocolViolationError(
                f"got byte {frame.offset} of {frame.key:016x} ({frame.total} bytes), expected {of}"
            )
        part[2].extend(frame.data)
        if len(part[2]) < frame.total:
            return
        self._part = None
        entry = _checked_entry(frame.key, bytes(part[2]))
        if entry is None:  # asked for again when everything else has come
            number = landing.number if landing and frame.key in landing.waiting else None
            self._events.append(core_events.SegmentRejected(number, frame.key))
            return
        if frame.key in self._cache:
            self.repeated_bytes += frame.total
        self._cache.put(entry)
        self._arrived(entry, restored=False)

    def _arrived(self, entry: CachedSegment, *, restored: bool) -> None:
        """Record a segment that is now in memory with the landings that wait for it."""
        number = None
        for landing in self._open:
            if not restored:
                landing.streamed.add(entry.key)
            if landing.plan is None:
                landing.protected.add(entry.key)
            elif entry.key in landing.waiting:
                landing.waiting.discard(entry.key)
                landing.restoring.discard(entry.key)
                number = landing.number
        if not (restored or self._open):
            self.prefetched_bytes += len(entry.payload)
        self._events.append(core_events.SegmentArrived(number, entry, restored))
        self._trim()
        self._update()

    def _take_credit(self, taken_bytes: int) -> None:
        self._taken_bytes += taken_bytes
        if self._taken_bytes > self._granted_bytes:
            raise ProtocolViolationError(
                f"got {self._taken_bytes} bytes of payload, expected at most {self._granted_bytes}"
            )
        granted = self._taken_bytes - self._acknowledged_bytes
        if granted < self._credit_step:
            return
        self._acknowledged_bytes = self._taken_bytes
        self._granted_bytes += granted
        # A grant that waits to be sent is enlarged, so that the outbox stays bounded.
        for at, message in enumerate(self._outbox):
            if isinstance(message, wire.Credit):
                self._outbox[at] = wire.Credit(bytes=message.bytes + granted)
                return
        self._outbox.append(wire.Credit(bytes=granted))

    # ---- landings

    def _update(self) -> None:
        """Show the newest landing if it is complete; request missing segments again."""
        landing = self._open[-1] if self._open else None
        if landing is None or landing.plan is None:
            return
        plan, ready = landing.plan, landing.ready
        if not landing.waiting:
            rows = landing.shown_rows()
            missing = {*plan.show["id"].tolist(), *landing.given_up.values()} - {
                *rows["id"].tolist()
            }
            self._open.clear()
            ids, lost_ids = _ids(rows), tuple(sorted(missing))
            self.shown = core_events.Shown(landing.number, ids, lost_ids, landing.hidden)
            self.shown_keys = frozenset(rows["key"].tolist())
            self._events.append(self.shown)
            self._trim()
            return
        lost = landing.waiting - landing.restoring
        if ready is not None and lost and not landing.restoring:
            number = dict(zip(plan.show["key"].tolist(), plan.show["id"].tolist(), strict=True))
            for key in lost:
                landing.failures[key] += 1
                if landing.failures[key] >= _MOST_FAILURES:
                    landing.given_up[key] = number[key]
            if len(landing.given_up) > wire.MAX_WITHOUT:
                self._give_up(landing)
                return
            self._ask_again(landing)
        elif landing.is_urgent and plan.inner_count is not None:
            rows = landing.shown_rows(plan.inner_count)
            if not landing.waiting.intersection(rows["key"].tolist()):
                landing.is_urgent = False
                hidden = self._bits(plan.inner_hidden)
                self._events.append(core_events.InnerWhole(landing.number, _ids(rows), hidden))

    def _give_up(self, landing: _Landing) -> None:
        """End a landing of which more segments are damaged than a message can leave out."""
        self._open.remove(landing)
        text = (
            f"got {len(landing.given_up)} damaged segments, expected at most {wire.MAX_WITHOUT}; "
            "is something between here and the service changing payload?"
        )
        self._events.append(core_events.Refused("damaged", text, False, landing.number))
        self._update()

    def _ask_again(self, landing: _Landing) -> None:
        """Send a landing again; the segments that it has stay in memory."""
        landing.protected = set(landing.needs)
        landing.sent = landing.plan = landing.ready = None
        landing.waiting, landing.restoring = set(), set()

    def _land_message(self, landing: _Landing) -> wire.Land:
        """Return the ``land`` message of a landing, with the keys that are held."""
        self._generation += 1
        held = self._held_near(landing.wanted)
        landing.protected = set(held["have"].tolist())
        if landing.given_up:
            held["without"] = np.array(sorted(landing.given_up), wire.KEY_DTYPE)
        landing.sent = wire.Land(**_fields(landing.wanted) | held)
        return landing.sent

    def _held_near(self, place: wire.Land | wire.Prefetch) -> dict[str, Any]:
        """Return the fields of a request that depend on the cache and the connection."""
        ring_m = place.coarse_radius_m
        if ring_m is not None:  # less coarse ground is better than no landing
            ring_m = max(place.radius_m, min(ring_m, self._max_radius_m))
        boxes: dict[int, Box] = dict(self._disk)
        for key in self._cache:
            entry = self._cache.peek(key)
            assert entry is not None
            boxes[key] = entry.box
        have = _NONE
        if boxes:
            keys = np.fromiter(boxes, wire.KEY_DTYPE, len(boxes))
            bounds = np.array(list(boxes.values()))
            distances = box_distances_m(bounds, place.position)
            # The server goes by the box of the finer level: a coarser one differs by a little.
            reach = (ring_m or place.radius_m) + np.linalg.norm(
                bounds[:, 3:] - bounds[:, :3], axis=1
            )
            near = np.flatnonzero(distances <= reach)
            have = keys[near[np.argsort(distances[near], kind="stable")][: wire.MAX_HAVE]]
        return {
            "generation": self._generation,
            "coarse_radius_m": ring_m,
            "have": have,
            "taken_bytes": self._taken_bytes,
        }

    def _end_before_newest(self) -> None:
        for landing in self._open[:-1]:
            self._events.append(core_events.Superseded(landing.number, self._open[-1].number))
        del self._open[:-1]

    def _trim(self) -> None:
        if self._cache.is_full:
            self._cache.trim(self.needed)

    def _bits(self, packed: bytes | None) -> bytes:
        """Inflate hidden faces, to as many as the base mesh has."""
        size, decoder = (self._base_faces + 7) // 8, zlib.decompressobj(wbits=31)
        try:
            bits = decoder.decompress(packed or b"", size + 1)
        except zlib.error as error:
            raise ProtocolViolationError(f"hidden faces: {error}") from error
        if len(bits) != size or not decoder.eof:
            raise ProtocolViolationError(f"got {len(bits)} bytes of hidden faces, expected {size}")
        return bits

    def _take_request(self) -> int:
        self._requests += 1
        return self._requests


def _fields(message: wire.Land | wire.Prefetch) -> dict[str, Any]:
    return {each.name: getattr(message, each.name) for each in fields(message)}


def _ids(rows: AnyArray) -> tuple[int, ...]:
    return tuple(sorted(rows["id"].tolist()))


def _checked_entry(key: int, payload: bytes) -> CachedSegment | None:
    """Return a payload with its box; None where it is damaged."""
    try:
        box = segment_bounds(payload).tolist()
    except PayloadError:
        return None
    return CachedSegment(key, tuple(box), payload)
