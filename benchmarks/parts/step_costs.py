"""What one message costs the event loop, in this process: decoded, and planned with."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
from parts.random_scene import TILE_M

from terraport_server.session.interface import (
    MakePlan,
    SceneView,
    SegmentTable,
    SendMessage,
    SessionLimits,
)
from terraport_server.session.session import Session
from terraport_store import PackedRTree
from terraport_wire import (
    HELD_DTYPE,
    MAX_HELD_SEGMENTS,
    Budgets,
    DecodeError,
    Direction,
    Evict,
    Held,
    Hello,
    Land,
    decode,
    encode,
)

__all__ = ["landing_costs", "message_costs"]

_MEGABYTE = 1 << 20
_LEAST_VALUES = 1000
"""About as many as a server takes; the costliest of them are maps of small maps."""


def message_costs(rounds: int) -> Iterator[dict[str, Any]]:
    """Decode the costliest messages that are known, as the service does; milliseconds."""
    for name, data in _messages().items():

        def take(data: bytes = data) -> str:
            try:
                decode(data, Direction.CLIENT_TO_SERVER, max_bytes=_MEGABYTE)
            except DecodeError as error:
                return str(error.code)
            return "taken"

        times = _timed_ms(take, rounds)
        yield {"message": name, "bytes": len(data), "answer": take(), **times}


def landing_costs(side: int, rounds: int) -> Iterator[dict[str, Any]]:
    """Land with a release factor of 4, ``land`` received to plan encoded; milliseconds."""
    table = _grid(side)
    view = SceneView("pit", "1", "pit", {"glb": table}, PackedRTree(table.bounds).within)
    for radius_m in (24.0, 500.0):
        for share in (0.0, 0.01, 1.0):
            session = _holding(view, table, round(share * len(table)))
            generation = 0

            def land(session: Session = session, radius_m: float = radius_m) -> None:
                nonlocal generation
                generation += 1
                x = TILE_M * (side / 2 + generation % 20)
                position = (x, 0.5, TILE_M * side / 2)
                session.receive(
                    Land(generation=generation, position=position, radius_m=radius_m), 0.0
                )
                while (action := session.next_action()) is not None:
                    if isinstance(action, SendMessage):
                        encode(action.message)
                    elif isinstance(action, MakePlan):
                        session.make_plan(0.0)
                    else:
                        break

            times = _timed_ms(land, rounds)
            yield {"radius_m": radius_m, "held": share, "segments": len(table), **times}


def _messages() -> dict[str, bytes]:
    rng = np.random.default_rng(1)
    held_segments = np.zeros(MAX_HELD_SEGMENTS, dtype=HELD_DTYPE)
    held_segments["id"] = rng.permutation(MAX_HELD_SEGMENTS)
    tiny = [[0] * 16_000] * 64
    maps = [{str(number): {}} for number in range(_LEAST_VALUES // 3 - 10)]
    text = "ä" * (_MEGABYTE // 2 - 100)
    messages: dict[str, bytes] = {
        "unknown type, a megabyte of values": msgpack.packb({"type": "wave", "x": tiny}),
        "the same, type last": msgpack.packb({"x": tiny, "type": "wave"}),
        "known type, a megabyte of values": msgpack.packb({"type": "bye", "x": tiny}),
        "as many values as may be, maps": msgpack.packb({"type": "bye", "x": maps}),
        "a megabyte of text": msgpack.packb({"x": text, "type": "wave"}),
        "a type of a megabyte": msgpack.packb({"type": text}),
        "a client's name of a megabyte": msgpack.packb({"type": "hello", "client": text}),
    }
    for message in (Held(segments=held_segments), Evict(segments=held_segments["id"].copy())):
        messages[f"{message.TYPE} of {MAX_HELD_SEGMENTS}"] = encode(message)
    return messages


def _grid(side: int) -> SegmentTable:
    number = np.arange(side * side)
    bounds = np.zeros((side * side, 6), dtype=np.float32)
    bounds[:, 0], bounds[:, 2] = TILE_M * (number % side), TILE_M * (number // side)
    bounds[:, 3:] = bounds[:, :3] + np.array([TILE_M, 1.0, TILE_M], dtype=np.float32)
    rng = np.random.default_rng(3)
    return SegmentTable(
        bounds=bounds,
        lengths=rng.integers(50_000, 300_000, len(bounds), dtype=np.uint32),
        hashes=rng.integers(0, 1 << 63, len(bounds), dtype=np.uint64),
        faces=rng.integers(2_000, 20_000, len(bounds), dtype=np.uint32),
        vertices=rng.integers(1_000, 12_000, len(bounds), dtype=np.uint32),
        texture_bytes=np.zeros(len(bounds), np.uint64),
    )


def _holding(view: SceneView, table: SegmentTable, count: int) -> Session:
    """Return a session whose client holds so many segments, spread over the scene."""
    session = Session(view, SessionLimits(max_messages_per_s=1e9), session_id="x", now_s=0.0)
    hello = Hello(
        protocol=(1, 0),
        client="benchmark",
        encoding="glb",
        budgets=Budgets(),
        credit_bytes=0,
        release_factor=4.0,
    )
    session.receive(hello, 0.0)
    ids = np.random.default_rng(5).permutation(len(table))[:count]
    for first in range(0, count, MAX_HELD_SEGMENTS):
        some = ids[first : first + MAX_HELD_SEGMENTS]
        rows = np.zeros(len(some), dtype=HELD_DTYPE)
        rows["id"], rows["xxh3"] = some, table.hashes[some]
        session.receive(Held(segments=rows), 0.0)
    while session.next_action() is not None:
        pass
    return session


def _timed_ms(work: Callable[[], object], rounds: int) -> dict[str, float]:
    times = []
    for _ in range(rounds):
        began_s = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - began_s))
    named = {"p50_ms": statistics.median(times), "max_ms": max(times)}
    return {name: round(value, 3) for name, value in named.items()}
