"""Fuzzing of the session core: the pure state machine, driven as the sender drives it.

No socket, so a hundred times as many messages; what is checked is what the sender relies on.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np
from attacks.messages import Corpus, sensible, sensible_hello

from terraport_payload import Cover, box_distances_m
from terraport_payload.hidden import HiddenFaces
from terraport_server.session.interface import (
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
    CLOSE_CODES,
    MAX_CHUNK_BYTES,
    CloseCode,
    DecodeError,
    Direction,
    Error,
    ErrorCode,
    decode,
    encode,
)

__all__ = ["CoreRun", "fuzz_core"]

SEGMENTS = 40
EDGE_M = 100.0
MOST_PENDING = 64
"""As ``max_pending_actions``: the sender stops reading above it."""


@dataclass
class CoreRun:
    """What one attack on the session's core came to: sent, decoded, answered, closed."""

    messages: int = 0
    sessions: int = 0
    decoded: int = 0
    chunks: int = 0
    answers: int = 0
    closed: int = 0


def make_view(seed: int) -> SceneView:
    """Make a plane of random boxes."""
    rng = np.random.default_rng(seed)
    corner = rng.uniform(0, EDGE_M, (SEGMENTS, 3)).astype(np.float32)
    table = SegmentTable(
        bounds=np.concatenate([corner, corner + np.float32(5.0)], axis=1),
        lengths=rng.integers(1, 300_000, SEGMENTS).astype(np.uint32),
        hashes=np.arange(SEGMENTS, dtype=np.uint64),
        faces=rng.integers(1, 10_000, SEGMENTS).astype(np.uint32),
        vertices=rng.integers(3, 10_000, SEGMENTS).astype(np.uint32),
        texture_bytes=rng.integers(0, 6_000_000, SEGMENTS).astype(np.uint64),
    )
    # One base face under each segment.
    cover = Cover(np.arange(SEGMENTS + 1, dtype=np.uint32), np.arange(SEGMENTS, dtype=np.uint32))
    return SceneView(
        id="fuzz",
        version="v",
        name="Fuzz",
        table=table,
        within=lambda centre, radius_m: np.flatnonzero(
            box_distances_m(table.bounds, centre) <= radius_m
        ),
        hidden_faces=HiddenFaces(cover, SEGMENTS),
    )


def fuzz_core(corpus: Corpus, draw: random.Random, view: SceneView, run: CoreRun) -> None:
    """One session, from hello to close; raises AssertionError, or whatever escapes the core."""
    limits = SessionLimits(max_messages_per_s=1e9, max_plan_segments=draw.choice([16_384, 7]))
    session = Session(view, limits, session_id="f", now_s=0.0)
    now_s, closes = 0.0, 0
    run.sessions += 1
    first = encode(sensible_hello(draw))
    if draw.random() < 0.1:
        first = corpus.edited(draw)
    _take(session, first, now_s, run)
    hostility = draw.choice([0.0, 0.03, 0.3, 1.0])
    for generation in range(draw.randint(1, 60)):
        if session.closing:
            break
        now_s += draw.choice([0.0, 0.001, 0.3, 5.0])
        if draw.random() < 0.3:
            session.heard(now_s)
            session.tick(now_s)
        if draw.random() < hostility:
            data = (corpus.edited if draw.random() < 0.7 else corpus.broken)(draw)
        else:
            message = sensible(draw, generation, segments=SEGMENTS, edge_m=EDGE_M)
            data = encode(message)
        if session.pending < MOST_PENDING:
            _take(session, data, now_s, run)
        if draw.random() < 0.02:
            session.scene_published("w")
        if draw.random() < 0.01:
            session.drain(now_s, 1.0)
        closes += _act(session, draw, now_s, run, most=draw.choice([0, 3, 50]))
    if not session.closing:
        session.tick(now_s + 1e6)
    closes += _act(session, draw, now_s, run, most=10_000)
    assert session.closing
    assert closes == 1, f"{closes} closes at the end of a session, expected one"
    run.closed += 1


def take_alone(data: bytes, view: SceneView, run: CoreRun) -> None:
    """One message to a session that is open, and one to a session that waits for hello."""
    draw = random.Random(0)
    for greeted in (True, False):
        session = Session(view, SessionLimits(), session_id="f", now_s=0.0)
        if greeted:
            hello = sensible_hello(random.Random(1))
            _take(session, encode(hello), 0.0, run)
        _take(session, data, 0.0, run)
        _act(session, draw, 0.0, run, most=1000)


def _take(session: Session, data: bytes, now_s: float, run: CoreRun) -> None:
    run.messages += 1
    try:
        message = decode(data, Direction.CLIENT_TO_SERVER)
    except DecodeError as error:
        session.refuse(error, now_s)
    else:
        run.decoded += 1
        session.receive(message, now_s)


def _act(
    session: Session,
    draw: random.Random,
    now_s: float,
    run: CoreRun,
    *,
    most: int,
) -> int:
    """Carry out what the session wants, as the sender does; return how often it closed."""
    closes = 0
    for _ in range(most):
        action = session.next_action()
        if action is None:
            break
        assert not closes, f"{action} after the close"
        if isinstance(action, SendChunk):
            assert 0 < action.length <= min(MAX_CHUNK_BYTES, session.credit_bytes)
            assert action.offset + action.length <= action.total
            if draw.random() < 0.03:
                session.payload_failed(now_s)
            else:
                session.chunks_sent([action], now_s)
            assert session.credit_bytes >= 0
            run.chunks += 1
        elif isinstance(action, SendMessage):
            _check_answer(action)
            run.answers += 1
        elif isinstance(action, MakePlan):
            session.make_plan(now_s)
        elif isinstance(action, RunPick):
            if draw.random() < 0.5:
                session.picked(action.request, None)
            else:
                session.pick_failed(action.request)
        elif isinstance(action, Close):
            closes += 1
            assert action.code in set(CLOSE_CODES.values()) | {CloseCode.NORMAL}
    return closes


def _check_answer(action: SendMessage) -> None:
    message = action.message
    assert decode(encode(message), Direction.SERVER_TO_CLIENT) == message
    if isinstance(message, Error):
        assert message.code in set(ErrorCode), message
        assert message.code != ErrorCode.INTERNAL or not message.fatal, message
