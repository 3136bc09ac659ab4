"""A client for trials with many of them: little CPU, and it believes nothing.

Everything the protocol promises about one connection is checked as it arrives (hashes, order, gaps,
generations, plans against brute force); what is wrong goes into a list, it is never raised, so that
one finding does not hide the next.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import xxhash
from parts.expected_plan import differences, expect
from websockets.client import ClientProtocol
from websockets.frames import Frame as WebSocketFrame
from websockets.frames import Opcode
from websockets.http11 import Response
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from terraport_store import SegmentIndex
from terraport_wire import (
    MAX_HAVE,
    MAX_PLAN_SEGMENTS,
    SUBPROTOCOL,
    Budgets,
    Credit,
    Direction,
    Frame,
    Hello,
    Land,
    Message,
    Notice,
    Plan,
    Ready,
    Welcome,
    decode,
    decode_frame,
    encode,
    is_payload,
)

__all__ = ["Findings", "LightClient", "LostError", "ReadyLanding"]

_READ_BYTES: Final = 1 << 16


class LostError(Exception):
    """The connection ended, or was refused, where an answer was due."""


@dataclass(frozen=True, slots=True)
class ReadyLanding:
    """A landing that became ready."""

    began_s: float
    """On the monotonic clock."""
    took_s: float


@dataclass
class Findings:
    """What all clients of a trial found, and how much they did."""

    wrong: list[str] = field(default_factory=list)
    """Everything that the protocol forbids; must stay empty."""
    lost: int = 0
    """Segments of a ready plan that never came."""
    repeated: int = 0
    """Segments, or parts of one, that were sent though the client had them."""
    plans: int = 0
    plans_checked: int = 0
    landings: int = 0
    """Landings that became ready."""
    superseded: int = 0
    """Landings that were given up for another."""
    cuts: int = 0
    connections: int = 0
    segments: int = 0
    payload_bytes: int = 0
    ready: list[ReadyLanding] = field(default_factory=list)
    """Of clients that read as fast as they can."""
    first_s: list[float] = field(default_factory=list)
    """Land to the first payload frame, of the same."""

    def say(self, what: str) -> None:
        """Note a broken promise of the service; the trial goes on."""
        self.wrong.append(what)


class LightClient:
    """One WebSocket connection on asyncio, over the sans-I/O core of ``websockets``.

    Parameters
    ----------
    url : str
        ``http://HOST:PORT/scenes/ID``.
    index : SegmentIndex
        Of the scene that is served: what plans and payloads are compared with.
    findings : Findings
        Shared by all clients.
    name : str
        For the findings.
    credit_bytes : int
        First credit; what arrives is granted back, half of it at a time.
    bytes_per_s : float, optional
        Read no faster than that.
    check_plan : callable, optional
        Tells whether to compare the next plan with brute force; every plan without it.
    token : str, optional
        Shown in hello.
    """

    def __init__(
        self,
        url: str,
        index: SegmentIndex,
        findings: Findings,
        *,
        name: str,
        credit_bytes: int = 16 << 20,
        bytes_per_s: float | None = None,
        check_plan: Callable[[], bool] = lambda: True,
        token: str | None = None,
    ) -> None:
        self._uri = parse_uri(url.replace("http", "ws", 1) + "/stream")
        self._index = index
        self._findings = findings
        self._name = name
        self._credit_bytes = credit_bytes
        self._bytes_per_s = bytes_per_s
        self._check_plan = check_plan
        self._token = token
        self.held = np.zeros(len(index), dtype=np.bool_)
        self.shown = np.zeros(len(index), dtype=np.bool_)
        self._socket: socket.socket | None = None
        self._generation = 0
        self._segments = {key: segment for segment, key in enumerate(index.xxh3.tolist())}

    async def connect(self) -> Welcome:
        """Connect and say hello."""
        loop = asyncio.get_running_loop()
        self._socket = raw = socket.socket()
        raw.setblocking(False)
        if self._bytes_per_s is not None:
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        await loop.sock_connect(raw, (self._uri.host, self._uri.port))
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # All that belongs to one connection starts anew; what is held stays.
        self._protocol = ClientProtocol(
            self._uri, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=None
        )
        self._events: deque[Any] = deque()
        self._part: tuple[int, bytearray] | None = None
        """Segment that is under way."""
        self._queue: list[int] = []
        """Segments that are still to come, in order."""
        self._taken_bytes = self._granted_bytes = 0
        self._open: int | None = None
        """Generation whose plan came last."""
        self._lands: dict[int, Land] = {}
        self.shown[:] = False
        # The upgrade.
        self._protocol.send_request(self._protocol.connect())
        await self._flush()
        while not self._events:
            await self._fill()
        response = self._events.popleft()
        if not isinstance(response, Response) or response.status_code != 101:
            raise LostError(f"got {response}, expected 101")
        await self.send(
            Hello(
                client="trial",
                budgets=Budgets(),
                credit_bytes=self._credit_bytes,
                token=self._token,
            )
        )
        welcome = await self.receive()
        if not isinstance(welcome, Welcome):
            raise LostError(f"got {welcome}, expected welcome")
        self._generation = 0
        self._findings.connections += 1
        return welcome

    async def land(
        self,
        position: tuple[float, float, float],
        radius_m: float,
        *,
        give_up_after: int | None = None,
    ) -> bool:
        """Land; True when it is ready, False when it was left after so many frames."""
        self._generation += 1
        self._findings.superseded += len(self._lands)
        near = np.flatnonzero(self.held)
        if len(near) > MAX_HAVE:
            middle = self._index.bounds[near].reshape(-1, 2, 3).mean(axis=1)
            near = near[np.argsort(np.linalg.norm(middle - position, axis=1))[:MAX_HAVE]]
        land = Land(
            generation=self._generation,
            position=position,
            radius_m=radius_m,
            have=self._index.xxh3[near],
            taken_bytes=self._taken_bytes,
        )
        self._lands = {land.generation: land}
        began_s = time.monotonic()
        await self.send(land)
        frames = 0
        while True:
            got = await self.receive()
            if isinstance(got, Frame):
                if got.generation == land.generation:
                    if not frames and self._bytes_per_s is None:
                        self._findings.first_s.append(time.monotonic() - began_s)
                    frames += 1
                if give_up_after is not None and frames >= give_up_after:
                    return False
            elif isinstance(got, Plan) and give_up_after == 0:
                return False
            elif isinstance(got, Ready) and got.generation == land.generation:
                if self._bytes_per_s is None:
                    took_s = time.monotonic() - began_s
                    self._findings.ready.append(ReadyLanding(began_s, took_s))
                self._findings.landings += 1
                self._lands.clear()
                return True

    def forget(self, segments: np.ndarray[Any, Any]) -> None:
        """Forget segments; only while no landing is open."""
        self.held[segments] = False
        self.shown[segments] = False

    async def send(self, *messages: Message) -> None:
        """Send messages in one write."""
        for message in messages:
            data = encode(message)
            assert isinstance(data, bytes)
            self._protocol.send_binary(data)
        await self._flush()

    async def receive(self) -> Message | Frame:
        """Receive one message or frame, checked."""
        while True:
            while not self._events:
                await self._fill()
            event = self._events.popleft()
            if not isinstance(event, WebSocketFrame):
                continue
            if event.opcode is Opcode.CLOSE:
                raise LostError(
                    f"closed: {self._protocol.close_code} {self._protocol.close_reason}"
                )
            if event.opcode is not Opcode.BINARY:
                continue
            if is_payload(event.data):
                frame = decode_frame(event.data)
                assert frame is not None
                self._take_frame(frame)
                await self._grant(len(frame.data))
                return frame
            message = decode(event.data, Direction.SERVER_TO_CLIENT)
            if not isinstance(message, Message) or isinstance(message, Notice):
                continue
            self._take_message(message)
            return message

    def cut(self) -> None:
        """Drop the connection as a lost network does: no close frame, parts are gone."""
        if self._socket is not None:
            linger = (1).to_bytes(4, "little") + bytes(4)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            self._socket.close()
            self._socket = None
        self._part = None

    async def leave(self) -> None:
        """Close as a client does that goes home."""
        if self._socket is not None:
            self._protocol.send_close(1000)
            await self._flush()
            self.cut()

    def _take_frame(self, frame: Frame) -> None:
        findings, segment = self._findings, self._segments[frame.key]
        if frame.generation != self._open:
            self._wrong(f"a frame of generation {frame.generation} outside of it")
        if self.held[segment]:
            findings.repeated += 1
        if not self._queue or self._queue[0] != segment:
            self._wrong(f"segment {segment} out of order")
        if frame.offset == 0:
            if self._part is not None and self._part[0] == segment:
                findings.repeated += 1
            self._part = (segment, bytearray())
        if self._part is None or self._part[0] != segment or len(self._part[1]) != frame.offset:
            self._wrong(f"a gap in segment {segment}, before byte {frame.offset}")
            return
        payload = self._part[1]
        payload += frame.data
        findings.payload_bytes += len(frame.data)
        if len(payload) == frame.total:
            self._part = None
            if self._queue and self._queue[0] == segment:
                self._queue.pop(0)
            if xxhash.xxh3_64_intdigest(payload) != frame.key:
                self._wrong(f"segment {segment} has a wrong hash")
            self.held[segment] = True
            findings.segments += 1

    def _take_message(self, message: Message) -> None:
        if isinstance(message, Plan):
            self._take_plan(message)
        elif isinstance(message, Ready):
            missing = 0 if message.missing is None else len(message.missing)
            if missing or self._queue or message.generation != self._open:
                lost = missing + len(self._queue)
                self._findings.lost += lost
                self._wrong(f"ready of {message.generation} with {lost} segments not delivered")
            self.shown[:] = False
            self.shown[self._plan_ids] = True
        elif not isinstance(message, Welcome):
            self._wrong(f"got {str(message)[:300]}")

    def _take_plan(self, plan: Plan) -> None:
        findings, ids = self._findings, plan.show["id"].tolist()
        findings.plans += 1
        land = self._lands.get(plan.generation)
        if land is not None and self._check_plan():
            findings.plans_checked += 1
            expected = expect(self._index, land, max_segments=MAX_PLAN_SEGMENTS)
            for what in differences(plan, expected, land, self._index):
                self._wrong(f"plan {plan.generation}: {what}")
        self._open = plan.generation
        self._plan_ids = ids
        # What was on its way has arrived: the frames were sent before the plan.
        self._queue = [segment for segment in ids if not self.held[segment]]
        if self._part is not None and self._part[0] in self._queue:  # it is finished first
            self._queue.remove(self._part[0])
            self._queue.insert(0, self._part[0])

    async def _grant(self, count: int) -> None:
        self._taken_bytes += count
        taken_bytes = self._taken_bytes - self._granted_bytes
        if taken_bytes >= self._credit_bytes // 2:
            self._granted_bytes = self._taken_bytes
            await self.send(Credit(bytes=taken_bytes))

    async def _fill(self) -> None:
        if self._socket is None:
            raise LostError("not connected")
        loop = asyncio.get_running_loop()
        try:
            data = await loop.sock_recv(self._socket, _READ_BYTES)
        except OSError as error:
            raise LostError(str(error)) from None
        if not data:
            raise LostError("end of stream")
        self._protocol.receive_data(data)
        self._events.extend(self._protocol.events_received())
        await self._flush()  # pongs
        if self._bytes_per_s is not None:
            await asyncio.sleep(len(data) / self._bytes_per_s)

    async def _flush(self) -> None:
        loop = asyncio.get_running_loop()
        if self._socket is None:
            raise LostError("not connected")
        for data in self._protocol.data_to_send():
            if data:
                try:
                    await loop.sock_sendall(self._socket, data)
                except OSError as error:
                    raise LostError(str(error)) from None

    def _wrong(self, what: str) -> None:
        self._findings.say(f"{self._name}: {what}")
