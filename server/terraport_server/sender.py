"""Carries out one session over one WebSocket: the only place where it meets the network.

Three tasks per client, all owned by :meth:`Sender.run`: one reads messages into the session, one
carries out what the session wants, one watches the clock. Memory per client is bounded: one frame
in the transport where frames go through it, ``max_pending_actions`` messages, and what uvicorn
holds of one incoming message. Payload goes from the page cache to the socket.

A slow client costs itself only: its frames wait in its own task, the session goes on planning, and
a newer landing replaces what was not sent yet.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from terraport_server.actions import Close, RunPick, SendChunk, SendMessage
from terraport_server.logs import log
from terraport_server.metrics import Metrics
from terraport_server.scenes import ServedScene
from terraport_server.session import Session
from terraport_server.transport import connection_of
from terraport_store import CorruptPayloadError, PayloadRange, StoreError
from terraport_wire import (
    DecodeError,
    Direction,
    Hit,
    Message,
    Plan,
    Subprotocol,
    decode,
    encode,
    frame_header,
)

__all__ = ["Priorities", "Sender", "SenderLimits"]

_YIELD_S: Final = 0.001
"""How long an aim's chunk waits before it looks again whether a landing is being sent."""

_SHORTEST_TICK_S: Final = 0.002

_MOST_AHEAD: Final = 512
"""Segments that are looked at for fetching ahead; their bytes are bounded by the desk."""

PickRunner = Callable[[ServedScene, RunPick], Awaitable[Hit | None]]


class Priorities:
    """Shared by all senders of a process: landings before aims.

    Counts the landing chunks that are on their way to a socket at this moment. A landing that waits
    for its client's credit does not count: it does not use what an aim would.
    """

    def __init__(self) -> None:
        self.landing_chunks = 0


@dataclass(frozen=True, slots=True)
class SenderLimits:
    """What bounds one sender."""

    max_message_bytes: int
    max_pending_actions: int
    close_timeout_s: float


class Sender:
    """One client's connection.

    Parameters
    ----------
    websocket
        Accepted.
    subprotocol
        As negotiated.
    session
        The state machine.
    served
        The scene; held by the caller while this runs.
    limits
        Bounds.
    metrics
        Counters.
    priorities
        Shared with the other senders of the process.
    run_pick
        Answers picks.
    """

    def __init__(
        self,
        websocket: WebSocket,
        subprotocol: Subprotocol,
        session: Session,
        served: ServedScene,
        *,
        limits: SenderLimits,
        metrics: Metrics,
        priorities: Priorities,
        run_pick: PickRunner,
    ) -> None:
        self.session = session
        self._websocket = websocket
        self._subprotocol = subprotocol
        self._served = served
        self._limits = limits
        self._metrics = metrics
        self._priorities = priorities
        self._run_pick = run_pick
        self._connection = connection_of(websocket.scope)
        self._loop = asyncio.get_running_loop()
        self._wake = asyncio.Event()
        self._room = asyncio.Event()
        self._sooner = asyncio.Event()
        self._next_tick_s = 0.0
        self._picks: set[asyncio.Task[None]] = set()
        self._failed: int | None = None
        """Segment that could not be fetched; told to the session when it asks for it again."""
        self._ahead_generation = -1
        self._ahead_segment = -1
        self._ahead_bytes = 0
        """What the desk was told of and was not sent yet."""

    async def run(self) -> None:
        """Serve until the connection is over; returns also when the client vanishes.

        Cancelling it drops the connection. Nothing it started outlives it.
        """
        watcher = asyncio.create_task(self._watch())
        tasks = {asyncio.create_task(self._read()), asyncio.create_task(self._act()), watcher}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except WebSocketDisconnect:
            pass
        finally:
            for task in tasks | self._picks:
                task.cancel()
            await asyncio.gather(*tasks, *self._picks, return_exceptions=True)

    def wake(self) -> None:
        """Look at the session again: something was told to it from outside."""
        self._wake.set()
        self._sooner.set()

    async def _read(self) -> None:
        while True:
            event = await self._websocket.receive()
            if event["type"] == "websocket.disconnect":
                return
            text = event.get("text")
            self._take(event["bytes"] if text is None else text)
            while self.session.pending >= self._limits.max_pending_actions:
                self._room.clear()
                await self._room.wait()

    def _take(self, data: bytes | str) -> None:
        now_s = self._loop.time()
        try:
            message = decode(
                data,
                self._subprotocol,
                Direction.CLIENT_TO_SERVER,
                max_bytes=self._limits.max_message_bytes,
            )
        except DecodeError as error:
            self.session.refuse(error, now_s)
        else:
            self.session.receive(message, now_s)
        self._wake.set()
        if self.session.closing or self.session.wake_at_s() < self._next_tick_s:
            self._sooner.set()

    async def _watch(self) -> None:
        """Tick when something is due; drop a client that takes too long to close."""
        while not self.session.closing:
            self._hear()
            self._sooner.clear()
            self._next_tick_s = self.session.wake_at_s()
            wait_s = max(_SHORTEST_TICK_S, self._next_tick_s - self._loop.time())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await self._sooner.wait()
            self._hear()
            self.session.tick(self._loop.time())
            self._wake.set()
        await asyncio.sleep(self._limits.close_timeout_s)
        if self._connection is not None:
            self._connection.abort()

    def _hear(self) -> None:
        if self._connection is not None:
            self.session.heard(self._connection.heard_s)

    async def _act(self) -> None:
        while True:
            action = self.session.next_action()
            self._room.set()
            if action is None:
                self._wake.clear()
                await self._wake.wait()
            elif isinstance(action, SendChunk):
                await self._send_chunk(action)
            elif isinstance(action, SendMessage):
                await self._send_message(action.message)
            elif isinstance(action, RunPick):
                self._start_pick(action)
            else:
                await self._close(action)
                return

    async def _send_chunk(self, chunk: SendChunk) -> None:
        if not chunk.landing and self._priorities.landing_chunks:
            await asyncio.sleep(_YIELD_S)
            return  # and ask again: a landing of this client may have come too
        session, desk = self.session, self._served.desk
        if self._failed == chunk.segment:
            self._failed = None
            session.payload_failed(chunk, self._loop.time())
            return
        if desk.ahead_bytes:
            self._look_ahead(chunk)
        connection = self._connection
        as_file = connection is not None and connection.takes_files
        part = desk.part(chunk, session.encoding, as_file=as_file)
        if part is None:
            await self._fetch(chunk)
            return
        header = frame_header(
            generation=chunk.generation,
            segment=chunk.segment,
            offset=chunk.offset,
            total=chunk.total,
            length=chunk.length,
        )
        session.chunk_sent(chunk, self._loop.time())
        counted = self._metrics.land_bytes if chunk.landing else self._metrics.aim_bytes
        counted.inc(chunk.length)
        self._priorities.landing_chunks += chunk.landing
        try:
            await self._send_part(chunk, header, part)
            # The send does not suspend while the socket keeps up: without this, one fast client
            # would hold everybody else, and its own next message, until its landing is whole.
            await asyncio.sleep(0)
        finally:
            self._priorities.landing_chunks -= chunk.landing

    def _look_ahead(self, chunk: SendChunk) -> None:
        """Let the desk fetch what follows, so much at a time that neighbours go together."""
        if chunk.generation != self._ahead_generation:
            self._ahead_generation, self._ahead_bytes, self._ahead_segment = chunk.generation, 0, -1
        if chunk.segment == self._ahead_segment:
            return
        self._ahead_segment = chunk.segment
        self._ahead_bytes -= chunk.total
        desk = self._served.desk
        if self._ahead_bytes <= desk.ahead_bytes // 2:
            coming = self.session.upcoming(_MOST_AHEAD)
            self._ahead_bytes = desk.expect(coming, self.session.encoding)

    async def _fetch(self, chunk: SendChunk) -> None:
        """Wait until the chunk can be sent, or note that it cannot; then ask the session again.

        Meanwhile the client may want something else.
        """
        self._metrics.payload_reads.inc()
        try:
            await self._served.desk.fetch(chunk, self.session.encoding)
        except (StoreError, OSError) as error:
            self._tell_failure(chunk, error)
            self._failed = chunk.segment

    def _tell_failure(self, chunk: SendChunk, error: Exception) -> None:
        event = "segment_corrupt" if isinstance(error, CorruptPayloadError) else "segment_lost"
        log(
            event,
            level=logging.ERROR,
            landing=f"{self.session.id}-{chunk.generation}",
            scene=self._served.id,
            version=self._served.version,
            segment=chunk.segment,
            reason=str(error),
        )
        self._metrics.corrupt_segments.labels(self._metrics.scene_label(self._served.id)).inc()

    async def _send_part(
        self, chunk: SendChunk, header: bytes, part: PayloadRange | memoryview
    ) -> None:
        """Send one chunk by the shortest way that this connection has."""
        connection = self._connection
        if connection is None:
            assert isinstance(part, memoryview)
            await self._websocket.send_bytes(header + part)
        elif isinstance(part, memoryview):
            await connection.send_parts(header, part)
        else:
            try:
                await connection.send_file(header, part)
            except OSError as error:
                # The frame was begun: the connection is gone. Who comes back is told more.
                self._served.desk.distrust(chunk.segment)
                self._tell_failure(chunk, error)
                raise WebSocketDisconnect(1006) from error

    async def _send_message(self, message: Message) -> None:
        data = encode(message, self._subprotocol)
        if isinstance(data, str):
            await self._websocket.send_text(data)
        else:
            await self._websocket.send_bytes(data)
        if isinstance(message, Plan):
            self.session.plan_sent(message.generation, self._loop.time())

    async def _close(self, action: Close) -> None:
        await self._websocket.close(int(action.code), str(action.reason))

    def _start_pick(self, action: RunPick) -> None:
        task = asyncio.create_task(self._answer_pick(action))
        self._picks.add(task)
        task.add_done_callback(self._picks.discard)

    async def _answer_pick(self, action: RunPick) -> None:
        try:
            hit = await self._run_pick(self._served, action)
        except Exception as error:  # noqa: BLE001 - told to the operator; the session goes on
            self._metrics.picks.labels("failed").inc()
            log("pick failed", level=logging.WARNING, session=self.session.id, reason=repr(error))
            self.session.pick_failed(action.request)
        else:
            self._metrics.picks.labels("miss" if hit is None else "hit").inc()
            self.session.picked(action.request, hit)
        self._wake.set()
