"""An independent model of a client, to check what a session sends against the specification.

And what the files of the session's tests share: small scenes, clients, short words for messages.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from itertools import takewhile
from typing import Any

import numpy as np
from server.plain_client import make_hello

from terraport_payload import box_distances_m
from terraport_server.session.interface import (
    Action,
    Close,
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
    Aim,
    CloseCode,
    Degraded,
    Direction,
    Error,
    ErrorCode,
    Land,
    Message,
    Plan,
    Prefetch,
    Ready,
    Superseded,
    Welcome,
    decode,
    encode,
)


def make_scene(count: int = 12, *, length: int = 1000, encoding: str = "segment-2") -> SceneView:
    """Unit boxes at x = 0, 10, 20, ...; segment s has length + s bytes and 10 faces."""
    bounds = np.zeros((count, 6), dtype=np.float32)
    bounds[:, 0] = 10.0 * np.arange(count)
    bounds[:, 3] = bounds[:, 0] + 1.0
    bounds[:, 4:] = 1.0
    table = SegmentTable(
        bounds=bounds,
        lengths=np.arange(length, length + count, dtype=np.uint32),
        hashes=np.arange(7000, 7000 + count, dtype=np.uint64),
        faces=np.full(count, 10, dtype=np.uint32),
        vertices=np.full(count, 8, dtype=np.uint32),
        texture_bytes=np.zeros(count, np.uint64),
    )

    def within(centre: Any, radius_m: float) -> Any:
        return np.flatnonzero(box_distances_m(bounds, centre) <= radius_m)

    return SceneView(id="row", version="v1", name="Row", encodings={encoding: table}, within=within)


class Client:
    """Plays the client of one session and checks every action on the way.

    ``corrupt`` are segments that the shell cannot read; ``in_runs``, whether it sends several
    chunks and then books them, as the sender does.
    """

    def __init__(self, session: Session, scene: SceneView) -> None:
        self.session = session
        self.scene = scene
        (self.table,) = scene.encodings.values()
        self.now_s = 0.0
        self.credit = 0
        self.corrupt: set[int] = set()
        self.in_runs = False
        self.held: set[int] = set()
        self.partly_sent: dict[int, int] = {}
        self.load: dict[int, list[int]] = {}
        self.landings: set[int] = set()
        self.ends: dict[int, list[str]] = {}
        self.sent_bytes: dict[int, int] = {}
        self.messages: list[Message] = []
        self.chunks: list[SendChunk] = []
        self.picks: list[RunPick] = []
        self.looked_at: list[int] = []
        """What each plan cost."""
        self.close: Close | None = None

    def greet(self, **fields: Any) -> Welcome:
        hello = make_hello(**fields)
        self.credit = hello.credit_bytes
        self.tell(hello)
        welcome = self.run(most=1)[0]
        assert isinstance(welcome, Welcome)
        if hello.held is not None:
            self.held = set(hello.held["id"].tolist()) - set(welcome.dropped.tolist())
        return welcome

    def tell(self, message: Message) -> None:
        self.session.receive(message, self.now_s)

    def run(self, most: int = 1_000_000, *, until: Callable[[], bool] | None = None) -> list[Any]:
        """Carry out at most so many actions; return the messages and chunks among them."""
        seen: list[Any] = []
        while len(seen) < most and not (until is not None and until()):
            action = self.session.next_action()
            if action is None:
                break
            if isinstance(action, MakePlan):
                self.looked_at.append(self.session.make_plan(self.now_s))
                continue
            seen.append(self._carry_out(action))
        return seen

    def _carry_out(self, action: Action) -> Any:
        assert self.close is None, "nothing follows a close"
        if isinstance(action, SendChunk):
            self._chunk(action)
            return action
        if isinstance(action, SendMessage):
            self.messages.append(action.message)
            self._message(action.message)
            return action.message
        if isinstance(action, RunPick):
            self.picks.append(action)
        else:
            self.close = action
        return action

    def _chunk(self, chunk: SendChunk) -> None:
        assert self.session.next_action() == chunk, "asked again, the same"
        if chunk.segment in self.corrupt:
            self.session.payload_failed(chunk, self.now_s)
            self.partly_sent.pop(chunk.segment, None)
            return
        chunks = self.session.next_chunks(chunk.total + 1)
        assert chunks[0][:3] == chunk[:3], "several begin with the one"
        assert chunks[0].length >= chunk.length
        assert sum(one.length for one in chunks[:-1]) <= chunk.total, "no more than asked for"
        chunks = list(takewhile(lambda sent_chunk: sent_chunk.segment not in self.corrupt, chunks))
        chunks = chunks[: 1 + (chunk.segment % len(chunks) if self.in_runs else 0)]
        if not self.in_runs or chunk.segment % 3 == 0:  # of the last one a part was sent
            chunks[-1] = chunks[-1]._replace(length=min(chunks[-1].length, chunk.length))
        self.session.chunks_sent(chunks, self.now_s)
        for sent_chunk in chunks:
            self._note(sent_chunk)

    def _note(self, chunk: SendChunk) -> None:
        self.chunks.append(chunk)
        assert 0 < chunk.length <= self.credit, "never more than the credit"
        self.credit -= chunk.length
        assert chunk.segment in self.load[chunk.generation], "only what was announced"
        assert chunk.landing == (chunk.generation in self.landings)
        assert "superseded" not in self.ends.get(chunk.generation, []), "nothing of an ended one"
        assert chunk.total == int(self.table.lengths[chunk.segment])
        assert chunk.offset == self.partly_sent.get(chunk.segment, 0), "no gap, no overlap"
        self.sent_bytes[chunk.generation] = self.sent_bytes.get(chunk.generation, 0) + chunk.length
        end = chunk.offset + chunk.length
        assert end <= chunk.total
        if end == chunk.total:
            self.partly_sent.pop(chunk.segment, None)
            self.held.add(chunk.segment)
        else:
            self.partly_sent[chunk.segment] = end

    def _message(self, message: Message) -> None:
        if isinstance(message, Plan | Prefetch):
            _check_fields(message)
            rows = message.load if isinstance(message, Plan) else message.segments
            load = rows["id"].tolist()
            assert not self.held.intersection(load), "what is held is not loaded"
            self.load[message.generation] = load
            self.partly_sent = {s: o for s, o in self.partly_sent.items() if s in load}
            if isinstance(message, Plan):
                self.landings.add(message.generation)
                assert self.held.issuperset(message.keep.tolist())
                self.load[message.generation] = load + message.keep.tolist()
        elif isinstance(message, Ready):
            self.ends.setdefault(message.generation, []).append("ready")
            missing = set(message.missing.tolist())
            assert set(self.load[message.generation]) - missing <= self.held, "ready is whole"
            assert not missing & self.held
            assert message.payload_bytes == self.sent_bytes.get(message.generation, 0)
        elif isinstance(message, Degraded):
            assert self.held.issuperset(message.segments.tolist())
        elif isinstance(message, Superseded):
            self.ends.setdefault(message.generation, []).append("superseded")
        elif isinstance(message, Error):
            assert message.fatal == self.session.closing


def _check_fields(message: Plan | Prefetch) -> None:
    """Check a message that the server makes without checks: the same with them, and on the wire."""
    fields = {field.name: getattr(message, field.name) for field in dataclasses.fields(message)}
    checked = type(message)(**fields)
    assert checked == message == decode(encode(message), Direction.SERVER_TO_CLIENT)
    assert all(type(getattr(checked, name)) is type(value) for name, value in fields.items())


def make_client(
    scene: SceneView | None = None, *, greet: bool = True, authorise: Any = None, **limits: Any
) -> Client:
    scene = scene or make_scene()
    limits.setdefault("max_messages_per_s", 1e6)
    session = Session(
        scene,
        SessionLimits(**limits),
        session_id="s1",
        now_s=0.0,
        authorise=authorise,
    )
    client = Client(session, scene)
    if greet:
        client.greet()
    return client


def land(generation: int, x: float = 0.0, radius_m: float = 25.0, **fields: Any) -> Land:
    return Land(generation=generation, position=(x, 0.0, 0.0), radius_m=radius_m, **fields)


def aim(generation: int, x: float = 0.0, radius_m: float = 25.0) -> Aim:
    return Aim(generation=generation, position=(x, 0.0, 0.0), radius_m=radius_m)


def ids(*segments: int) -> np.ndarray:
    return np.array(segments, dtype=np.uint32)


def last_error(client: Client) -> Error:
    client.run()
    error = client.messages[-1]
    assert isinstance(error, Error)
    return error


def assert_fatal(client: Client, code: ErrorCode, close: CloseCode) -> Error:
    error = last_error(client)
    assert (error.code, error.fatal) == (code, True)
    assert client.close == Close(close, code)
    client.tell(land(99))
    assert client.run() == []
    return error


def kinds(seen: list[Any]) -> list[str]:
    return [type(item).__name__ for item in seen]
