"""Landings, aims, held segments and credit of one client.

PURE: no I/O, no clock. Section numbers in comments are those of spec/wire-protocol.md.
"""

from __future__ import annotations

from array import array
from bisect import bisect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray, UInt32
from terraport_server.session.id_set import IdSet, ascending
from terraport_server.session.interface import Observer, SceneView, SendChunk, SessionLimits
from terraport_server.session.planner import Planner, Selection
from terraport_wire import (
    ID_DTYPE,
    MAX_CHUNK_BYTES,
    Aim,
    Degraded,
    Hello,
    Land,
    Message,
    Ready,
    Reject,
    Superseded,
    Timings,
)

__all__ = ["Transfers"]

_MAX_CHUNKS: Final = 240
"""Chunks returned at once: the writer takes 250 frames, and a megabyte has 8 of full length."""


class IdQueue:
    """Queue of segment ids in sending order, 4 bytes per id (36 in a list of ints).

    Parameters
    ----------
    ids
        In sending order.

    Examples
    --------
    >>> queue = IdQueue(np.array([7, 3, 5], dtype=np.uint32))
    >>> queue.popleft()
    >>> queue.insert(1, 9)
    >>> list(queue), queue[0], 7 in queue, len(queue)
    ([3, 9, 5], 3, False, 3)
    """

    __slots__ = ("_first", "_ids")

    def __init__(self, ids: UInt32) -> None:
        self._ids = array("I", ids.tobytes())
        self._first = 0
        """Index of the first queued id; ids before it were taken."""

    def __len__(self) -> int:
        """Return the number of queued ids."""
        return len(self._ids) - self._first

    def __getitem__(self, position: int) -> int:
        """Return the id at a position of the queue; IndexError beyond its end."""
        return self._ids[self._first + position]

    def __iter__(self) -> Iterator[int]:
        """Iterate over the queued ids."""
        ids = self._ids
        for position in range(self._first, len(ids)):
            yield ids[position]

    def __contains__(self, segment: object) -> bool:
        """Return whether an id is queued."""
        return segment in self._ids[self._first :]

    def popleft(self) -> None:
        """Remove the first id."""
        self._first += 1

    def insert(self, position: int, segment: int) -> None:
        """Insert an id at a position of the queue."""
        self._ids.insert(self._first + position, segment)

    def array(self) -> UInt32:
        """Return a copy of the queued ids."""
        return np.array(self._ids[self._first :], dtype=np.uint32)


class Transfer:
    """Payload of one aim or landing: ids to send, and counts of what was sent.

    Parameters
    ----------
    generation
        Number of the aim or landing, given by the client.
    selection
        The plan; its ``load`` is sent in this order.
    pulled
        Whether the client fetches the payload over HTTP (17): only rejected segments are sent.
    """

    def __init__(self, generation: int, selection: Selection, *, pulled: bool = False) -> None:
        self.generation = generation
        self.queue = IdQueue(selection.load[:0] if pulled else selection.load)
        """Ids not completely sent; the first may be partly sent."""
        self.awaited: set[int] = set(selection.load.tolist()) if pulled else set()
        """Ids that the client fetches and has not confirmed; disjoint from the queue."""
        self.plan = IdSet.of_sorted(np.sort(selection.load))
        """Ids of this generation; a reject of any other is ignored by it."""
        self._order = selection.order
        self.delivered = 0
        """Number of segments sent completely."""
        self.payload_bytes = 0
        """Payload bytes sent, including segments sent twice."""
        self.resent: set[int] = set()
        """Segments queued again after a reject."""

    def put_back(self, segment: int, *, behind_first: bool) -> None:
        """Queue a segment of the plan again, at its place in the order.

        Parameters
        ----------
        segment
            Not in the queue.
        behind_first
            Whether the first queued segment is partly sent, so that it stays first.
        """
        rank = self._rank(segment)
        position = bisect(self.queue, rank, lo=int(behind_first), key=self._rank)
        self.queue.insert(position, segment)

    @property
    def pending(self) -> bool:
        """Whether the client does not hold all of the load yet."""
        return bool(self.queue or self.awaited)

    def reject(self, segment: int, partly_sent: Mapping[int, int]) -> None:
        """Queue a rejected segment again, once per generation (6.4, rule 4)."""
        if segment in self.queue or segment in self.resent:
            return
        self.awaited.discard(segment)
        self.resent.add(segment)
        self.put_back(segment, behind_first=bool(self.queue and partly_sent.get(self.queue[0])))

    def confirm(self, ids: Iterable[int]) -> bool:
        """Record ids that the client holds; return whether any of them was awaited."""
        taken = self.awaited.intersection(ids)
        self.awaited -= taken
        self.delivered += len(taken)
        return bool(taken)

    def supersede(self, by: int, lengths: UInt32, partly_sent: Mapping[int, int]) -> Superseded:
        """Return the message that a newer generation ends this one."""
        unsent_bytes = self.unsent_bytes(lengths, partly_sent)
        return Superseded(generation=self.generation, by=by, unsent_bytes=unsent_bytes)

    def unsent_bytes(self, lengths: UInt32, partly_sent: Mapping[int, int]) -> int:
        """Return the payload bytes not sent, given the bytes sent of each partial segment."""
        sent_bytes = sum(sent for segment, sent in partly_sent.items() if segment in self.queue)
        unsent_bytes = int(lengths[self.queue.array()].sum(dtype=np.int64)) - sent_bytes
        if self.awaited:
            ids = np.fromiter(self.awaited, dtype=np.int64, count=len(self.awaited))
            unsent_bytes += int(lengths[ids].sum(dtype=np.int64))
        return unsent_bytes

    def _rank(self, segment: int) -> int:
        """Return the position of a segment in the plan's order, in O(plan)."""
        return int(np.argmax(self._order == segment))


class Landing(Transfer):
    """Transfer of a landing: it also has kept segments, deadlines and a ``ready``.

    Parameters
    ----------
    generation, selection
        As for a transfer.
    received_s
        Time when ``land`` was received.
    deadline_s
        Time from which the inner set is enough for ``degraded``; ``None``: never.
    stall_s
        The same after this many seconds without progress; ``None``: never.
    pulled
        As for a transfer.
    """

    def __init__(
        self,
        generation: int,
        selection: Selection,
        *,
        received_s: float,
        deadline_s: float | None = None,
        stall_s: float | None = None,
        pulled: bool = False,
    ) -> None:
        super().__init__(generation, selection, pulled=pulled)
        self.plan = selection.plan
        self.received_s = received_s
        self._deadline_s = deadline_s
        self._stall_s = stall_s
        self.has_deadline = deadline_s is not None or stall_s is not None
        self.inner = selection.inner
        """Ids of the inner set, nearest first."""
        self.missing: set[int] = set()
        """Segments of the plan that cannot be delivered."""
        self.ready = False
        """``ready`` was sent, and nothing was rejected since."""
        self.was_ready = False
        """``ready`` was sent at least once."""
        self.deadline_passed = False
        self.degraded = False
        """``degraded`` was sent."""
        self.planned_s: float | None = None
        """Time when the plan was handed to the socket."""
        self.first_byte_s: float | None = None
        """Time of the first payload byte."""
        self.last_byte_s: float | None = None
        """Time of the newest payload byte."""
        self.confirmed_s: float | None = None
        """Time of the newest confirmation of a fetched segment."""
        self.credit_wait_s = 0.0
        """Seconds during which payload waited for credit."""

    @property
    def unfinished(self) -> bool:
        """Whether ``ready`` is still to be sent."""
        return not self.ready

    @property
    def deadline_s(self) -> float | None:
        """Time from which the inner set is enough if no progress is made (6.4, rule 3)."""
        times = [] if self._deadline_s is None else [self._deadline_s]
        if self._stall_s is not None:
            progress_s = max(self.received_s, self.last_byte_s or 0.0, self.confirmed_s or 0.0)
            times.append(progress_s + self._stall_s)
        return min(times, default=None)

    @property
    def deadline_is_open(self) -> bool:
        """Whether ``degraded`` may still be sent."""
        return self.has_deadline and self.unfinished and not self.degraded

    def check_deadline(self, now_s: float) -> bool:
        """Return whether a deadline has passed, now or earlier; later progress does not undo it."""
        due_s = self.deadline_s
        self.deadline_passed = self.deadline_passed or (due_s is not None and now_s >= due_s)
        return self.deadline_passed

    def reject(self, segment: int, partly_sent: Mapping[int, int]) -> None:
        """Queue a rejected segment again, else report it as missing; ``ready`` is sent again."""
        if segment not in self.queue:
            given_up = segment in self.resent
            super().reject(segment, partly_sent)
            (self.missing.add if given_up else self.missing.discard)(segment)
            self.awaited.discard(segment)
            self.ready = False

    def confirm_at(self, ids: Iterable[int], now_s: float) -> None:
        """Record ids that the client holds; an awaited one counts as progress."""
        if self.confirm(ids):
            if self.has_deadline:
                self.check_deadline(now_s)  # before this progress
            self.confirmed_s = now_s

    def make_ready(self, now_s: float, *, timings: bool) -> Ready:
        """Mark the landing as ready and return the message."""
        self.ready = True
        return Ready(
            generation=self.generation,
            delivered=min(self.delivered, len(self.plan)),
            payload_bytes=self.payload_bytes,
            missing=np.array(sorted(self.missing), dtype=ID_DTYPE),
            timings=self.timings(now_s) if timings else None,
        )

    def timings(self, now_s: float) -> Timings:
        """Return the timings of a landing that becomes ready now (6.4, rule 8)."""

        def since_us(moment_s: float | None) -> int | None:
            if moment_s is None:
                return None
            return max(0, round((moment_s - self.received_s) * 1e6))

        return Timings(
            plan_us=since_us(self.planned_s),
            first_byte_us=since_us(self.first_byte_s),
            last_byte_us=since_us(self.last_byte_s),
            ready_us=since_us(now_s) or 0,
            credit_wait_us=max(0, round(self.credit_wait_s * 1e6)),
        )

    def inner_is_whole(self, held: IdSet) -> bool:
        """Return whether the client holds the inner set, except for missing segments."""
        inner = self.inner
        return all(segment in self.missing for segment in inner[~held.contains(inner)].tolist())


class Transfers:
    """Landings, aims, held segments and credit of one client.

    Parameters
    ----------
    scene
        The served scene.
    limits
        Limits of the session.
    hello
        The client's capabilities, budgets and held segments.
    send
        Queues a message.
    observer
        Receives events for metrics and logs.
    """

    def __init__(
        self,
        scene: SceneView,
        limits: SessionLimits,
        hello: Hello,
        *,
        send: Callable[[Message], None],
        observer: Observer,
    ) -> None:
        self._limits = limits
        self._send = send
        self._observer = observer
        self.encoding = hello.encoding
        self._planner = Planner(scene, limits, hello)
        self._table = self._planner.table
        self._timings = bool(hello.timings)
        self.release_factor = self._planner.release_factor
        """Release radius / load radius in use."""
        self.held = IdSet()
        """Ids that the client holds, as far as the server knows."""
        self._aim_bytes: dict[int, int] = {}
        """Payload bytes sent for aims by segment, until settled as used or wasted, each byte once:
        used if the next landing's plan has the segment, else wasted."""
        self._aim_unjudged = False
        """An aim was planned since the last landing."""
        self.pull = scene.pull if hello.delivery == "pull" else None
        """Where the client fetches payload over HTTP (17); None: payload is sent in frames."""
        self._is_new = True
        """No aim or landing was received yet."""
        self.credit_bytes = min(hello.credit_bytes, limits.max_credit_bytes)
        """Payload bytes that may still be sent."""
        self._partly_sent: dict[int, int] = {}
        self._landing: Landing | None = None
        """The newest planned landing, until a newer one is accepted."""
        self._aiming: Transfer | None = None
        self._waiting_land: Land | None = None
        """Landing that is accepted and not planned; then no other landing or aim is open."""
        self._landed_s = 0.0
        """Time when the newest ``land`` was received."""
        self._waiting_aim: Aim | None = None
        self._stalled_since_s: float | None = None
        """Time since which payload waits for credit; None: none waits."""
        self.dropped = self.offer(hello.held)
        """Ids in ``hello.held`` that were not accepted."""

    @property
    def payload_count(self) -> int:
        """Number of payloads in the scene, of all levels; ids are below it."""
        return len(self._table)

    @property
    def may_offer(self) -> bool:
        """Whether ``held`` is allowed: before any aim or landing, or in pull mode (5.3, 17)."""
        return self._is_new or self.pull is not None

    @property
    def landing_open(self) -> bool:
        """Whether a landing is open."""
        if self._waiting_land is not None:
            return True
        return self._landing is not None and self._landing.unfinished

    @property
    def plan_is_due(self) -> bool:
        """Whether :meth:`make_plan` has something to plan."""
        if self._waiting_land is not None:
            return True
        return self._waiting_aim is not None and not self.landing_open

    @property
    def deadline_s(self) -> float | None:
        """Time at which :meth:`settle` must be called; None: no deadline is open."""
        landing = self._landing
        if landing is None or not landing.deadline_is_open or landing.deadline_passed:
            return None
        return landing.deadline_s

    def grant(self, credit_bytes: int, now_s: float) -> None:
        """Add credit, up to the limit (8.1)."""
        self.credit_bytes = min(self.credit_bytes + credit_bytes, self._limits.max_credit_bytes)
        self._note_stall(now_s)

    def offer(self, held: AnyArray | None) -> UInt32:
        """Accept the rows with the right hash as held; return the ids of the others (5.3)."""
        if held is None:
            return np.zeros(0, dtype=ID_DTYPE)
        ids = held["id"].astype(np.int64)
        is_match = ids < len(self._table)
        is_match[is_match] = self._table.hashes[ids[is_match]] == held["xxh3"][is_match]
        dropped = ascending(ids[~is_match].astype(ID_DTYPE))
        queued = self._queued()
        if queued:  # rejected earlier and being sent again: held once that is done
            is_match[is_match] = [segment not in queued for segment in ids[is_match].tolist()]
        self.held.difference_update(dropped)  # an id offered again replaces its row
        self.held.update(ids[is_match])
        return dropped

    def take_held(self, held: AnyArray, now_s: float) -> UInt32:
        """Accept rows of ``held``; return the ids with a wrong hash (5.3, 17)."""
        dropped = self.offer(held)
        if self.pull is None:
            return dropped
        ids = set(held["id"].tolist()).difference(dropped.tolist())
        if self._aiming is not None:
            self._aiming.confirm(ids)
        if self._landing is not None:
            self._landing.confirm_at(ids, now_s)
        self.settle(now_s)
        return dropped

    def land(self, land: Land, now_s: float) -> None:
        """Accept a landing and end older generations; :meth:`make_plan` plans it (6.3, 6.5)."""
        if self._waiting_land is not None:
            self._drop_unplanned(self._waiting_land, land.generation)
        elif self._landing is not None and self._landing.unfinished:
            self._supersede(self._landing, land.generation, landing=True)
        self.end_aims(land.generation)
        self._landing, self._waiting_land, self._landed_s = None, land, now_s
        self._is_new = False
        self._note_stall(now_s)

    def make_plan(self, now_s: float) -> int:
        """Plan the waiting landing, else the aim; return the number of segments examined."""
        land, aim = self._waiting_land, self._waiting_aim
        if land is not None:
            self._waiting_land = None
            chosen, looked_at = self._planner.choose(land, self.held)
            self._begin_landing(land, chosen)
        elif aim is not None and not self.landing_open:
            self._waiting_aim = None
            chosen, looked_at = self._planner.choose(aim, self.held)
            self._begin_aim(aim, chosen)
        else:
            return 0
        self.settle(now_s)
        return looked_at

    def _begin_landing(self, land: Land, chosen: Selection) -> None:
        came_s = self._landed_s
        self._landing = Landing(
            land.generation,
            chosen,
            received_s=came_s,
            deadline_s=None if land.deadline_ms is None else came_s + land.deadline_ms / 1000.0,
            stall_s=None if land.stall_ms is None else land.stall_ms / 1000.0,
            pulled=self.pull is not None,
        )
        self._forget_partly_sent(self._landing)
        self._settle_aims(self._landing.plan, hit=len(chosen.load) == 0)
        plan = self._planner.plan(land, chosen)
        self._send(plan)
        self._observer.planned(
            land.generation,
            load=len(plan.load),
            keep=len(plan.keep),
            payload_bytes=plan.load_bytes,
            omitted=plan.omitted_segments,
        )

    def aim(self, aim: Aim, now_s: float) -> None:
        """Accept an aim; it is planned once no landing is open (7.2)."""
        self.end_aims(aim.generation)
        self._waiting_aim, self._is_new = aim, False
        self._note_stall(now_s)

    def end_prefetch(self) -> None:
        """End all aims without a word to the client."""
        self.end_aims(by=None)

    def end_aims(self, by: int | None) -> None:
        """End all aims; ``by`` is the newer generation, ``None`` sends no ``superseded``."""
        aiming, waiting = self._aiming, self._waiting_aim
        self._aiming = self._waiting_aim = None
        if by is None:
            return
        if aiming is not None and aiming.pending:
            self._supersede(aiming, by, landing=False)
        if waiting is not None:
            self._drop_unplanned(waiting, by)

    def evict(self, segments: AnyArray) -> str | None:
        """Record segments that the client dropped; return an error text if not allowed (6.7)."""
        if self._waiting_land is not None and len(segments):
            return f"got evict of segment {segments.min()} after land, expected the plan first"
        if self._landing is not None and self._landing.unfinished:
            wrong = segments[self._landing.plan.contains(segments)]
            if len(wrong):
                segment = wrong.min()
                return f"got evict of segment {segment} of the open landing, expected ready first"
        self.held.difference_update(segments)
        self._waste_aimed(segments.tolist())
        return None

    def reject(self, reject: Reject, now_s: float) -> None:
        """Queue a rejected segment again, else report it as missing (6.4, rule 4)."""
        segment = reject.segment
        self._observer.rejected(reject.generation, [segment])
        self.held.discard(segment)
        self._waste_aimed([segment])
        landing, aiming = self._landing, self._aiming
        if landing is not None and segment in landing.plan:
            landing.reject(segment, self._partly_sent)
            self.settle(now_s)
        elif aiming is not None and segment in aiming.plan:
            aiming.reject(segment, self._partly_sent)

    def upcoming(self, most: int) -> list[int]:
        """Return the next segments in sending order; the first may be partly sent."""
        transfer = self._sending()
        return [] if transfer is None else list(islice(transfer.queue, most))

    def next_chunks(self, most_bytes: int) -> list[SendChunk]:
        """Return the next chunks, ending with the one that reaches *most_bytes*."""
        transfer, credit_bytes = self._sending(), self.credit_bytes
        if transfer is None or credit_bytes <= 0:
            return []
        chunks, lengths, partly_sent = [], self._table.lengths, self._partly_sent
        generation, landing = transfer.generation, transfer is self._landing
        for segment in transfer.queue:
            total, offset = int(lengths[segment]), partly_sent.get(segment, 0)
            # Whole frames, but for the end of the segment or of the credit.
            whole_bytes = -(-most_bytes // MAX_CHUNK_BYTES) * MAX_CHUNK_BYTES
            length = min(total - offset, credit_bytes, whole_bytes)
            chunks.append(SendChunk(generation, segment, offset, length, total, landing))
            credit_bytes -= length
            most_bytes -= length
            if credit_bytes <= 0 or most_bytes <= 0 or len(chunks) == _MAX_CHUNKS:
                break
        return chunks

    def chunks_sent(self, chunks: Sequence[SendChunk], now_s: float) -> None:
        """Record as sent the leading chunks of the newest :meth:`next_chunks`."""
        transfer = self._answering(chunks[0])
        sent_bytes = sum([chunk.length for chunk in chunks])
        self.credit_bytes -= sent_bytes
        transfer.payload_bytes += sent_bytes
        if isinstance(transfer, Landing):
            if transfer.has_deadline:
                transfer.check_deadline(now_s)  # before this progress
            transfer.last_byte_s = now_s
            if transfer.first_byte_s is None:
                transfer.first_byte_s = now_s
                self._observer.first_byte(now_s - transfer.received_s)
        else:
            for chunk in chunks:
                aimed_bytes = self._aim_bytes.get(chunk.segment, 0)
                self._aim_bytes[chunk.segment] = aimed_bytes + chunk.length
        for chunk in chunks:
            end = chunk.offset + chunk.length
            if end < chunk.total:
                self._partly_sent[chunk.segment] = end
                continue
            transfer.queue.popleft()
            self._partly_sent.pop(chunk.segment, None)
            self.held.add_new(chunk.segment)  # a held segment is never queued
            transfer.delivered += 1
        self.settle(now_s)

    def payload_failed(self, chunk: SendChunk, now_s: float) -> None:
        """Report as missing the segment of the first chunk of the newest :meth:`next_chunks`."""
        transfer = self._answering(chunk)
        transfer.queue.popleft()
        self._partly_sent.pop(chunk.segment, None)
        if isinstance(transfer, Landing):
            transfer.missing.add(chunk.segment)
        self.settle(now_s)

    def end(self) -> None:
        """Settle the unused payload of aims as wasted, because the session is over."""
        self._waste_aimed(list(self._aim_bytes))

    def settle(self, now_s: float) -> None:
        """Send ``ready`` or ``degraded`` if due."""
        landing = self._landing
        if landing is not None and landing.unfinished:
            if not landing.pending:
                self._finish(landing, now_s)
            elif (
                landing.deadline_is_open
                and landing.check_deadline(now_s)
                and landing.inner_is_whole(self.held)
            ):
                self._degrade(landing)
        self._note_stall(now_s)

    def plan_sent(self, generation: int, now_s: float) -> None:
        """Record that the plan of a generation was handed to the socket."""
        landing = self._landing
        if landing is not None and landing.generation == generation:
            landing.planned_s = now_s
            self._observer.plan_sent(generation, now_s - landing.received_s)

    def _note_stall(self, now_s: float) -> None:
        """Measure how long payload waits for credit."""
        stalled = self.credit_bytes <= 0 and self._sending() is not None
        if stalled == (self._stalled_since_s is not None):
            return
        if self._stalled_since_s is None:
            self._stalled_since_s = now_s
        else:
            landing = self._landing
            if landing is not None:
                since_s = max(self._stalled_since_s, landing.received_s)
                landing.credit_wait_s += now_s - since_s
            self._stalled_since_s = None
        self._observer.credit_stalled(stalled=stalled)

    def _finish(self, landing: Landing, now_s: float) -> None:
        self._send(message := landing.make_ready(now_s, timings=self._timings))
        if not landing.was_ready:
            landing.was_ready = True
            self._observer.ready(
                message.generation,
                segments=message.delivered,
                payload_bytes=message.payload_bytes,
                missing=len(message.missing),
                seconds=now_s - landing.received_s,
            )

    def _degrade(self, landing: Landing) -> None:
        landing.degraded = True
        ids = landing.inner[self.held.contains(landing.inner)]
        self._send(Degraded(generation=landing.generation, segments=ids))

    def _begin_aim(self, aim: Aim, chosen: Selection) -> None:
        self._aiming = Transfer(aim.generation, chosen, pulled=self.pull is not None)
        self._aim_unjudged = True
        self._forget_partly_sent(self._aiming)
        self._send(self._planner.prefetch(aim, chosen))

    def _queued(self) -> set[int]:
        """Return the rejected segments being sent to a pull client."""
        if self.pull is None:
            return set()
        return {i for going in (self._landing, self._aiming) if going for i in going.queue}

    def _sending(self) -> Transfer | None:
        landing, aiming = self._landing, self._aiming
        if aiming is not None and aiming.queue and self._partly_sent.get(aiming.queue[0]):
            return aiming  # a reject may reopen a landing: finish the partly sent segment first
        if landing is not None and landing.unfinished:
            return landing if landing.queue else None
        return aiming if aiming is not None and aiming.queue else None

    def _answering(self, chunk: SendChunk) -> Transfer:
        transfer = self._sending()
        assert transfer is not None
        assert transfer.queue[0] == chunk.segment
        return transfer

    def _supersede(self, transfer: Transfer, by: int, *, landing: bool) -> None:
        message = transfer.supersede(by, self._table.lengths, self._partly_sent)
        self._send(message)
        self._observer.superseded(message.generation, message.unsent_bytes, landing=landing)

    def _drop_unplanned(self, wanted: Land | Aim, by: int) -> None:
        """Send ``superseded`` for a landing or aim that was never planned (6.3, 7.2)."""
        message = Superseded(generation=wanted.generation, by=by, unsent_bytes=0)
        self._send(message)
        self._observer.superseded(message.generation, 0, landing=isinstance(wanted, Land))

    def _forget_partly_sent(self, transfer: Transfer) -> None:
        """Forget partly sent segments that the new plan does not contain (6.5, rule 3)."""
        forgotten = [segment for segment in self._partly_sent if segment not in transfer.plan]
        for segment in forgotten:
            del self._partly_sent[segment]
        self._waste_aimed(forgotten)

    def _settle_aims(self, plan: IdSet, *, hit: bool) -> None:
        """Settle aimed payload by a landing's plan; ``hit``: the landing loads nothing."""
        if self._aim_unjudged:
            self._aim_unjudged = False
            self._observer.aim_judged(hit=hit)
        sent, self._aim_bytes = self._aim_bytes, {}
        if sent:
            used = sum(length for segment, length in sent.items() if segment in plan)
            self._observer.aim_ended(sum(sent.values()), used)

    def _waste_aimed(self, segments: Iterable[int]) -> None:
        """Settle aimed payload as wasted: evicted, rejected or not in a plan."""
        if not self._aim_bytes:
            return
        wasted = sum(self._aim_bytes.pop(segment, 0) for segment in segments)
        if wasted:
            self._observer.aim_ended(wasted, 0)
