"""What one session costs without a socket: ``python benchmarks/session_core.py``.

Memory of a session in a scene of a million segments, time per chunk, and the messages of a large
landing on the wire. No network, some 20 s of one core.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable

import numpy as np

from terraport_payload import Cover
from terraport_payload.hidden import HiddenFaces
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
    KEY_DTYPE,
    MAX_HAVE,
    Budgets,
    Direction,
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
    # One base face under each segment.
    cover = Cover(np.arange(count + 1, dtype=np.uint32), ids.astype(np.uint32))
    return SceneView(
        id="m",
        version="v",
        name="M",
        table=table,
        within=within,
        hidden_faces=HiddenFaces(cover, count),
    )


def opened(scene: SceneView) -> Session:
    """Return a session that was welcomed."""
    limits = SessionLimits(max_messages_per_s=1e9, max_credit_bytes=PLENTY)
    session = Session(scene, limits, session_id="s", now_s=0.0)
    session.receive(Hello(client="", budgets=Budgets(), credit_bytes=PLENTY), 0.0)
    while session.next_action() is not None:
        pass
    return session


def make_land(radius_m: float, have: int) -> Land:
    """Return a landing in the middle, with so many keys."""
    keys = np.arange(have, dtype=KEY_DTYPE)
    return Land(
        generation=1,
        position=(5000.0, 1.0, 5000.0),
        radius_m=radius_m,
        have=keys,
        taken_bytes=0,
    )


def land(session: Session, radius_m: float) -> tuple[Plan | None, float, int]:
    """Land and take everything; return the plan, the seconds for chunks, and their number."""
    session.receive(make_land(radius_m, 0), 0.0)
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
        print(f"{name} session: {kib:.1f} KiB")
    runs = [land(opened(scene), 400.0) for _ in range(9)]
    per_chunk_us = min(1e6 * seconds / chunks for _, seconds, chunks in runs)
    print(f"one chunk asked for and booked: {per_chunk_us:.1f} us")
    plan = land(opened(scene), 173.0)[0]
    assert plan is not None
    for message, direction, rows in (
        (plan, Direction.SERVER_TO_CLIENT, len(plan.show)),
        (make_land(173.0, MAX_HAVE), Direction.CLIENT_TO_SERVER, MAX_HAVE),
    ):
        data = encode(message)
        encode_ms = best_ms(lambda m=message: encode(m))
        decode_ms = best_ms(lambda d=data, w=direction: decode(d, w))
        print(
            f"{message.TYPE} of {rows} rows: {len(data)} B, "
            f"encode {encode_ms:.2f} ms, decode {decode_ms:.2f} ms"
        )


if __name__ == "__main__":
    main()
