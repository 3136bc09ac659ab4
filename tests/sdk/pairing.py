"""An in-memory pair: the client's state machine and the server's, without a socket."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import xxhash
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport.cache import CachedSegment, SegmentCache
from terraport.events import Event, RestoreNeeded, SegmentArrived
from terraport.session import ClientSession, SessionOptions
from terraport_payload import encode_segment
from terraport_server.session.interface import (
    Close,
    GroupPort,
    MakePlan,
    RunPick,
    SceneView,
    SegmentTable,
    SendChunk,
    SendMessage,
    SessionLimits,
)
from terraport_server.session.session import Session as ServerSession
from terraport_wire import (
    DecodeError,
    Direction,
    Hit,
    PayloadFrame,
    decode,
    encode,
    encode_frame,
)

GRID = 6
"""Segments along one side of the toy scene; boxes of 1 m with gaps of 1 m."""

MIDDLE = (GRID, 0.0, GRID)
"""Of the toy scene, metres."""


class ToyScene:
    """GRID x GRID segments in the plane y = 0; i is at (2 * (i % GRID), 0, 2 * (i // GRID))."""

    def __init__(
        self,
        *,
        cells: int = 2,
        seed: int = 0,
        version: str = "v1",
        payloads: list[bytes] | None = None,
        levels: int = 1,
    ) -> None:
        """Make one; `payloads` are any bytes, where they need not be decoded; of every level."""
        random = np.random.default_rng(seed)
        count = GRID * GRID
        ids = np.arange(count)
        low = np.stack([2.0 * (ids % GRID), np.zeros(count), 2.0 * (ids // GRID)], axis=1)
        self.bounds = np.concatenate([low, low + np.array([1, 0, 1])], axis=1).astype(np.float32)
        rows = count * levels
        self.payloads = payloads or [
            _payload(int(size), number)
            for number, size in enumerate(random.integers(1, 2 * cells, rows))
        ]
        hashes = [xxhash.xxh3_64_intdigest(payload) for payload in self.payloads]
        self.hashes = np.array(hashes, dtype=np.uint64)
        self.lengths = np.array([len(p) for p in self.payloads], dtype=np.uint32)
        table = SegmentTable(
            bounds=np.tile(self.bounds, (levels, 1)),
            lengths=self.lengths,
            hashes=self.hashes,
            faces=np.full(rows, 10, dtype=np.uint32),
            vertices=np.full(rows, 12, dtype=np.uint32),
            texture_bytes=np.zeros(rows, np.uint64),
            levels=levels,
        )
        self.view = SceneView(
            id="toy",
            version=version,
            name="toy",
            encodings={"segment-2": table},
            within=self.within,
        )

    def within(self, centre: Iterable[float], radius_m: float) -> np.ndarray:
        """Brute force: ids whose box comes within the radius, ascending."""
        at = np.asarray(list(centre), dtype=np.float64)
        low, high = self.bounds[:, :3].astype(float), self.bounds[:, 3:].astype(float)
        gap = np.maximum(np.maximum(low - at, 0), at - high)
        return np.flatnonzero(np.sqrt((gap**2).sum(axis=1)) <= radius_m)


@cache
def _payload(cells: int, seed: int) -> bytes:
    """A small segment; another seed, another hash."""
    return encode_segment(lattice_mesh(0, 0, cells, seed=seed), step_m=STEP_M, scales=SCALES)


@dataclass
class FakeDisk:
    """What a disk cache would hold, without a disk: entries by id."""

    entries: dict[int, CachedSegment] = field(default_factory=dict)


class Pair:
    """One client, over as many connections to one server as it takes."""

    def __init__(
        self,
        scene: ToyScene,
        *,
        cache_bytes: int = 1 << 20,
        credit_bytes: int = 4096,
        release_factor: float = 1.0,
        max_bytes: int | None = None,
        disk: FakeDisk | None = None,
        limits: SessionLimits | None = None,
        lag: int = 0,
    ) -> None:
        """Make a pair; `lag` messages of the server are on their way before one arrives."""
        self.lag = lag
        self.offer_held = True
        """False: nothing is offered in hello, as after a server that found it too large."""
        self.down: deque[bytes | str] = deque()
        self.scene = scene
        self.disk = disk
        self.limits = limits or SessionLimits(max_messages_per_s=1e6)
        on_disk = {s: e.facts.xxh3 for s, e in disk.entries.items()} if disk else {}
        self.client = ClientSession(
            SessionOptions(
                client="pair",
                credit_bytes=credit_bytes,
                release_factor=release_factor,
                max_bytes=max_bytes,
            ),
            SegmentCache(cache_bytes),
            on_disk,
        )
        self.events: list[Event] = []
        self.received: list[int] = []
        """Ids of segments that came whole from the server, in order."""
        self.chunk_bytes = 0
        self.restores: deque[int] = deque()
        self.spoil: Callable[[PayloadFrame], bytes] | None = None
        self.server: ServerSession | None = None
        self.closed: Close | None = None
        self.now_s = 0.0
        self.hit: Hit | None = None
        self.groups: GroupPort | None = None
        """The next connection's way to the groups."""

    def connect(self) -> None:
        """Begin a connection; nothing flows before :meth:`step`."""
        self.server = ServerSession(
            self.scene.view, self.limits, session_id="s", now_s=self.now_s, groups=self.groups
        )
        self.closed = None
        self.client.connected(offer_held=self.offer_held)

    def disconnect(self) -> None:
        """Lose the connection with everything that was on its way."""
        self.server = None
        self.down.clear()
        self.client.connection_lost()
        self._collect()

    def step(self) -> bool:
        """Let one thing happen; return whether anything did."""
        self._collect()
        if self.server is None:
            return False
        data = self.deliver()
        has_acted = self.serve()
        if len(self.down) <= (self.lag if has_acted or data else 0):
            return has_acted or data
        self.hear()
        return True

    def serve(self) -> bool:
        """Let the server do one thing; return whether it had any."""
        action = None if self.server is None else self.server.next_action()
        if isinstance(action, MakePlan):
            assert self.server is not None
            self.server.make_plan(self.now_s)
        elif action is not None:
            self._carry_out(action)
        return action is not None

    def hear(self) -> None:
        """Let the client hear the next thing that the server said, if there is one."""
        if self.down:
            self.client.receive(self.down.popleft())
        self._collect()

    def deliver(self) -> bool:
        """Let the server hear what the client says; return whether it said anything."""
        assert self.server is not None
        data = self.client.data_to_send()
        for frame in data:
            try:
                message = decode(frame, Direction.CLIENT_TO_SERVER)
                self.server.receive(message, self.now_s)
            except DecodeError as error:
                self.server.refuse(error, self.now_s)
        return bool(data)

    def settle(self) -> None:
        """Let everything happen that will."""
        while self.step() or self.restores:
            self.restore_one()

    def restore_one(self) -> None:
        """Let the disk answer one request."""
        if not self.restores:
            return
        segment = self.restores.popleft()
        entry = self.disk.entries.get(segment) if self.disk else None
        if entry is None:
            self.client.lost(segment)
        else:
            self.client.restored(entry)
        self._collect()

    def of(self, kind: type[Event]) -> list[Event]:
        """Events of one kind, in order of arrival."""
        return [event for event in self.events if isinstance(event, kind)]

    def _carry_out(self, action: object) -> None:
        assert self.server is not None
        if isinstance(action, SendMessage):
            self.down.append(encode(action.message))
        elif isinstance(action, SendChunk):
            payload = self.scene.payloads[action.segment]
            frame = PayloadFrame(
                action.generation,
                action.segment,
                action.offset,
                action.total,
                memoryview(payload)[action.offset : action.offset + action.length],
            )
            data = encode_frame(frame) if self.spoil is None else self.spoil(frame)
            self.server.chunks_sent([action], self.now_s)
            self.chunk_bytes += action.length
            self.down.append(data)
        elif isinstance(action, RunPick):
            self.server.picked(action.request, self.hit)
        elif isinstance(action, Close):
            while self.down:
                self.client.receive(self.down.popleft())
            self.closed = action
            self.disconnect()

    def _collect(self) -> None:
        for event in self.client.events():
            self.events.append(event)
            if isinstance(event, RestoreNeeded):
                self.restores.extend(event.segments)
            elif isinstance(event, SegmentArrived) and not event.restored:
                self.received.append(event.entry.facts.segment)
                if self.disk is not None:
                    self.disk.entries[event.entry.facts.segment] = event.entry
                    self.client.stored_on_disk(event.entry.facts)


def expected(scene: ToyScene, position: tuple[float, float, float], radius_m: float) -> tuple:
    """Brute force: ids of the segments that a landing shows."""
    return tuple(scene.within(position, radius_m).tolist())
