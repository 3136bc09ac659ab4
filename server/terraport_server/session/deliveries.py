"""What one client holds, wants and is being sent.

PURE: no I/O, no clock. The part of a session that is left without greetings, errors and timeouts:
landings, aims, held segments and credit. Section
numbers in comments are those of spec/wire-protocol.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice

import numpy as np

from terraport_payload.types import AnyArray, UInt32
from terraport_server.session.actions import Observer, SceneView, SendChunk, SessionLimits
from terraport_server.session.aim_ledger import AimLedger
from terraport_server.session.id_set import IdSet, ascending
from terraport_server.session.plans import Planner
from terraport_server.session.selection import Selection
from terraport_server.session.transfer import Landing, Transfer
from terraport_wire import (
    ID_DTYPE,
    MAX_CHUNK_BYTES,
    Aim,
    Degraded,
    Hello,
    Land,
    Message,
    Reject,
    Superseded,
)

__all__ = ["Deliveries"]


class Deliveries:
    """Landings, aims, held segments and credit of one client.

    Parameters
    ----------
    scene
        What is served.
    limits
        What the client may do.
    hello
        What the client can take, and what it holds.
    say
        Takes the messages to send, in order.
    observer
        Told of what happens.
    """

    def __init__(
        self,
        scene: SceneView,
        limits: SessionLimits,
        hello: Hello,
        *,
        say: Callable[[Message], None],
        observer: Observer,
    ) -> None:
        self._limits = limits
        self._say = say
        self._observer = observer
        self.encoding = hello.encoding
        self._planner = Planner(scene, limits, hello)
        self._table = self._planner.table
        self._timings = bool(hello.timings)
        self.release_factor = self._planner.release_factor
        """Release radius / load radius in use."""
        self.held = IdSet()
        """What the client holds, in the server's view."""
        self._ahead = AimLedger(observer)
        self.pull = scene.pull if hello.delivery == "pull" else None
        """Where the client fetches payload by itself (17); None where it is sent in frames."""
        self._is_new = True
        """Whether no aim or landing came yet."""
        self.credit_bytes = min(hello.credit_bytes, limits.max_credit_bytes)
        """Payload bytes that may still be sent."""
        self._partly_sent: dict[int, int] = {}
        self._landing: Landing | None = None
        """The newest one that has a plan, until a newer one is accepted."""
        self._aiming: Transfer | None = None
        self._waiting_land: Land | None = None
        """Accepted and not planned yet; then there is no landing and no aim."""
        self._landed_s = 0.0
        """When the newest ``land`` came."""
        self._waiting_aim: Aim | None = None
        self._stalled_since_s: float | None = None
        """Since when there is payload to send and no credit."""
        self.dropped = self.offer(hello.held)
        """Ids offered by hello that were not accepted."""

    @property
    def payload_count(self) -> int:
        """Payloads of the scene, of every level: ids are below it."""
        return len(self._table)

    @property
    def may_offer(self) -> bool:
        """Whether ``held`` may come: before any aim or landing, or of what is pulled (5.3, 17)."""
        return self._is_new or self.pull is not None

    @property
    def landing_open(self) -> bool:
        """Whether a landing is unfinished."""
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
        """When :meth:`settle` has something to do because of time alone."""
        landing = self._landing
        if landing is None or not landing.deadline_is_open or landing.deadline_passed:
            return None
        return landing.deadline_s

    def grant(self, credit_bytes: int, now_s: float) -> None:
        """Add credit, clamped to the limit (8.1)."""
        self.credit_bytes = min(self.credit_bytes + credit_bytes, self._limits.max_credit_bytes)
        self._note_stall(now_s)

    def offer(self, held: AnyArray | None) -> UInt32:
        """Take the offered segments whose hash is right; return the ids of the others (5.3)."""
        if held is None:
            return np.zeros(0, dtype=ID_DTYPE)
        ids = held["id"].astype(np.int64)
        is_match = ids < len(self._table)
        is_match[is_match] = self._table.hashes[ids[is_match]] == held["xxh3"][is_match]
        dropped = ascending(ids[~is_match].astype(ID_DTYPE))
        queued = self._queued()
        if queued:  # rejected before, and being sent once more: held when that is done
            is_match[is_match] = [segment not in queued for segment in ids[is_match].tolist()]
        self.held.difference_update(dropped)  # an id offered again replaces its row
        self.held.update(ids[is_match])
        return dropped

    def take_held(self, held: AnyArray, now_s: float) -> UInt32:
        """Take what the client says to hold by now; return the ids of wrong rows (5.3, 17)."""
        dropped = self.offer(held)
        if self.pull is None:
            return dropped
        ids = set(held["id"].tolist()).difference(dropped.tolist())
        if self._aiming is not None:
            self._aiming.fetched(ids)
        if self._landing is not None:
            self._landing.told(ids, now_s)
        self.settle(now_s)
        return dropped

    def land(self, land: Land, now_s: float) -> None:
        """End what is older; the plan follows by :meth:`make_plan` (6.3, 6.5)."""
        if self._waiting_land is not None:
            self._drop_unplanned(self._waiting_land, land.generation)
        elif self._landing is not None and self._landing.unfinished:
            self._supersede(self._landing, land.generation, landing=True)
        self.end_aims(land.generation)
        self._landing, self._waiting_land, self._landed_s = None, land, now_s
        self._is_new = False
        self._note_stall(now_s)

    def make_plan(self, now_s: float) -> int:
        """Plan the landing that waits, or else the aim; return how many segments were looked at."""
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
        self._ahead.land(self._landing.plan, needed_more=len(chosen.load) > 0)
        plan = self._planner.plan(land, chosen)
        self._say(plan)
        self._observer.planned(land.generation, plan)

    def aim(self, aim: Aim, now_s: float) -> None:
        """Take the newest aim; it is planned when no landing is open (7.2)."""
        self.end_aims(aim.generation)
        self._waiting_aim, self._is_new = aim, False
        self._note_stall(now_s)

    def end_aims(self, by: int | None) -> None:
        """End the aims; ``by`` is the newer generation, ``None`` to say nothing about it."""
        aiming, waiting = self._aiming, self._waiting_aim
        self._aiming = self._waiting_aim = None
        if by is None:
            return
        if aiming is not None and aiming.pending:
            self._supersede(aiming, by, landing=False)
        if waiting is not None:
            self._drop_unplanned(waiting, by)

    def evict(self, segments: AnyArray) -> str | None:
        """Note that the client dropped segments; return why where it may not yet (6.7)."""
        if self._waiting_land is not None and len(segments):
            return f"got evict of segment {segments.min()} after land, expected the plan first"
        if self._landing is not None and self._landing.unfinished:
            wrong = segments[self._landing.plan.contains(segments)]
            if len(wrong):
                segment = wrong.min()
                return f"got evict of segment {segment} of the open landing, expected ready first"
        self.held.difference_update(segments)
        self._ahead.waste(segments.tolist())
        return None

    def reject(self, reject: Reject, now_s: float) -> None:
        """Send a segment once more, or give it up (6.4, rule 4)."""
        segment = reject.segment
        self._observer.rejected(reject)
        self.held.discard(segment)
        self._ahead.waste([segment])
        landing, aiming = self._landing, self._aiming
        if landing is not None and segment in landing.plan:
            landing.reject(segment, self._partly_sent)
            self.settle(now_s)
        elif aiming is not None and segment in aiming.plan:
            aiming.reject(segment, self._partly_sent)

    def upcoming(self, most: int) -> list[int]:
        """Return the segments that are sent next, in order; the first may be partly sent."""
        transfer = self._sending()
        return [] if transfer is None else list(islice(transfer.queue, most))

    def next_chunks(self, most_bytes: int) -> list[SendChunk]:
        """Return chunks to send one after the other; they end where *most_bytes* are reached."""
        transfer, credit_bytes = self._sending(), self.credit_bytes
        if transfer is None or credit_bytes <= 0:
            return []
        chunks, lengths = [], self._table.lengths
        generation, landing = transfer.generation, transfer is self._landing
        for segment in transfer.queue:
            total, offset = int(lengths[segment]), self._partly_sent.get(segment, 0)
            while offset < total:
                length = min(MAX_CHUNK_BYTES, total - offset, credit_bytes)
                chunks.append(SendChunk(generation, segment, offset, length, total, landing))
                offset += length
                credit_bytes -= length
                most_bytes -= length
                if credit_bytes <= 0 or most_bytes <= 0:
                    return chunks
        return chunks

    def chunks_sent(self, chunks: Sequence[SendChunk], now_s: float) -> None:
        """Book the first so many of the chunks that :meth:`next_chunks` returned last."""
        transfer = self._answering(chunks[0])
        sent_bytes = sum(chunk.length for chunk in chunks)
        self.credit_bytes -= sent_bytes
        transfer.payload_bytes += sent_bytes
        if isinstance(transfer, Landing):
            if transfer.has_deadline:
                transfer.look_at_clock(now_s)  # before this counts as progress
            transfer.last_byte_s = now_s
            if transfer.first_byte_s is None:
                transfer.first_byte_s = now_s
                self._observer.first_byte(now_s - transfer.received_s)
        else:
            for chunk in chunks:
                self._ahead.sent(chunk.segment, chunk.length)
        for chunk in chunks:
            end = chunk.offset + chunk.length
            if end < chunk.total:
                self._partly_sent[chunk.segment] = end
                continue
            transfer.queue.popleft()
            self._partly_sent.pop(chunk.segment, None)
            self.held.add_new(chunk.segment)  # what is held is never queued
            transfer.delivered += 1
        self.settle(now_s)

    def payload_failed(self, chunk: SendChunk, now_s: float) -> None:
        """Give up the segment of the chunk that :meth:`next_chunks` returned first."""
        transfer = self._answering(chunk)
        transfer.queue.popleft()
        self._partly_sent.pop(chunk.segment, None)
        if isinstance(transfer, Landing):
            transfer.missing.add(chunk.segment)
        self.settle(now_s)

    def end(self) -> None:
        """Book as wasted what was sent for aims and never used: the session is over."""
        self._ahead.end()

    def settle(self, now_s: float) -> None:
        """Say what has become due: ``ready``, ``degraded``."""
        landing = self._landing
        if landing is not None and landing.unfinished:
            if not landing.pending:
                self._finish(landing, now_s)
            elif (
                landing.deadline_is_open
                and landing.look_at_clock(now_s)
                and landing.inner_is_whole(self.held)
            ):
                self._degrade(landing)
        self._note_stall(now_s)

    def plan_sent(self, generation: int, now_s: float) -> None:
        """Note that the plan of that generation is on its way."""
        landing = self._landing
        if landing is not None and landing.generation == generation:
            landing.planned_s = now_s
            self._observer.plan_sent(generation, now_s - landing.received_s)

    def _note_stall(self, now_s: float) -> None:
        """Tell the time that a client's credit takes from the time that the server takes."""
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
        self._say(message := landing.say_ready(now_s, timings=self._timings))
        if not landing.readied:
            landing.readied = True
            self._observer.ready(message, now_s - landing.received_s)

    def _degrade(self, landing: Landing) -> None:
        landing.degraded = True
        ids = landing.inner[self.held.contains(landing.inner)]
        self._say(Degraded(generation=landing.generation, segments=ids))

    def _begin_aim(self, aim: Aim, chosen: Selection) -> None:
        self._aiming = Transfer(aim.generation, chosen, pulled=self.pull is not None)
        self._ahead.aim()
        self._forget_partly_sent(self._aiming)
        self._say(self._planner.prefetch(aim, chosen))

    def _queued(self) -> set[int]:
        """Return what is sent once more to a client that pulls: few, or none."""
        if self.pull is None:
            return set()
        return {i for going in (self._landing, self._aiming) if going for i in going.queue}

    def _sending(self) -> Transfer | None:
        landing, aiming = self._landing, self._aiming
        if aiming is not None and aiming.queue and self._partly_sent.get(aiming.queue[0]):
            return aiming  # a reject may reopen a landing: segments still come one after the other
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
        self._say(message)
        self._observer.superseded(message, landing=landing)

    def _drop_unplanned(self, wanted: Land | Aim, by: int) -> None:
        """Say that what nobody planned is over: there is nothing of it to be sent (6.3, 7.2)."""
        message = Superseded(generation=wanted.generation, by=by, unsent_bytes=0)
        self._say(message)
        self._observer.superseded(message, landing=isinstance(wanted, Land))

    def _forget_partly_sent(self, transfer: Transfer) -> None:
        """Forget every part of a segment that is not to be sent now (6.5, rule 3)."""
        forgotten = [segment for segment in self._partly_sent if segment not in transfer.plan]
        for segment in forgotten:
            del self._partly_sent[segment]
        self._ahead.waste(forgotten)
