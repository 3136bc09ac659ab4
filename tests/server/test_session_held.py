"""The session state machine: what a client holds, evicts and rejects; aims and picks.

What the files of the session's tests share stands in ``session_model.py``: small scenes, a client
that keeps the rules, and short words for messages.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from server.session_model import (
    aim,
    assert_fatal,
    ids,
    kinds,
    land,
    last_error,
    make_client,
    make_scene,
)

from terraport_server.session.interface import SendChunk
from terraport_server.session.session import INTERNAL_TEXT
from terraport_wire import (
    HELD_DTYPE,
    MAX_CHUNK_BYTES,
    MAX_HELD_SEGMENTS,
    CloseCode,
    ErrorCode,
    Evict,
    Held,
    HeldChecked,
    Pick,
    Picked,
    Prefetch,
    Reject,
    Superseded,
)

# Held, evict, reject.


def test_offered_segments_are_accepted_by_hash() -> None:
    client = make_client(greet=False)
    offered = np.array([(1, 7001), (2, 1), (5000, 7005)], dtype=HELD_DTYPE)
    welcome = client.greet(held=offered)
    assert (welcome.held_count, sorted(welcome.dropped.tolist())) == (1, [2, 5000])
    client.tell(land(1))
    plan = client.run()[0]
    assert plan.keep.tolist() == [1]
    assert plan.load["id"].tolist() == [0, 2]


def test_tables_in_order_are_not_sorted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each was five times, for .4 ms of the event loop."""
    client = make_client()
    sorts: list[int] = []
    sort = np.sort

    def count(array: Any, *arguments: Any, **options: Any) -> Any:
        sorts.append(len(array))
        return sort(array, *arguments, **options)

    table = np.zeros(MAX_HELD_SEGMENTS, dtype=HELD_DTYPE)
    table["id"] = np.arange(MAX_HELD_SEGMENTS)
    shuffled = np.random.default_rng(20).permutation(table)
    monkeypatch.setattr(np, "sort", count)
    client.tell(Held(segments=table))
    (checked,) = client.run()
    assert isinstance(checked, HeldChecked)
    assert len(checked.dropped) == MAX_HELD_SEGMENTS
    assert sorts == []
    client.tell(Held(segments=shuffled))
    client.run()
    assert sorts == [MAX_HELD_SEGMENTS] * 2, "to find an id twice, and for the answer"


def test_evicted_segments_are_loaded_again() -> None:
    client = make_client()
    client.tell(land(1))
    client.run()
    client.held -= {1}
    client.tell(Evict(segments=ids(1, 9, 4_000_000)))
    client.tell(land(2))
    plan = client.run()[0]
    assert plan.load["id"].tolist() == [1]
    assert plan.keep.tolist() == [0, 2]


def test_evict_of_the_open_landing_is_fatal() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    client.tell(Evict(segments=ids(2)))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert "segment 2" in error.message


def test_a_rejected_segment_is_sent_once_more_then_missing() -> None:
    client = make_client()
    client.tell(land(1))
    client.run()
    client.held -= {1}
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    chunk, ready = client.run()
    assert (chunk.segment, chunk.generation, ready.missing.tolist()) == (1, 1, [])
    assert (ready.delivered, ready.payload_bytes) == (3, 3003 + 1001)
    client.held -= {1}
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    (ready,) = client.run()
    assert ready.missing.tolist() == [1]
    client.tell(land(2))
    assert client.run()[0].load["id"].tolist() == [1], "a missing segment is tried again"


def test_a_rejected_kept_segment_is_sent() -> None:
    client = make_client(greet=False)
    client.greet(held=np.array([(0, 7000)], dtype=HELD_DTYPE))
    client.tell(land(1, radius_m=5.0))
    client.run()
    client.held -= {0}
    client.tell(Reject(generation=1, segment=0, reason="undecodable"))
    assert kinds(client.run()) == ["SendChunk", "Ready"]


def test_a_reject_of_something_else_changes_only_what_is_held() -> None:
    client = make_client()
    for generation, x in ((1, 0.0), (2, 100.0)):
        client.tell(land(generation, x))
        client.run()
    client.held -= {0}
    client.tell(Reject(generation=1, segment=0, reason="hash_mismatch"))
    assert client.run() == []
    client.tell(land(3, radius_m=5.0))
    assert client.run()[0].load["id"].tolist() == [0]


def test_a_reject_while_still_streaming_brings_one_ready() -> None:
    client = make_client()
    client.tell(land(1))
    client.run(until=lambda: len(client.chunks) == 1)
    client.held -= {0}
    client.tell(Reject(generation=1, segment=0, reason="hash_mismatch"))
    assert [getattr(i, "segment", "ready") for i in client.run()] == [0, 1, 2, "ready"]


def test_a_reject_beyond_the_scene_is_fatal() -> None:
    client = make_client()
    client.tell(Reject(generation=1, segment=12, reason="x"))
    assert_fatal(client, ErrorCode.INVALID_FIELD, CloseCode.MALFORMED)


def test_a_corrupt_segment_is_missing_and_never_sent() -> None:
    client = make_client()
    client.corrupt = {1}
    client.tell(land(1))
    ready = client.run()[-1]
    assert (ready.delivered, ready.missing.tolist()) == (2, [1])
    assert {chunk.segment for chunk in client.chunks} == {0, 2}
    client.corrupt = set()
    client.tell(land(2))
    assert client.run()[0].load["id"].tolist() == [1]


# Aims.


def test_an_aim_prefetches_and_the_landing_keeps() -> None:
    client = make_client()
    client.tell(aim(1))
    prefetch, *chunks = client.run()
    assert isinstance(prefetch, Prefetch)
    assert prefetch.bytes == 3003
    assert not any(chunk.landing for chunk in chunks)
    client.tell(land(2))
    plan = client.run()[0]
    assert (plan.load_bytes, plan.keep.tolist()) == (0, [0, 1, 2])


def test_an_aim_waits_for_the_open_landing() -> None:
    client = make_client()
    client.tell(land(1))
    client.tell(aim(2, 100.0))
    names = kinds(client.run())
    assert names.index("Prefetch") == names.index("Ready") + 1


def test_a_newer_aim_supersedes_an_older_one_and_a_waiting_one() -> None:
    client = make_client()
    client.tell(aim(1))
    client.run(most=2)
    client.tell(aim(2, 100.0))
    superseded = client.run(most=1)[0]
    assert (superseded.generation, superseded.unsent_bytes) == (1, 2003)
    client.run()
    client.tell(land(3, 50.0))
    client.tell(aim(4))
    client.tell(aim(5))
    waiting = [m for m in client.run() if isinstance(m, Superseded)]
    assert [(m.generation, m.by, m.unsent_bytes) for m in waiting] == [(4, 5, 0)]


def test_a_landing_supersedes_an_aim_and_continues_its_part() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(aim(1))
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    superseded, _, chunk, *_ = client.run()
    assert isinstance(superseded, Superseded)
    assert chunk.offset == MAX_CHUNK_BYTES


def test_segments_stay_one_after_the_other_when_a_reject_reopens_a_landing() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(land(1, radius_m=5.0))
    client.run()
    client.tell(aim(2, 100.0, radius_m=15.0))
    client.run(most=2)
    client.held -= {0}
    client.tell(Reject(generation=1, segment=0, reason="hash_mismatch"))
    order = [item.segment for item in client.run() if isinstance(item, SendChunk)]
    assert order == [10, 10, 0, 0, 0, 9, 9, 9, 11, 11, 11]


def test_a_rejected_prefetched_segment_is_sent_once_more() -> None:
    client = make_client()
    client.tell(aim(1, radius_m=5.0))
    client.run()
    for expected in (["SendChunk"], []):
        client.held -= {0}
        client.tell(Reject(generation=1, segment=0, reason="hash_mismatch"))
        assert kinds(client.run()) == expected


# Picks.


def test_picks_are_answered_in_any_order() -> None:
    client = make_client()
    for request in (4, 5):
        client.tell(Pick(request=request, origin=(0.0, 1.0, 0.0)))
    client.run()
    assert [pick.request for pick in client.picks] == [4, 5]
    client.session.picked(5, None)
    client.session.pick_failed(4)
    picked, error = client.run()
    assert picked == Picked(request=5)
    assert (error.code, error.request, error.fatal) == ("internal", 4, False)
    assert error.message == INTERNAL_TEXT


def test_too_many_picks_at_once_are_refused_one_by_one() -> None:
    client = make_client(max_picks=1)
    for request in (4, 5):
        client.tell(Pick(request=request, origin=(0.0, 1.0, 0.0)))
    error = last_error(client)
    assert (error.code, error.request, error.fatal) == ("too_many", 5, False)


# More held than one table takes.


def test_held_goes_on_after_hello_and_is_answered_before_the_plan() -> None:
    client = make_client(greet=False)
    client.greet(held=np.array([(0, 7000)], dtype=HELD_DTYPE))
    client.tell(Held(segments=np.array([(1, 7001), (2, 1), (5000, 7005)], dtype=HELD_DTYPE)))
    client.tell(Held(segments=np.array([(2, 7002)], dtype=HELD_DTYPE)))
    client.tell(land(1))
    client.held = {0, 1, 2}
    first, second, plan, _ = client.run()
    assert isinstance(first, HeldChecked)
    assert (sorted(first.dropped.tolist()), first.held_count) == ([2, 5000], 2)
    assert second == HeldChecked(dropped=ids(), held_count=3)
    assert (plan.keep.tolist(), plan.load_bytes) == ([0, 1, 2], 0)


def test_a_row_that_is_offered_again_replaces_the_one_before() -> None:
    client = make_client(greet=False)
    client.greet(held=np.array([(0, 7000), (1, 7001)], dtype=HELD_DTYPE))
    client.tell(Held(segments=np.array([(1, 5), (0, 7000)], dtype=HELD_DTYPE)))
    (checked,) = client.run()
    assert (checked.dropped.tolist(), checked.held_count) == ([1], 1)


def test_a_whole_scene_can_be_held() -> None:
    count = 3 * MAX_HELD_SEGMENTS // 2
    scene = make_scene(count)
    offer = np.zeros(count, dtype=HELD_DTYPE)
    offer["id"] = np.arange(count)
    offer["xxh3"] = scene.encodings["glb"].hashes
    client = make_client(scene, greet=False)
    assert client.greet(held=offer[:MAX_HELD_SEGMENTS]).held_count == MAX_HELD_SEGMENTS
    client.held = set(range(count))
    client.tell(Held(segments=offer[MAX_HELD_SEGMENTS:]))
    (checked,) = client.run()
    assert (checked.held_count, len(checked.dropped)) == (count, 0)
    client.tell(land(1, 10.0 * (count - 5), radius_m=100.0))
    plan, ready = client.run()
    assert (len(plan.load), ready.payload_bytes) == (0, 0)


def test_held_after_an_aim_or_a_landing_is_fatal() -> None:
    for message in (land(1), aim(1)):
        client = make_client()
        client.tell(message)
        client.tell(Held(segments=np.array([(0, 7000)], dtype=HELD_DTYPE)))
        error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
        assert "before the first one" in error.message


def test_held_before_hello_and_too_much_of_it_are_fatal() -> None:
    rows = np.array([(0, 7000), (1, 7001)], dtype=HELD_DTYPE)
    client = make_client(greet=False)
    client.tell(Held(segments=rows))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    client = make_client(max_held_segments=1)
    client.tell(Held(segments=rows))
    assert_fatal(client, ErrorCode.TOO_LARGE, CloseCode.TOO_LARGE)


def test_beyond_the_radius_only_what_is_held_is_looked_at() -> None:
    """A release factor of 4 must not make the service look at sixteen times the ground."""
    scene, queried_m = make_scene(), []

    def within(centre: Any, radius_m: float) -> Any:
        queried_m.append(radius_m)
        return scene.within(centre, radius_m)

    client = make_client(dataclasses.replace(scene, within=within), greet=False)
    client.greet(release_factor=4.0, held=np.array([(7, 7007), (10, 7010)], dtype=HELD_DTYPE))
    client.tell(land(1, radius_m=20.0))
    plan = client.run()[0]
    assert (plan.load["id"].tolist(), plan.keep.tolist()) == ([0, 1, 2], [])
    assert plan.nearby.tolist() == [7]
    assert plan.release_radius_m == 80.0
    assert queried_m == [20.0]
