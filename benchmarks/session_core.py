"""What one session costs without a socket: ``python benchmarks/session_core.py``.

Memory of a session in a scene of a million segments, time per chunk, and the control messages of
a large plan and a large offer on the wire. No network, some 20 s of one core.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable

import numpy as np

from terraport_server.session.interface import (
    MakePlan,
    SceneView,
    SegmentTable,
    SendChunk,
    SessionLimits,
)
from terraport_server.session.session import Session
from terraport_store.packed_rtree import PackedRTree
from terraport_wire import (
    HELD_DTYPE,
    Budgets,
    Direction,
    Held,
    Hello,
    Land,
    Plan,
    decode,
    encode,
)

SIDE = 1000
SESSIONS = 300
PLENTY = 1 << 50


def scene_of_a_million() -> SceneView:
    """Return a flat square of SIDE x SIDE segments of 10 m."""
    count = SIDE * SIDE
    ids = np.arange(count)
    low = np.stack([10.0 * (ids % SIDE), np.zeros(count), 10.0 * (ids // SIDE)], axis=1)
    bounds = np.concatenate([low, low + np.array([9.5, 2.0, 9.5])], axis=1).astype(np.float32)
    table = SegmentTable(
        bounds=bounds,
        lengths=np.full(count, 50_000, dtype=np.uint32),
        hashes=ids.astype(np.uint64),
        faces=np.full(count, 12_000, dtype=np.uint32),
        vertices=np.full(count, 7_000, dtype=np.uint32),
        texture_bytes=np.zeros(count, np.uint64),
    )
    within = PackedRTree(bounds).within
    return SceneView(id="m", version="v", name="M", encodings={"segment-2": table}, within=within)


def opened(scene: SceneView) -> Session:
    """Return a session that was welcomed."""
    limits = SessionLimits(max_messages_per_s=1e9, max_credit_bytes=PLENTY)
    session = Session(scene, limits, session_id="s", now_s=0.0)
    hello = Hello(
        protocol=(1, 0), client="", encoding="segment-2", budgets=Budgets(), credit_bytes=PLENTY
    )
    session.receive(hello, 0.0)
    while session.next_action() is not None:
        pass
    return session


def land(session: Session, radius_m: float) -> tuple[Plan | None, float, int]:
    """Land and take everything; return the plan, the seconds for chunks, and their number."""
    session.receive(Land(generation=1, position=(5000.0, 1.0, 5000.0), radius_m=radius_m), 0.0)
    plan, chunks = None, 0
    began_s = time.perf_counter()
    while (action := session.next_action()) is not None:
        if isinstance(action, MakePlan):
            session.make_plan(0.0)
        elif isinstance(action, SendChunk):
            session.chunks_sent([action], 0.0)
            chunks += 1
        elif isinstance(message := getattr(action, "message", None), Plan):
            plan, began_s = message, time.perf_counter()
    return plan, time.perf_counter() - began_s, chunks


def best_ms(work: Callable[[], object]) -> float:
    """Milliseconds of the shortest of nine runs: others on the machine only ever add."""
    times = []
    for _ in range(9):
        began_s = time.perf_counter()
        work()
        times.append(time.perf_counter() - began_s)
    return 1000.0 * min(times)


def main() -> None:
    """Print every figure."""
    scene = scene_of_a_million()
    for name, radius_m in (("idle", 0.0), ("landed", 100.0)):
        land(opened(scene), 10.0)
        gc.collect()
        tracemalloc.start()
        sessions = [opened(scene) for _ in range(SESSIONS)]
        if radius_m:
            for session in sessions:
                land(session, radius_m)
        gc.collect()
        kib = tracemalloc.get_traced_memory()[0] / SESSIONS / 1024.0
        tracemalloc.stop()
        assert sessions[0].transfers is not None
        print(f"{name} session: {kib:.1f} KiB, holds {len(sessions[0].transfers.held)} segments")
    runs = [land(opened(scene), 400.0) for _ in range(9)]
    per_chunk_us = min(1e6 * seconds / chunks for _, seconds, chunks in runs)
    print(f"one chunk asked for and booked: {per_chunk_us:.1f} us")
    plan = land(opened(scene), 173.0)[0]
    assert plan is not None
    offer = np.zeros(32_768, dtype=HELD_DTYPE)
    offer["id"] = np.arange(len(offer))
    for message, direction in (
        (plan, Direction.SERVER_TO_CLIENT),
        (Held(segments=offer), Direction.CLIENT_TO_SERVER),
    ):
        rows = len(message.load) if isinstance(message, Plan) else len(message.segments)
        data = encode(message)
        encode_ms = best_ms(lambda m=message: encode(m))
        decode_ms = best_ms(lambda d=data, w=direction: decode(d, w))
        print(
            f"{message.TYPE} of {rows} rows: {len(data)} B, "
            f"encode {encode_ms:.2f} ms, decode {decode_ms:.2f} ms"
        )


if __name__ == "__main__":
    main()
