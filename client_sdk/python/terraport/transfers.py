"""Landings and prefetches on their way: plans and frames in, events and answers out.

The part of :class:`terraport.session.ClientSession` that decides what is received, held, pinned and
shown. Section numbers in comments are those of ``spec/wire-protocol.md``.

PURE: no I/O, no clock, no task.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection

import numpy as np
import xxhash

from terraport.aim_counts import AimCounts
from terraport.assembly import Assembler
from terraport.cache import CachedSegment, SegmentFacts
from terraport.errors import ProtocolViolationError
from terraport.events import (
    Degraded,
    Event,
    FetchNeeded,
    FetchStopped,
    PayloadBegan,
    Planned,
    Prefetched,
    Ready,
    RestoreNeeded,
    SegmentArrived,
    SegmentRejected,
    Superseded,
)
from terraport.holdings import Holdings
from terraport.landing_state import LandingState, PrefetchState
from terraport.payloads import facts_of_payload
from terraport.pull_ranges import Fetch, PackAddress
from terraport_payload.types import AnyArray
from terraport_wire import (
    BLOCK_BYTES,
    HELD_DTYPE,
    MAX_HELD_SEGMENTS,
    Held,
    Message,
    PayloadFrame,
    Plan,
    Prefetch,
    Reject,
)
from terraport_wire import Degraded as DegradedMessage
from terraport_wire import Ready as ReadyMessage
from terraport_wire import Superseded as SupersededMessage

__all__ = ["Transfers"]


class Transfers:
    """What is on its way on one session, over all its connections. Not thread-safe.

    Parameters
    ----------
    held : Holdings
        What is held; kept up to date here.
    say : callable
        Takes the messages to send, in order.
    report : callable
        Takes the events, in order.
    """

    def __init__(
        self,
        held: Holdings,
        *,
        say: Callable[[Message], None],
        report: Callable[[Event], None],
    ) -> None:
        self.held = held
        self.visible: tuple[int, ...] = ()
        """Ids that the last ready landing shows, ascending."""
        self.repeated_bytes = 0
        """Payload bytes received of segments that were in memory already."""
        self.aims = AimCounts()
        """What aims have brought."""
        self.aim_done = -1
        """Generation of the newest aim of which everything has come."""
        self._say = say
        self._report = report
        self._asked: deque[LandingState] = deque()
        self._current: LandingState | None = None
        self._inner: tuple[int, ...] = ()
        """Shown perhaps, since a deadline passed: the newest declared inner set."""
        self._nearby: tuple[int, ...] = ()
        self._prefetch: PrefetchState | None = None
        self._parts = Assembler()
        self._retried: set[int] = set()
        self.pull: PackAddress | None = None
        """Where payload is fetched on the present connection; None where it comes in frames."""
        self._untold: dict[int, int] = {}
        """xxh3 by id of what was fetched and the server does not know to be held."""

    @property
    def unfinished(self) -> LandingState | None:
        """The newest landing that is not ready."""
        if self._asked:
            return self._asked[-1]
        return self._current if self._current is not None and not self._current.done else None

    @property
    def awaits_plan(self) -> bool:
        """Whether a ``land`` has no plan yet: then nothing may be evicted (6.7, rule 2)."""
        return bool(self._asked)

    @property
    def open_plan(self) -> Collection[int]:
        """Ids of the plan that is not ready: these must not be evicted (6.7, rule 2)."""
        landing = self._current
        return landing.wanted if landing is not None and not landing.done else ()

    def ask(self, landing: LandingState) -> None:
        """Note that a landing was sent."""
        self._asked.append(landing)

    def withdraw(self, landing: LandingState) -> bool:
        """Forget a landing that was never sent; whether it had not ended before."""
        was_asked = landing in self._asked
        if was_asked:
            self._asked.remove(landing)
        return was_asked

    def refused(self, generation: int | None) -> LandingState | None:
        """Forget a landing that the server refused; an older one goes on (6.5, rule 5)."""
        for landing in self._asked:
            if landing.generation == generation:
                self._asked.remove(landing)
                self._pin_and_trim()
                return landing
        return None

    def connection_lost(self) -> LandingState | None:
        """Forget parts (10.2); return the newest landing that is not ready, to ask again."""
        self._parts.clear()
        self._untold.clear()  # the next hello offers all
        if self.pull is not None:
            self.pull = None
            self._report(FetchStopped())
        self._prefetch, self.aim_done = None, -1
        current, self._current = self._current, None
        waiting = [] if current is None or current.done else [current]
        waiting += self._asked
        self._asked.clear()
        newest = waiting.pop() if waiting else None
        for landing in waiting:
            assert newest is not None
            self._report(Superseded(landing.number, newest.number))
        self._pin()
        return newest

    def hide_all(self) -> None:
        """Show nothing: the served version is another one, so the ids mean other segments (5.4)."""
        self.visible = self._inner = self._nearby = ()
        self._pin_and_trim()

    # ---- messages

    def on_plan(self, plan: Plan) -> None:
        """Take the plan of the oldest landing that has none."""
        if not self._asked or self._asked[0].generation != plan.generation:
            expected = self._asked[0].generation if self._asked else "none"
            raise ProtocolViolationError(
                f"got a plan of generation {plan.generation}, expected {expected}"
            )
        landing = self._asked.popleft()
        if self._current is not None and not self._current.done:
            self._report(Superseded(self._current.number, landing.number))
        self._current, self._prefetch = landing, None
        self._nearby = tuple(plan.nearby.tolist())
        self._retried.clear()
        landing.begin(plan)
        landing.pulled = self.pull is not None
        self._parts.keep_only(landing.facts)
        self.aims.planned(plan.keep.tolist(), loads=len(plan.load) > 0)
        kept: list[CachedSegment] = []
        restore: list[int] = []
        gone: list[int] = []
        for segment in plan.keep.tolist():
            entry = self.held.recall(segment)
            if entry is not None:
                kept.append(entry)
            elif segment in landing.crossed:
                landing.expect_again(segment, *landing.crossed[segment])
            else:
                (restore if self.held.on_disk(segment) else gone).append(segment)
        landing.waiting.update(restore, gone)
        landing.restoring.update(restore)
        self._pin_and_trim()
        self._report(Planned(landing.number, plan, tuple(kept)))
        if restore:
            self._report(RestoreNeeded(landing.number, tuple(restore)))
        for segment in gone:
            self._ask_again(landing, segment, self.held.hash_of(segment))
        self._fetch(plan.load, plan.blocks)
        self._finish_if_complete()

    def on_ready(self, ready: ReadyMessage) -> None:
        """Take one of the (one or more) ``ready`` of the present landing (6.4)."""
        landing = self._current
        if landing is None or landing.generation != ready.generation:
            raise ProtocolViolationError(
                f"got ready of generation {ready.generation}, "
                f"expected {landing.generation if landing else 'none'}"
            )
        landing.ready_seen = True
        landing.missing = {int(segment) for segment in ready.missing}
        landing.timings = ready.timings
        self._finish_if_complete()

    def on_degraded(self, degraded: DegradedMessage) -> None:
        """Pass on the declared inner set, as soon as all of it is here."""
        landing = self._current
        if landing is None or landing.done or landing.generation != degraded.generation:
            return
        landing.inner = tuple(sorted(degraded.segments.tolist()))
        self._degrade_if_whole(landing)

    def on_superseded(self, message: SupersededMessage) -> None:
        """End a landing or a prefetch: no more frames of it come, or never a plan (6.3, 6.5)."""
        landing = self._current
        if self._prefetch is not None and self._prefetch.generation == message.generation:
            self._prefetch = None
        elif landing is not None and landing.generation == message.generation:
            self._current = None
            if not landing.done:
                newer = self._asked[0].number if self._asked else landing.number
                self._report(Superseded(landing.number, newer))
        elif self._asked and self._asked[0].generation == message.generation:
            unplanned = self._asked.popleft()
            newer = self._asked[0].number if self._asked else unplanned.number
            self._report(Superseded(unplanned.number, newer))

    def on_prefetch(self, prefetch: Prefetch) -> None:
        """Begin to take what an aim brings."""
        self._prefetch = PrefetchState.of(prefetch)
        self.aims.prefetching()
        self._retried.clear()
        self._parts.keep_only(self._prefetch.facts)
        self._fetch(prefetch.segments, prefetch.blocks)
        self._end_prefetch_if_done(self._prefetch)

    def on_frame(self, frame: PayloadFrame) -> None:
        """Take one chunk; check the hash when it was the last one (4, rule 4)."""
        landing = self._current
        if landing is not None and landing.generation != frame.generation:
            landing = None
        facts, xxh3 = self._expected(frame, landing)
        if landing is not None and not landing.began:
            landing.began = True
            self._report(PayloadBegan(landing.number))
        if self.held.in_memory(frame.segment):
            self.repeated_bytes += len(frame.chunk)
        payload = self._parts.take(frame, None if facts is None else facts.length)
        if payload is None:
            return
        if facts is None and xxhash.xxh3_64_intdigest(payload) == xxh3:
            facts = facts_of_payload(frame.segment, payload, xxh3)
        self._take(frame.segment, payload, facts, xxh3, landing)

    # ---- payload that is fetched (17)

    def on_fetched(self, segment: int, payload: bytes) -> None:
        """Take a payload that :class:`FetchNeeded` asked for; what nobody wants is dropped."""
        landing, prefetch = self._current, self._prefetch
        if landing is not None and segment not in landing.waiting:
            landing = None
        if landing is not None:
            facts = landing.facts.get(segment)
            if not landing.began:
                landing.began = True
                self._report(PayloadBegan(landing.number))
        elif prefetch is not None and segment in prefetch.waiting:
            facts = prefetch.facts[segment]
        else:
            return
        if facts is not None and self._take(segment, payload, facts, facts.xxh3, landing):
            self._untold[segment] = facts.xxh3

    def tell_fetched(self) -> None:
        """Tell the server what was fetched: before a land or aim, and from time to time."""
        rows, self._untold = list(self._untold.items()), {}
        for start in range(0, len(rows), MAX_HELD_SEGMENTS):
            table = np.array(rows[start : start + MAX_HELD_SEGMENTS], dtype=HELD_DTYPE)
            self._say(Held(segments=table))

    def _fetch(self, load: AnyArray, blocks: AnyArray | None) -> None:
        """Ask the shell for a plan's payloads, where this session pulls."""
        if self.pull is None:
            return
        if blocks is None or len(blocks) != len(load):
            got = "none" if blocks is None else str(len(blocks))
            raise ProtocolViolationError(f"got {got} blocks, expected {len(load)} to pull by")
        starts = blocks.astype(np.int64) * BLOCK_BYTES
        if len(load) and int((starts + load["length"]).max()) > self.pull.total:
            raise ProtocolViolationError(
                f"got a payload beyond the pack, expected it within {self.pull.total} bytes"
            )
        rows = zip(load["id"].tolist(), starts.tolist(), load["length"].tolist(), strict=True)
        fetches = tuple(Fetch(*row) for row in rows)
        self._report(FetchNeeded(self.pull, fetches))

    def _take(
        self,
        segment: int,
        payload: bytes,
        facts: SegmentFacts | None,
        xxh3: int,
        landing: LandingState | None,
    ) -> bool:
        """Take a whole payload; whether it is the one that was meant (4, rule 4)."""
        prefetch = self._prefetch
        actual = xxhash.xxh3_64_intdigest(payload)
        if actual != xxh3 or facts is None:
            number = None if landing is None else landing.number
            generation = landing.generation if landing is not None else None
            if generation is None:
                assert prefetch is not None  # the caller found it wanted by one of the two
                generation = prefetch.generation
            self._report(SegmentRejected(number, segment, actual, xxh3))
            self._reject(generation, segment, facts, xxh3, "hash_mismatch")
            if landing is None and prefetch is not None:
                self._give_up_second_time(prefetch, segment)
            return False
        entry = CachedSegment(facts, payload)
        self.held.put(entry, trim=not self._asked)
        self._report(SegmentArrived(None if landing is None else landing.number, entry))
        if landing is not None:
            landing.waiting.discard(segment)
            self._degrade_if_whole(landing)
            self._finish_if_complete()
        elif prefetch is not None:
            self.aims.arrived(segment, len(payload))
            prefetch.waiting.discard(segment)
            self._end_prefetch_if_done(prefetch)
        return True

    # ---- disk

    def restored(self, entry: CachedSegment) -> None:
        """Take a segment that the disk gave back, verified."""
        self.held.put(entry, trim=not self._asked)
        landing, segment = self._current, entry.facts.segment
        if landing is not None and segment in landing.restoring:
            landing.restoring.discard(segment)
            landing.waiting.discard(segment)
            self._report(SegmentArrived(landing.number, entry, restored=True))
            self._degrade_if_whole(landing)
            self._finish_if_complete()

    def lost(self, segment: int) -> None:
        """Ask the server for a segment that the disk could not give back."""
        xxh3 = self.held.hash_of(segment)
        self.held.drop_disk(segment)
        landing = self._current
        if landing is not None and segment in landing.restoring:
            landing.restoring.discard(segment)
            self._ask_again(landing, segment, xxh3)

    # ---- private

    def _expected(
        self, frame: PayloadFrame, landing: LandingState | None
    ) -> tuple[SegmentFacts | None, int]:
        """Return the segment's facts (None when only its hash is known) and its hash."""
        prefetch = self._prefetch
        if landing is not None:
            facts = landing.facts.get(frame.segment)
            if facts is None and frame.segment in landing.relost:
                return None, landing.relost[frame.segment]
        elif prefetch is not None and prefetch.generation == frame.generation:
            facts = prefetch.facts.get(frame.segment)
        else:
            raise ProtocolViolationError(
                f"got a frame of generation {frame.generation}, which no landing or aim has now"
            )
        if facts is None:
            raise ProtocolViolationError(
                f"got segment {frame.segment}, which generation {frame.generation} does not load"
            )
        return facts, facts.xxh3

    def _ask_again(self, landing: LandingState, segment: int, xxh3: int | None) -> None:
        """Ask for a segment of ``keep`` that is not here after all (6.4, rule 4)."""
        if xxh3 is None:
            raise ProtocolViolationError(
                f"plan {landing.generation} keeps segment {segment}, which was never held"
            )
        landing.expect_again(segment, None, xxh3)
        self._report(SegmentRejected(landing.number, segment, None, xxh3))
        self._reject(landing.generation, segment, None, xxh3, "lost")

    def _reject(
        self, generation: int, segment: int, facts: SegmentFacts | None, xxh3: int, reason: str
    ) -> None:
        """Tell that a segment is not held; for a landing under way that crosses on the wire."""
        self.held.forget([segment])
        for asked in self._asked:
            asked.crossed[segment] = (facts, xxh3)
        self._say(Reject(generation=generation, segment=segment, reason=reason))

    def _give_up_second_time(self, prefetch: PrefetchState, segment: int) -> None:
        """Stop waiting for it: a prefetch is sent once more, then no more (6.4, rule 4)."""
        if segment in self._retried:
            prefetch.waiting.discard(segment)
            self._end_prefetch_if_done(prefetch)
        self._retried.add(segment)

    def _degrade_if_whole(self, landing: LandingState) -> None:
        inner = landing.inner
        if inner is None or not landing.wanted - landing.waiting >= set(inner):
            return
        landing.inner, self._inner = None, inner
        self._report(Degraded(landing.number, inner))

    def _finish_if_complete(self) -> None:
        landing = self._current
        if landing is None or landing.done or not landing.complete:
            return
        landing.done = True
        self.visible, self._inner = landing.shown, ()
        missing = tuple(sorted(landing.waiting))
        self._report(Ready(landing.number, self.visible, missing, landing.timings))
        self._pin_and_trim()

    def _end_prefetch_if_done(self, prefetch: PrefetchState) -> None:
        if not prefetch.waiting:
            self.aim_done = prefetch.generation
            self._report(
                Prefetched(prefetch.generation, len(prefetch.facts), prefetch.payload_bytes)
            )

    def _pin(self) -> None:
        self.held.pin((*self.visible, *self._inner, *self.open_plan, *self._nearby))

    def _pin_and_trim(self) -> None:
        self._pin()
        if not self._asked:
            self.held.trim()
