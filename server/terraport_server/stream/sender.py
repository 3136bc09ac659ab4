"""Carries out one session over one WebSocket: the only place where it meets the network.

Two tasks per client, owned by :meth:`Sender.run`, and a clock: one reads messages into the session,
one carries out what the session wants. Memory per client is bounded: one frame and 64 KiB of
messages in the transport, ``max_pending_actions`` messages, and what uvicorn holds of one incoming
message. Payload goes from the page cache through one buffer for all to the socket.

A slow client costs itself only: its frames wait in its own task, nothing is planned for it until it
has taken what it was sent, and a newer landing replaces what was not sent yet.

Times come from ``time.monotonic``; the loop's own are those of its last step, in milliseconds.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from time import monotonic, thread_time
from typing import Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from terraport_server.metrics import Metrics
from terraport_server.peer_limits import REFUSED_CLOSE_S
from terraport_server.read_buffer import ReadBuffer
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.interface import Close, MakePlan, RunPick, SendChunk, SendMessage
from terraport_server.session.session import Session
from terraport_server.stream.client_turns import ClientTurns
from terraport_server.stream.pick_tasks import PickTasks
from terraport_server.stream.priced_queue import Account
from terraport_server.stream.scheduler import Pause, Rank, Turns, rank_of
from terraport_server.stream.session_clock import SessionClock
from terraport_server.stream.signals import Signal
from terraport_server.transport import MAX_FRAMES, connection_of
from terraport_store import CorruptPayloadError, StoreError
from terraport_wire import (
    MAX_CHUNK_BYTES,
    DecodeError,
    Direction,
    Hit,
    Message,
    Plan,
    decode,
    encode,
    frame_header,
)

__all__ = ["LARGEST_BATCH_BYTES", "Sender", "SenderLimits"]

LARGEST_BATCH_BYTES: Final = 4 * MAX_CHUNK_BYTES
"""Of payload in one call, and less than a chunk: still in the processor's cache when it is sent."""

_COMPARED_AS_BYTES: Final = 16 << 10
"""Of a turn: as many bytes are sent while one segment is compared that was never sent."""

_ALL_TOLD: Final = 1 << 62
"""Bytes ahead of a landing whose every segment the desk has heard of."""

_MOST_AHEAD: Final = 512
"""Segments that are looked at for fetching ahead; their bytes are bounded by the desk."""

PickRunner = Callable[[ServedScene, RunPick, Account], Awaitable[Hit | None]]


@dataclass(frozen=True, slots=True)
class SenderLimits:
    """Bounds of one sender; each is the setting of its name."""

    max_message_bytes: int
    max_pending_actions: int
    max_burst_bytes: int
    close_timeout_s: float


class Sender:
    """One client's connection.

    Parameters
    ----------
    websocket
        Accepted.
    session
        The state machine.
    served
        The scene; held by the caller while this runs.
    limits
        Bounds.
    metrics
        Counters.
    turns, client_turns
        Shared with the other senders of the process.
    read_buffer
        Shared with the other senders of the event loop.
    run_pick
        Answers picks.
    """

    def __init__(
        self,
        websocket: WebSocket,
        session: Session,
        served: ServedScene,
        *,
        limits: SenderLimits,
        metrics: Metrics,
        turns: Turns,
        client_turns: ClientTurns,
        read_buffer: ReadBuffer,
        run_pick: PickRunner,
    ) -> None:
        self.session = session
        self._websocket = websocket
        self._served = served
        self._limits = limits
        self._metrics = metrics
        self._turns = turns
        self._client_turns = client_turns
        self._read_buffer = read_buffer
        self._batch_bytes = MAX_CHUNK_BYTES
        """What the next batch may have: grows while the socket takes all."""
        self._connection = connection_of(websocket.scope)
        self._account = Account() if self._connection is None else self._connection.account
        self._wake = Signal()
        self._room = Signal()
        self._clock = SessionClock(
            session, self._connection, limits.close_timeout_s, self._wake.set
        )
        line = Account()
        self._picks = PickTasks(
            session,
            metrics,
            lambda action: run_pick(served, action, line),
            self._wake.set,
            lambda error: served.tell_failure("pick failed", None, error, level=logging.WARNING),
        )
        self._fetched: SendChunk | None = None
        """What was fetched last."""
        self._failed: int | None = None
        """Segment that could not be fetched; told to the session when it asks for it again."""
        self._ahead_generation = -1
        self._ahead_bytes = 0
        """What the desk was told of and was not sent yet."""
        self._absent: SendChunk | None = None
        """What has to be fetched before it can be sent."""
        self._under_way = SendChunk(-1, 0, 0, 0, 0, landing=False)
        """What was sent last."""
        self._generation_bytes = 0
        """Payload bytes sent for its generation."""

    async def run(self) -> None:
        """Serve until the connection is over; returns also when the client vanishes.

        Cancelling it drops the connection. Nothing it started outlives it.
        """
        tasks = {asyncio.create_task(self._read()), asyncio.create_task(self._act())}
        self._clock.look()
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except WebSocketDisconnect:
            pass
        finally:
            for task in tasks | self._picks.tasks:
                task.cancel()
            await asyncio.gather(*tasks, *self._picks.tasks, return_exceptions=True)
            self._clock.stop()

    def wake(self) -> None:
        """Look at the session again: something was told to it from outside."""
        self._wake.set()
        self._clock.look()

    async def _read(self) -> None:
        while True:
            event = await self._websocket.receive()
            if event["type"] == "websocket.disconnect":
                return
            if self.session.closing:
                continue  # it was answered for good: nothing more of it is looked at
            text = event.get("text")
            self._take(event["bytes"] if text is None else text)
            while self.session.pending >= self._limits.max_pending_actions:
                self._room.clear()
                await self._room.wait()

    def _take(self, data: bytes | str) -> None:
        now_s, began_s = monotonic(), thread_time()
        try:
            most_bytes = self._limits.max_message_bytes
            message = decode(data, Direction.CLIENT_TO_SERVER, max_bytes=most_bytes)
        except DecodeError as error:
            self.session.refuse(error, now_s)
        else:
            self.session.receive(message, now_s)
        self._client_turns.book(self._account, began_s)
        self._wake.set()
        self._clock.look()

    async def _act(self) -> None:
        while True:
            action = self.session.next_action()
            self._room.set()
            if self._clock.fault is not None:
                raise self._clock.fault
            if action is None:
                await self._until_woken()
            elif isinstance(action, SendChunk):
                await self._send_chunks(action)
            elif isinstance(action, SendMessage):
                await self._send_message(action.message)
            elif isinstance(action, MakePlan):
                await self._take_plan_turn()
            elif isinstance(action, RunPick):
                self._picks.start(action)
            else:
                await self._close(action)
                return

    async def _until_woken(self) -> None:
        self._flush()
        self._wake.clear()
        await self._wake.wait()

    def _flush(self) -> None:
        """Send messages that wait for payload to go with; before anything that may take a wait."""
        if self._connection is not None:
            self._connection.flush()

    async def _take_plan_turn(self) -> None:
        """Plan in this client's turn: one that does not read has one plan, in its transport."""
        self._flush()
        if self._connection is None or await self._connection.until_clear():
            await self._client_turns.take(self._account, self._make_plan)
        else:  # closing: what the client says last ends this sender
            await self._until_woken()

    def _make_plan(self) -> int:
        looked_at = self.session.make_plan(monotonic())
        self._clock.look()
        return looked_at

    async def _send_chunks(self, chunk: SendChunk) -> None:
        """Send payload until the session wants something else, or the client takes no more."""
        connection = self._connection
        if connection is None:
            await self._turns.take(self._rank(chunk), self._look)
            await self._send_plainly()
        elif await connection.until_clear():
            if self._turns.is_busy:
                connection.flush()
            await self._turns.take(self._rank(chunk), self._burst)
            connection.flush()
        else:  # closing: what the client says last ends this sender
            await self._until_woken()
        if self._absent is not None:
            absent, self._absent = self._absent, None
            await self._fetch(absent)

    def _burst(self) -> Rank | Pause | None:
        """Hand chunks to the socket; what is left of them, by rank.

        Batch by batch, each in one call and twice as large as the one before while the socket takes
        all: nothing is made ready that has no room. What a client says is read after the turn.
        """
        connection = self._connection
        assert connection is not None
        left_bytes = self._limits.max_burst_bytes
        has_room = connection.is_clear
        while has_room:
            chunks, frames, compared = self._next_frames(min(self._batch_bytes, left_bytes))
            if not frames:
                return None
            left_bytes -= compared * _COMPARED_AS_BYTES
            sent = connection.send_frames(frames)
            left_bytes -= self._note_sent(chunks[:sent])
            has_room = connection.is_clear
            if not has_room:
                self._batch_bytes = MAX_CHUNK_BYTES
                left = self.session.next_chunks(1)
                return Pause(self._rank(left[0]), connection.when_clear) if left else None
            self._batch_bytes = min(2 * self._batch_bytes, LARGEST_BATCH_BYTES)
            if left_bytes < MAX_CHUNK_BYTES:
                return self._rank(chunks[0])
        return None

    def _next_frames(
        self, most_bytes: int
    ) -> tuple[list[SendChunk], list[tuple[bytes, memoryview]], int]:
        """Make frames of the next chunks, none where others come first; count compared segments."""
        session, desk, connection = self.session, self._served.desk, self._connection
        chunks = session.next_chunks(most_bytes)[:MAX_FRAMES]
        if not chunks:
            return [], [], 0
        if chunks[0].segment == self._failed:
            self._failed = None
            self._ahead_bytes -= chunks[0].total - chunks[0].offset
            session.payload_failed(chunks[0], monotonic())
            return [], [], 0
        if desk.ahead_bytes:
            self._look_ahead(chunks[0])
        is_direct = connection is not None and connection.is_direct
        room, encoding = self._read_buffer, session.encoding
        payloads, compared = desk.payloads(chunks, encoding, room, as_file=is_direct)
        # In here bytes stay only until the next call: for a socket that takes them at once.
        views = room.fill(payloads, fetched=chunks[0] == self._fetched)
        if not views:
            self._absent = chunks[0]
        frames = []
        for (generation, segment, offset, length, total, _), view in zip(
            chunks, views, strict=False
        ):
            header = frame_header(
                generation=generation, segment=segment, offset=offset, total=total, length=length
            )
            frames.append((header, view))
        return chunks, frames, compared

    def _note_sent(self, chunks: list[SendChunk]) -> int:
        """Book chunks as sent, the last one perhaps in part; return their bytes."""
        self.session.chunks_sent(chunks, monotonic())
        last = chunks[-1]
        sent_bytes = sum(chunk.length for chunk in chunks)
        (self._metrics.land_bytes if last.landing else self._metrics.aim_bytes).inc(sent_bytes)
        if last.generation != self._under_way.generation:
            self._generation_bytes = 0
        self._generation_bytes += sent_bytes
        self._ahead_bytes -= sent_bytes
        self._under_way = last
        return sent_bytes

    def _rank(self, chunk: SendChunk) -> Rank:
        is_new = chunk.generation != self._under_way.generation
        return rank_of(
            landing=chunk.landing,
            sent_bytes=0 if is_new else self._generation_bytes,
            next_bytes=chunk.length,
            rest_bytes=chunk.total - chunk.offset,
        )

    def _look(self) -> None:
        """Take a turn and send afterwards: for a connection that cannot send without waiting."""

    async def _send_plainly(self) -> None:
        chunks, frames, _ = self._next_frames(1)
        if frames:
            header, payload = frames[0]
            self._note_sent(chunks[:1])
            await self._websocket.send_bytes(header + payload)

    def _look_ahead(self, chunk: SendChunk) -> None:
        """Let the desk fetch what follows, so much at a time that neighbours go together."""
        if chunk.generation != self._ahead_generation:
            self._ahead_generation, self._ahead_bytes = chunk.generation, 0
        desk = self._served.desk
        if self._ahead_bytes <= desk.ahead_bytes // 2:
            coming = self.session.upcoming(_MOST_AHEAD)
            told_bytes = desk.expect(coming, self.session.encoding)
            # Less than asked for: that was all, and there is nothing more to tell.
            self._ahead_bytes = told_bytes if told_bytes >= desk.ahead_bytes else _ALL_TOLD

    async def _fetch(self, chunk: SendChunk) -> None:
        """Wait until the chunk can be sent, or note that it cannot; then ask the session again.

        Meanwhile the client may want something else.
        """
        self._metrics.payload_reads.inc()
        try:
            coming = self.session.upcoming(_MOST_AHEAD)[1:]
            await self._served.desk.fetch(chunk, self.session.encoding, coming)
            self._fetched = chunk
        except (StoreError, OSError) as error:
            self._tell_failure(chunk, error)
            self._failed = chunk.segment

    def _tell_failure(self, chunk: SendChunk, error: Exception) -> None:
        event = "segment_corrupt" if isinstance(error, CorruptPayloadError) else "segment_lost"
        landing = f"{self.session.id}-{chunk.generation}"
        self._served.tell_failure(event, chunk.segment, error, landing=landing)
        self._metrics.corrupt_segments.labels(self._metrics.scene_label(self._served.id)).inc()

    async def _send_message(self, message: Message) -> None:
        if self._connection is None:
            await self._websocket.send_bytes(encode(message))
        elif await self._connection.until_clear():
            self._connection.send_message(encode(message))
        if isinstance(message, Plan):
            self.session.plan_sent(message.generation, monotonic())

    async def _close(self, action: Close) -> None:
        self._flush()
        self._clock.look()
        if self._connection is not None and self.session.transfers is None:  # was never let in
            self._connection.leave_within(REFUSED_CLOSE_S)
        await self._websocket.close(int(action.code), str(action.reason))
