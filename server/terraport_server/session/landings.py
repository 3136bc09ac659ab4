"""The landing and the prefetch of one client, and the payload that they still need.

PURE: no I/O, no clock. Section numbers are those of spec/protocol.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np

from terraport_payload.types import Int64
from terraport_server.session.interface import Observer, SceneView, SendChunk, SessionLimits
from terraport_server.session.plan import Ball, budgets_of, choose, hidden_under, plan_of
from terraport_wire import MAX_CHUNK_BYTES, Hello, Land, Message, Prefetch, Ready

__all__ = ["Landings"]

_MAX_CHUNKS: Final = 240
"""Chunks returned at once: the writer takes 250 frames."""


class _Transfer:
    """Payload that one landing or prefetch still needs.

    Parameters
    ----------
    generation
    rows
        Rows of the segment table that are shown, nearest first.
    queue
        Those to send, in order.
    received_s
        When the message came.
    """

    def __init__(
        self, generation: int, rows: Int64, queue: Sequence[int], *, received_s: float
    ) -> None:
        self.generation = generation
        self.rows = rows
        self.queue = deque(queue)
        self.received_s = received_s
        self.missing: list[int] = []
        """Rows that cannot be delivered."""
        self.delivered = 0
        self.payload_bytes = 0


class Landings:
    """The landing that is under way, at most one prefetch, and credit.

    Parameters
    ----------
    scene
    limits
    hello
        With the client's budgets and first credit.
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
        self._scene = scene
        self._table = scene.table
        self._max_credit_bytes = limits.max_credit_bytes
        self._budgets = budgets_of(hello.budgets, limits.max_plan_segments)
        self._send = send
        self._observer = observer
        self.credit_bytes = min(hello.credit_bytes, limits.max_credit_bytes)
        """Payload bytes that may still be sent."""
        self._sent_bytes = 0
        """Payload bytes sent on this connection."""
        self._on_way: deque[tuple[int, int]] = deque()
        """Rows that were sent whole and may not have arrived, each with the payload bytes that
        were sent on the connection up to its end."""
        self._partly_sent: tuple[int, int] | None = None
        """Row of which a part was sent, and how many bytes."""
        self._landing: _Transfer | None = None
        """The landing that is planned and not ready."""
        self._prefetch: _Transfer | None = None
        self._waiting_land: Land | None = None
        """Landing that is not planned yet; then no other landing or prefetch is open."""
        self._waiting_prefetch: Prefetch | None = None
        self._received_s = 0.0
        """When the newest landing came."""

    @property
    def landing_open(self) -> bool:
        """Whether a landing is under way."""
        return self._waiting_land is not None or self._landing is not None

    @property
    def plan_is_due(self) -> bool:
        """Whether :meth:`make_plan` has something to plan."""
        return self._waiting_land is not None or (
            self._waiting_prefetch is not None and self._landing is None
        )

    def grant(self, credit_bytes: int) -> None:
        """Add credit, up to the limit (6)."""
        self.credit_bytes = min(self.credit_bytes + credit_bytes, self._max_credit_bytes)
        self._note_stall()

    def land(self, land: Land, now_s: float) -> None:
        """Accept a landing, which ends what was before it (4, rule 5)."""
        waiting = self._waiting_land
        if waiting is not None:
            self._observer.superseded(waiting.generation, 0, landing=True)
        if self._landing is not None:
            self._end(self._landing, landing=True)
        self.end_prefetch()
        self._landing, self._waiting_land, self._received_s = None, land, now_s

    def prefetch(self, prefetch: Prefetch) -> None:
        """Accept a prefetch, which is planned once no landing is open (5)."""
        self.end_prefetch()
        self._waiting_prefetch = prefetch

    def end_prefetch(self) -> None:
        """End the prefetch."""
        if self._prefetch is not None and self._prefetch.queue:
            self._end(self._prefetch, landing=False)
        self._prefetch = self._waiting_prefetch = None

    def make_plan(self, now_s: float) -> int:
        """Plan what waits; return the number of segments examined."""
        land, prefetch = self._waiting_land, self._waiting_prefetch
        if land is not None:
            self._waiting_land = None
            ball, transfer = self._begin(land)
            self._landing = transfer
            self._observer.rejected(land.generation, ball.left_out.tolist())
            follows = ~np.isin(self._table.hashes[ball.rows], land.have)
            plan = plan_of(
                self._scene,
                ball,
                land.generation,
                follows=follows,
                inner_radius_m=land.inner_radius_m,
            )
            self._send(plan)
            self._observer.planned(
                land.generation,
                load=len(transfer.queue),
                keep=len(ball.rows) - len(transfer.queue),
                payload_bytes=self._bytes_of(transfer.queue),
                omitted=ball.omitted,
            )
        elif prefetch is not None and self._landing is None:
            self._waiting_prefetch = None
            ball, self._prefetch = self._begin(prefetch)
        else:
            return 0
        self._settle(now_s)
        return ball.looked_at

    def upcoming(self, most: int) -> list[int]:
        """Return the next rows in sending order; the first may be partly sent."""
        transfer = self._sending()
        return [] if transfer is None else list(transfer.queue)[:most]

    def next_chunks(self, most_bytes: int) -> list[SendChunk]:
        """Return the next chunks, ending with the one that reaches *most_bytes*."""
        transfer, credit_bytes = self._sending(), self.credit_bytes
        if transfer is None or credit_bytes <= 0:
            return []
        chunks: list[SendChunk] = []
        partly_sent, is_landing = self._partly_sent, transfer is self._landing
        for row in transfer.queue:
            offset = partly_sent[1] if partly_sent is not None and partly_sent[0] == row else 0
            total = int(self._table.lengths[row])
            # Whole frames, but for the end of the segment or of the credit.
            whole_bytes = -(-most_bytes // MAX_CHUNK_BYTES) * MAX_CHUNK_BYTES
            length = min(total - offset, credit_bytes, whole_bytes)
            chunks.append(SendChunk(transfer.generation, row, offset, length, total, is_landing))
            credit_bytes -= length
            most_bytes -= length
            if credit_bytes <= 0 or most_bytes <= 0 or len(chunks) == _MAX_CHUNKS:
                break
        return chunks

    def chunks_sent(self, chunks: Sequence[SendChunk], now_s: float) -> None:
        """Record as sent the leading chunks of the newest :meth:`next_chunks`."""
        transfer = self._sending()
        assert transfer is not None
        if transfer is self._landing and not transfer.payload_bytes:
            self._observer.first_byte(now_s - transfer.received_s)
        for chunk in chunks:
            assert transfer.queue[0] == chunk.segment
            self.credit_bytes -= chunk.length
            self._sent_bytes += chunk.length
            transfer.payload_bytes += chunk.length
            end = chunk.offset + chunk.length
            self._partly_sent = (chunk.segment, end)
            if end == chunk.total:
                self._partly_sent = None
                transfer.queue.popleft()
                transfer.delivered += 1
                self._on_way.append((self._sent_bytes, chunk.segment))
        self._settle(now_s)

    def payload_failed(self, now_s: float) -> None:
        """Report as missing the segment of the first chunk of the newest :meth:`next_chunks`."""
        transfer = self._sending()
        assert transfer is not None
        self._partly_sent = None
        transfer.missing.append(transfer.queue.popleft())
        self._settle(now_s)

    def plan_sent(self, generation: int, now_s: float) -> None:
        """Record that the plan of a generation was handed to the socket."""
        self._observer.plan_sent(generation, now_s - self._received_s)

    def _settle(self, now_s: float) -> None:
        """Send ``ready`` if it is due."""
        landing = self._landing
        if landing is not None and not landing.queue:
            self._landing = None
            missing = hidden = None
            if landing.missing:
                missing = self._table.hashes[landing.missing]
                shown = landing.rows[~np.isin(landing.rows, landing.missing)]
                hidden = hidden_under(self._scene, shown)
            self._send(Ready(generation=landing.generation, missing=missing, hidden=hidden))
            self._observer.ready(
                landing.generation,
                segments=landing.delivered,
                payload_bytes=landing.payload_bytes,
                missing=len(landing.missing),
                seconds=now_s - landing.received_s,
            )
        self._note_stall()

    def _begin(self, wanted: Land | Prefetch) -> tuple[Ball, _Transfer]:
        """Choose what is shown, and queue what is neither at the client nor on its way (4)."""
        ball = choose(
            self._scene,
            wanted.position,
            wanted.radius_m,
            coarse_radius_m=wanted.coarse_radius_m,
            without=wanted.without,
            budgets=self._budgets,
        )
        # What has arrived is in `have`, where the client kept it. Not forgotten before: a landing
        # that was sent earlier may still wait for its plan.
        while self._on_way and self._on_way[0][0] <= wanted.taken_bytes:
            self._on_way.popleft()
        is_there = np.isin(self._table.hashes[ball.rows], wanted.have)
        is_there |= np.isin(ball.rows, [row for _, row in self._on_way])
        queue = ball.rows[~is_there].tolist()
        # A client drops the part of a segment that it has when another one begins.
        if self._partly_sent is not None:
            row = self._partly_sent[0]
            if row in queue:
                queue.remove(row)
                queue.insert(0, row)
            else:
                self._partly_sent = None
        return ball, _Transfer(wanted.generation, ball.rows, queue, received_s=self._received_s)

    def _sending(self) -> _Transfer | None:
        if self.landing_open:
            landing = self._landing
            return landing if landing is not None and landing.queue else None
        prefetch = self._prefetch
        return prefetch if prefetch is not None and prefetch.queue else None

    def _end(self, transfer: _Transfer, *, landing: bool) -> None:
        """Report the end of an unfinished landing or prefetch to the observer."""
        unsent_bytes = self._bytes_of(transfer.queue)
        if self._partly_sent is not None and self._partly_sent[0] in transfer.queue:
            unsent_bytes -= self._partly_sent[1]
        self._observer.superseded(transfer.generation, unsent_bytes, landing=landing)

    def _bytes_of(self, rows: Iterable[int]) -> int:
        return int(self._table.lengths[list(rows)].sum(dtype=np.int64))

    def _note_stall(self) -> None:
        stalled = self.credit_bytes <= 0 and self._sending() is not None
        self._observer.credit_stalled(stalled=stalled)
