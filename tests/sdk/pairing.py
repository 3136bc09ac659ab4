"""An in-memory pair: the client's core and the server's session, without a socket."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from terraport.cache import SegmentCache
from terraport.core import SessionCore
from terraport.events import Event, RestoreNeeded, SegmentArrived
from terraport.options import SessionOptions
from terraport_payload import Cover, SegmentMesh, box_distances_m, encode_segment
from terraport_payload.hidden import HiddenFaces
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
from terraport_server.session.session import Session
from terraport_wire import (
    Budgets,
    DecodeError,
    Direction,
    Hit,
    decode,
    encode,
    frame_header,
)

COUNT = 30
BASE_FACES = 48
CENTRE = (50.0, 10.0, 50.0)


@cache
def payload(seed: int, level: int = 0) -> tuple[bytes, tuple[float, ...]]:
    """One triangle somewhere in 100 m; another seed, other bytes. With its box."""
    random = np.random.default_rng(seed)
    low = random.integers(0, 400, 3) / 4.0
    corners = low + random.integers(1, 60, (3, 3)) / 4.0 + 0.5 * level
    normals = np.tile(np.float32([0, 1, 0]), (3, 1))
    mesh = SegmentMesh(corners.astype(np.float32), np.uint32([[0, 1, 2]]), normals)
    box = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    return encode_segment(mesh, step_m=0.25, scales={}), box


class ToyScene:
    """Random triangles and a random cover; `version` changes a third of the triangles."""

    def __init__(self, seed: int = 0, *, levels: int = 1, version: int = 1) -> None:
        random = np.random.default_rng(seed)
        seeds = seed * 1000 + np.arange(COUNT)
        seeds[::3] += 500 * (version - 1)
        made = [payload(int(each), level) for level in range(levels) for each in seeds]
        self.payloads = [data for data, _ in made]
        rows = COUNT * levels
        table = SegmentTable(
            bounds=np.array([box for _, box in made], np.float32),
            lengths=np.array([len(data) for data in self.payloads], np.uint32),
            hashes=np.concatenate([seeds + 1 + 10**9 * level for level in range(levels)]).astype(
                np.uint64
            ),
            faces=np.ones(rows, np.uint32),
            vertices=np.full(rows, 3, np.uint32),
            texture_bytes=np.zeros(rows, np.uint64),
            levels=levels,
        )
        over = [
            np.unique(random.integers(0, COUNT, random.integers(0, 4))) for _ in range(BASE_FACES)
        ]
        offsets = np.cumsum([0, *map(len, over)]).astype(np.uint32)
        self.cover = Cover(offsets, np.concatenate(over).astype(np.uint32))
        self.table = table
        fine = table.bounds[:COUNT]
        self.view = SceneView(
            id="toy",
            version=f"{version}" * 32,
            name="toy",
            table=table,
            within=lambda at, radius_m: np.flatnonzero(box_distances_m(fine, at) <= radius_m),
            hidden_faces=HiddenFaces(self.cover, COUNT),
        )

    def expected(
        self,
        position: Any,
        radius_m: float,
        *,
        coarse_radius_m: float | None = None,
        missing: set[int] = frozenset(),
        budgets: Budgets | None = None,
    ) -> tuple[set[int], bytes]:
        """Keys that a landing shows, and the bits of the base faces that it hides, by a loop."""
        distances = box_distances_m(self.table.bounds[:COUNT], position)
        most = (budgets.max_segments if budgets else None) or COUNT
        rows = []
        for segment in sorted(range(COUNT), key=lambda each: (distances[each], each)):
            coarser = distances[segment] > radius_m
            ring_m = coarse_radius_m if self.table.levels > 1 and coarse_radius_m else radius_m
            if distances[segment] <= ring_m and len(rows) < most:
                rows.append(segment + COUNT * coarser)
        rows = [row for row in rows if row not in missing]
        segments = {row % COUNT for row in rows}
        hidden = [
            bool(over := set(self.cover.over(face).tolist())) and over <= segments
            for face in range(BASE_FACES)
        ]
        keys = {int(self.table.hashes[row]) for row in rows}
        return keys, np.packbits(hidden, bitorder="little").tobytes()


class Pair:
    """One client, over as many connections to one server as it takes."""

    def __init__(
        self,
        scene: ToyScene,
        *,
        cache_bytes: int = 1 << 20,
        credit_bytes: int = 4096,
        disk: dict[int, bytes] | None = None,
        **budgets: int | None,
    ) -> None:
        self.scene = scene
        self.disk = disk
        """Payloads by key, as a disk cache would hold them; None: no disk."""
        boxes = {scene_key: tuple(scene.table.bounds[row].tolist())
                 for row, scene_key in enumerate(scene.table.hashes.tolist())
                 if scene_key in (disk or {})}  # fmt: skip
        options = SessionOptions(client="pair", credit_bytes=credit_bytes, **budgets)
        self.core = SessionCore(options, SegmentCache(cache_bytes), boxes)
        self.budgets = options.hello().budgets
        self.server: Session | None = None
        self.groups: GroupPort | None = None
        self.hit: Hit | None = None
        self.down: deque[bytes] = deque()
        self.restores: deque[int] = deque()
        self.events: list[Event] = []
        self.received: list[int] = []
        """Keys of segments that came whole from the server, in order."""
        self.broken: set[int] = set()
        """Rows whose payload the server cannot read."""
        self.spoil: Callable[[bytes], bytes] | None = None
        """What happens to a frame on its way."""
        self.messages: list[bytes] = []
        """What the client sent."""

    def connect(self) -> None:
        """Begin a connection."""
        limits = SessionLimits(max_messages_per_s=1e6)
        self.server = Session(
            self.scene.view, limits, session_id="s", now_s=0.0, groups=self.groups
        )
        self.core.connected()

    def disconnect(self) -> None:
        """Lose the connection with everything that is on its way."""
        self.server = None
        self.down.clear()
        self.core.connection_lost()
        self.collect()

    def speak(self) -> bool:
        """Let the server hear what the client has to say; return whether it said anything."""
        data = self.core.data_to_send() if self.server is not None else []
        self.core.sent()
        self.messages += data
        for message in data:
            assert self.server is not None
            try:
                self.server.receive(decode(message, Direction.CLIENT_TO_SERVER), 0.0)
            except DecodeError as error:
                self.server.refuse(error, 0.0)
        return bool(data)

    def serve(self) -> bool:
        """Let the server do one thing; return whether it had any."""
        if self.server is None or (action := self.server.next_action()) is None:
            return False
        if isinstance(action, MakePlan):
            self.server.make_plan(0.0)
        elif isinstance(action, SendMessage):
            self.down.append(encode(action.message))
        elif isinstance(action, RunPick):
            self.server.picked(action.request, self.hit)
        elif isinstance(action, SendChunk):
            self._send(action)
        elif isinstance(action, Close):
            while self.down:
                self.hear()
            self.disconnect()
        return True

    def hear(self) -> bool:
        """Let the client hear the next thing that the server said; return whether there was one."""
        if not self.down:
            return False
        self.core.receive(self.down.popleft())
        self.collect()
        return True

    def restore(self) -> bool:
        """Let the disk answer one request; return whether there was one."""
        if not self.restores:
            return False
        key = self.restores.popleft()
        data = (self.disk or {}).get(key)
        if data is None:
            self.core.lost(key)
        else:
            self.core.restored(key, data)
        self.collect()
        return True

    def settle(self) -> None:
        """Let everything happen that will."""
        while any([self.speak(), self.serve(), self.hear(), self.restore()]):
            pass

    def of(self, kind: Any) -> list[Any]:
        """Events of one kind, in order."""
        return [event for event in self.events if isinstance(event, kind)]

    def collect(self) -> None:
        """Take what the core reports, as the shell does."""
        for event in self.core.events():
            self.events.append(event)
            if isinstance(event, RestoreNeeded):
                self.restores.extend(event.keys)
            elif isinstance(event, SegmentArrived) and not event.restored:
                self.received.append(event.entry.key)
                if self.disk is not None:
                    self.disk[event.entry.key] = event.entry.payload
                    self.core.disk_changed(event.entry, ())

    def _send(self, chunk: SendChunk) -> None:
        assert self.server is not None
        if chunk.segment in self.broken:
            self.server.payload_failed(0.0)
            return
        header = frame_header(
            generation=chunk.generation,
            key=int(self.scene.table.hashes[chunk.segment]),
            offset=chunk.offset,
            total=chunk.total,
        )
        data = self.scene.payloads[chunk.segment][chunk.offset : chunk.offset + chunk.length]
        frame = header + data
        self.down.append(frame if self.spoil is None else self.spoil(frame))
        self.server.chunks_sent([chunk], 0.0)
