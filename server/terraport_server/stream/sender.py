"""Carries out one session over one connection: messages in, plans, picks, messages and payload out.

Each client has one task, which waits for the end of the session. The connection calls
:meth:`Sender.receive` for each message; :meth:`Sender.pump` carries out what the session wants
until it has to wait: for its turn to plan, for its turn to send, for room in the socket, or for
payload that is not in memory. Whatever was waited for calls it again.

Memory per client is bounded: one frame and 64 KiB of messages in the writer, and
``max_pending_actions`` messages. A slow client costs itself only: nothing is planned for it until
it has taken what it was sent, and a newer landing replaces what was not sent yet.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final

from terraport_server.fair_queue import PlanQueue
from terraport_server.metrics import Metrics
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.interface import Close, MakePlan, RunPick, SendChunk, SendMessage
from terraport_server.session.session import Session
from terraport_server.stream.connection import REFUSED_CLOSE_S, Connection
from terraport_server.stream.frame_writer import message_header
from terraport_server.stream.scheduler import TURN_BYTES, Rank, SendScheduler, rank_of
from terraport_store import CorruptPayloadError, StoreError
from terraport_wire import (
    FRAME_HEADER_BYTES,
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

__all__ = ["Sender", "SenderLimits"]

_COMPARED_AS_BYTES: Final = 16 << 10
"""Bytes of a turn that comparing one segment with its hash counts as."""

_EVERYTHING_AHEAD: Final = 1 << 62
"""Bytes announced to the payload reader once it knows of the whole landing."""

_MAX_ANNOUNCED: Final = 512
"""Segments that are announced to the payload reader at once."""

_SHORTEST_TICK_S: Final = 0.002

PickRunner = Callable[[ServedScene, RunPick, str], Awaitable[Hit | None]]


@dataclass(frozen=True, slots=True)
class SenderLimits:
    """Limits of one sender; each is the setting of its name."""

    max_message_bytes: int
    max_pending_actions: int
    close_timeout_s: float


class _Frames:
    """Frames of one ``writev``."""

    __slots__ = ("_end", "_payload_end", "buffers", "ends", "payload_ends")

    def __init__(self) -> None:
        self.buffers: list[bytes | memoryview] = []
        self.ends: list[int] = []
        """Bytes on the wire up to the end of each frame."""
        self.payload_ends: list[int] = []
        self._end = self._payload_end = 0

    def add(self, chunk: SendChunk, view: memoryview, key: int) -> None:
        """Add the frames of a chunk."""
        generation, _, offset, length, total, _ = chunk
        buffers, end, payload_end = self.buffers, self._end, self._payload_end
        for at in range(0, length, MAX_CHUNK_BYTES):
            size = min(MAX_CHUNK_BYTES, length - at)
            header = message_header(FRAME_HEADER_BYTES + size)
            header += frame_header(generation=generation, key=key, offset=offset + at, total=total)
            buffers.append(header)
            buffers.append(view if size == length else view[at : at + size])
            end += len(header) + size
            payload_end += size
            self.ends.append(end)
            self.payload_ends.append(payload_end)
        self._end, self._payload_end = end, payload_end


class Sender:
    """Sender of one session.

    Parameters
    ----------
    connection
        Accepted.
    session
        The state machine.
    served
        The scene; the caller holds it while :meth:`run` runs.
    limits
    metrics
    scheduler, plans
        Shared by all senders of the event loop.
    run_pick
        Answers a pick.
    """

    def __init__(
        self,
        connection: Connection,
        session: Session,
        served: ServedScene,
        *,
        limits: SenderLimits,
        metrics: Metrics,
        scheduler: SendScheduler,
        plans: PlanQueue,
        run_pick: PickRunner,
    ) -> None:
        self.session = session
        self.client = ""
        """Name under which CPU time is charged, once it is authenticated."""
        self._connection = connection
        self._writer = connection.writer
        self._served = served
        self._limits = limits
        self._metrics = metrics
        self._scheduler = scheduler
        self._plans = plans
        self._run_pick = run_pick
        self._loop = asyncio.get_running_loop()
        self._over: asyncio.Future[None] = self._loop.create_future()
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_pumping = False
        self._is_waiting = False
        """Whether something that was asked for will call :meth:`pump`."""
        self._is_woken = False
        self._timer: asyncio.TimerHandle | None = None
        self._timer_due_s = 0.0
        self._is_closing = False
        is_copied = self._writer.descriptor < 0
        self._most_batch_bytes = MAX_CHUNK_BYTES if is_copied else TURN_BYTES
        self._batch_bytes = min(4 * MAX_CHUNK_BYTES, self._most_batch_bytes)
        """Payload of the next ``writev``: twice what the socket took last."""
        self._fetched: SendChunk | None = None
        """Chunk that was brought into memory last."""
        self._failed: tuple[int, int] | None = None
        """Generation and segment that could not be read; reported when the session asks again."""
        self._announced_generation = -1
        self._announced_bytes = 0
        """Payload announced to the reader and not sent yet."""
        self._generation = -1
        """Of the payload that was sent last."""
        self._generation_bytes = 0
        self._is_landing = True
        self._last_rank = Rank.LANDING

    async def run(self) -> None:
        """Serve until the connection or the session is over.

        Raises
        ------
        Exception
            A fault of ours.
        """
        self._set_timer()
        self._connection.deliver_to(self.receive)
        try:
            await self._over
        finally:
            self._connection.deliver_to(None)
            if self._timer is not None:
                self._timer.cancel()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def wake(self) -> None:
        """Call :meth:`pump` in the next loop iteration, after another caller used the session."""
        if not (self._is_woken or self._over.done()):
            self._is_woken = True
            self._loop.call_soon(self._on_woken)

    def receive(self, event: dict[str, Any]) -> bool:
        """Handle a message, or the end of the connection; return whether more may come now."""
        if event["type"] == "websocket.disconnect":
            self._end()
            return True
        if self.session.closing or self._over.done():
            return True
        text = event.get("text")
        data = event["bytes"] if text is None else text
        try:
            self._take(data, monotonic())
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)
        self.pump()
        self._set_timer()
        return self._has_room

    def pump(self) -> None:
        """Carry out the session's actions until one has to wait."""
        if self._is_pumping:
            return
        self._is_pumping = True
        try:
            while not (self._is_waiting or self._over.done()) and self._do_next():
                pass
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)
        self._is_pumping = False
        if not self._over.done() and self._has_room:
            self._connection.read_on()

    @property
    def _has_room(self) -> bool:
        return self.session.pending < self._limits.max_pending_actions

    def _take(self, data: bytes | str, now_s: float) -> None:
        try:
            most_bytes = self._limits.max_message_bytes
            message = decode(data, Direction.CLIENT_TO_SERVER, max_bytes=most_bytes)
        except DecodeError as error:
            self.session.refuse(error, now_s)
        else:
            self.session.receive(message, now_s)

    def _do_next(self) -> bool:
        """Carry out one action; False where there is none."""
        writer = self._writer
        if writer.is_full:
            self._is_waiting = True
            writer.when_writable(self._go_on)
            return False
        if not writer.is_writable:
            return False  # closing: the end is reported by the connection
        action = self.session.next_action()
        if action is None:
            writer.flush()
            return False
        if isinstance(action, SendChunk):
            self._is_waiting = True
            self._scheduler.ask(self._rank(action), self._burst)
        elif isinstance(action, SendMessage):
            self._send_message(action.message)
        elif isinstance(action, MakePlan):
            writer.flush()
            self._is_waiting = True
            self._plans.ask(self.client, self._plan, self._go_on)
        elif isinstance(action, RunPick):
            self._start(self._pick(action))
        else:
            self._close(action)
        return True

    def _go_on(self) -> None:
        """Continue after a wait."""
        self._is_waiting = False
        self.pump()

    def _on_woken(self) -> None:
        self._is_woken = False
        if not self._over.done():
            self.pump()
            self._set_timer()

    def _end(self, error: Exception | None = None) -> None:
        if self._over.done():
            return
        if error is None:
            self._over.set_result(None)
        else:
            self._over.set_exception(error)

    def _start(self, work: Any) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # Messages, plans and picks.

    def _send_message(self, message: Message) -> None:
        self._writer.send_message(encode(message))
        if isinstance(message, Plan):
            self.session.plan_sent(message.generation, monotonic())

    def _plan(self) -> None:
        if self._over.done():
            return
        try:
            self.session.make_plan(monotonic())
            self._set_timer()
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)

    async def _pick(self, action: RunPick) -> None:
        try:
            hit = await self._run_pick(self._served, action, self.client)
        except Exception as error:  # noqa: BLE001 - logged; the session continues
            self._metrics.picks.labels("failed").inc()
            self._served.tell_failure("pick failed", None, error, level=logging.WARNING)
            self.session.pick_failed(action.request)
        else:
            self._metrics.picks.labels("miss" if hit is None else "hit").inc()
            self.session.picked(action.request, hit)
        self.pump()

    def _close(self, action: Close) -> None:
        if not self.session.is_open:  # was never authenticated
            self._connection.close_within(REFUSED_CLOSE_S)
        self._connection.close(int(action.code), str(action.reason))
        self._end()

    # Payload.

    def _rank(self, chunk: SendChunk) -> Rank:
        is_new = chunk.generation != self._generation
        return rank_of(
            landing=chunk.landing,
            sent_bytes=0 if is_new else self._generation_bytes,
            next_bytes=chunk.length,
            rest_bytes=chunk.total - chunk.offset,
        )

    def _burst(self) -> tuple[int, Rank | None]:
        """Send payload until the turn is over, the socket is full, or something else goes first."""
        used_bytes, rank = 0, None
        try:
            used_bytes, rank = self._send_turn()
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)
        if rank is None and not self._is_waiting:
            self.pump()
        return used_bytes, rank

    def _send_turn(self) -> tuple[int, Rank | None]:
        writer, sent_bytes, compared_bytes = self._writer, 0, 0
        self._is_waiting, chunks = False, []
        while (
            sent_bytes + compared_bytes < TURN_BYTES
            and writer.is_writable
            and not self._over.done()
        ):
            chunks = self.session.next_chunks(self._batch_bytes)
            frames = _Frames()
            if chunks and not self._has_failed(chunks[0]):
                compared_bytes += _COMPARED_AS_BYTES * self._frame(chunks, frames)
            if not frames.ends:
                chunks = []
                break
            taken = writer.send_frames(frames.buffers, frames.ends)
            if taken:
                payload_bytes = frames.payload_ends[taken - 1]
                self._note_sent(chunks, payload_bytes)
                sent_bytes += payload_bytes
                self._batch_bytes = min(self._most_batch_bytes, 2 * payload_bytes)
        if sent_bytes:
            is_landing = self._is_landing
            (self._metrics.land_bytes if is_landing else self._metrics.prefetch_bytes).inc(
                sent_bytes
            )
        if chunks:
            self._last_rank = self._rank(chunks[0])
        if writer.is_full:
            self._is_waiting = True
            writer.when_writable(self._ask_again)
        elif chunks and writer.is_writable:
            self._is_waiting = True
            return sent_bytes + compared_bytes, self._last_rank
        return sent_bytes + compared_bytes, None

    def _ask_again(self) -> None:
        """Ask for another turn: the socket has room, or the client is gone."""
        if self._writer.is_writable:
            self._scheduler.ask(self._last_rank, self._burst)
        else:
            self._go_on()

    def _has_failed(self, chunk: SendChunk) -> bool:
        """Report a segment that could not be read."""
        failed, self._failed = self._failed, None
        if (chunk.generation, chunk.segment) != failed:
            return False
        self._announced_bytes -= chunk.total - chunk.offset
        self.session.payload_failed(monotonic())
        return True

    def _frame(self, chunks: list[SendChunk], frames: _Frames) -> int:
        """Add frames of chunks up to the first that is not in memory; count compared segments."""
        reader, hashes = self._served.payloads, self._served.hashes
        if reader.ahead_bytes:
            self._announce(chunks[0])
        views, compared = reader.views(
            chunks,
            by_system_call=self._writer.descriptor >= 0,
            fetched=self._fetched,
        )
        if not views:
            self._is_waiting = True
            self._start(self._fetch(chunks[0]))
        for chunk, view in zip(chunks, views, strict=False):
            frames.add(chunk, view, hashes[chunk.segment])
        return compared

    def _note_sent(self, chunks: list[SendChunk], sent_bytes: int) -> None:
        """Report the first bytes of chunks as sent."""
        left_bytes, sent = sent_bytes, []
        for chunk in chunks:
            sent.append(chunk if chunk.length <= left_bytes else chunk._replace(length=left_bytes))
            left_bytes -= chunk.length
            if left_bytes <= 0:
                break
        first = chunks[0]
        if first.generation != self._generation:
            self._generation, self._generation_bytes = first.generation, 0
        self._generation_bytes += sent_bytes
        self._is_landing = first.landing
        self._announced_bytes -= sent_bytes
        self.session.chunks_sent(sent, monotonic())

    def _announce(self, chunk: SendChunk) -> None:
        """Let the reader fetch what follows from storage, in pieces that it can fetch together."""
        if chunk.generation != self._announced_generation:
            self._announced_generation, self._announced_bytes = chunk.generation, 0
        payloads = self._served.payloads
        if self._announced_bytes <= payloads.ahead_bytes // 2:
            coming = self.session.upcoming(_MAX_ANNOUNCED)
            known_bytes = payloads.expect(coming)
            is_rest = known_bytes < payloads.ahead_bytes
            self._announced_bytes = _EVERYTHING_AHEAD if is_rest else known_bytes

    async def _fetch(self, chunk: SendChunk) -> None:
        """Wait until a chunk is in memory, or record that it cannot be read; then continue."""
        self._metrics.payload_reads.inc()
        try:
            coming = self.session.upcoming(_MAX_ANNOUNCED)[1:]
            await self._served.payloads.fetch(chunk, coming)
            self._fetched = chunk
        except (StoreError, OSError) as error:
            self._note_failure(chunk, error)
            # Of this generation alone: a later landing reads it again.
            self._failed = chunk.generation, chunk.segment
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)
        self._go_on()

    def _note_failure(self, chunk: SendChunk, error: Exception) -> None:
        event = "segment_corrupt" if isinstance(error, CorruptPayloadError) else "segment_lost"
        landing = f"{self.session.id}-{chunk.generation}"
        self._served.tell_failure(event, chunk.segment, error, landing=landing)
        self._metrics.corrupt_segments.labels(self._metrics.scene_label(self._served.id)).inc()

    # Time.

    def _set_timer(self) -> None:
        """Set the timer to the session's next deadline, or to the end of closing."""
        if self._is_closing or self._over.done():
            return
        now_s = monotonic()
        if self.session.closing:
            self._is_closing = True
            due_s = now_s + self._limits.close_timeout_s
        else:
            due_s = self.session.wake_at_s()
            if self._timer is not None and due_s >= self._timer_due_s:
                return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_due_s = due_s
        self._timer = self._loop.call_later(max(_SHORTEST_TICK_S, due_s - now_s), self._tick)

    def _tick(self) -> None:
        self._timer = None
        if self._is_closing:  # the client does not read what is left
            self._connection.abort()
            return
        self.session.heard(self._connection.heard_s)
        try:
            self.session.tick(monotonic())
        except Exception as error:  # noqa: BLE001 - ends the session
            self._end(error)
        self.pump()
        self._set_timer()
