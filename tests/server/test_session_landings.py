"""The session state machine: landings, order of payload, credit, deadlines, timings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from server.session_model import (
    Client,
    aim,
    assert_fatal,
    ids,
    kinds,
    land,
    make_client,
    make_scene,
)

from terraport_payload import box_distances_m
from terraport_server.session.interface import MakePlan, SendChunk, SendMessage
from terraport_wire import (
    HELD_DTYPE,
    CloseCode,
    Credit,
    ErrorCode,
    Evict,
    Plan,
    Prefetch,
    Ready,
    Reject,
    Superseded,
    Timings,
)

COUNT = 12

# Landings.


def test_what_is_nearby_may_be_evicted_while_the_landing_is_under_way() -> None:
    client = make_client()
    client.tell(land(1, 40.0))
    client.run()
    client.tell(land(2, 55.0, radius_m=20.0))
    assert client.run(most=1)[0].nearby.tolist() == [3]
    client.tell(Evict(segments=ids(3)))
    client.held.discard(3)
    assert kinds(client.run()) == ["SendChunk", "Ready"]
    client.tell(land(3, 40.0))
    assert client.run()[0].load["id"].tolist() == [3]


@pytest.mark.parametrize("make", [land, aim])
def test_parts_that_the_new_plan_does_not_need_are_forgotten(make: Any) -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(make(1))
    client.run(until=lambda: len(client.chunks) == 1)
    client.tell(make(2, 100.0, radius_m=5.0))
    client.run()
    client.tell(land(3, radius_m=5.0))
    chunks = [item for item in client.run() if isinstance(item, SendChunk)]
    assert chunks[0].offset == 0


def test_the_server_bounds_the_plan_too() -> None:
    client = make_client(max_plan_segments=2)
    client.tell(land(1))
    plan = client.run()[0]
    assert (len(plan.load), plan.omitted_by) == (2, "max_segments")


def test_release_factor_of_the_client_wins() -> None:
    client = make_client(greet=False)
    assert client.greet(release_factor=2.0).release_factor == 2.0
    client.tell(land(1, radius_m=30.0))
    client.run()
    client.tell(land(2, radius_m=15.0))
    plan = client.run()[0]
    assert (plan.keep.tolist(), plan.nearby.tolist()) == ([0, 1], [2, 3])


# Plans are made when it is the client's turn.


def test_what_a_newer_landing_ends_before_its_turn_is_never_planned() -> None:
    client = make_client()
    for generation in range(1, 101):
        client.tell(land(generation, 10.0 * generation))
    client.tell(land(101, 30.0, radius_m=5.0))
    assert client.looked_at == []
    *ended, plan, chunk, ready = client.run()
    assert [(m.generation, m.by, m.unsent_bytes) for m in ended] == [
        (generation, generation + 1, 0) for generation in range(1, 101)
    ]
    assert (plan.generation, plan.load["id"].tolist()) == (101, [3])
    assert (chunk.generation, ready.generation) == (101, 101)
    assert client.looked_at == [1]


def test_a_landing_ends_an_older_one_at_once_and_sends_nothing_until_its_plan() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(land(1))
    client.run(until=lambda: len(client.chunks) == 4)
    client.tell(land(2))
    client.tell(land(3))
    (first, second) = client.run(most=2)
    assert [(m.generation, m.unsent_bytes > 0) for m in (first, second)] == [(1, True), (2, False)]
    assert client.session.next_action() == MakePlan()
    assert client.session.next_chunks(1) == []
    assert client.session.next_action() == MakePlan(), "until it is answered"


def test_a_plan_costs_what_is_near_and_what_is_held() -> None:
    client = make_client()
    client.tell(land(1, radius_m=25.0))
    client.run()
    client.tell(aim(2, 80.0, radius_m=10.0))
    client.run()
    assert client.looked_at == [3, 3 + 3]


def test_a_deadline_counts_from_land_and_not_from_the_plan() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(land(1, deadline_ms=100, inner_radius_m=5.0))
    client.now_s = 0.05
    client.run(most=1)
    assert client.session.wake_at_s() == 0.1


def test_an_evict_between_land_and_plan_is_fatal() -> None:
    client = make_client()
    client.tell(land(1))
    client.tell(Evict(segments=ids(11)))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.message == "got evict of segment 11 after land, expected the plan first"


# Credit.


def test_credit_is_clamped() -> None:
    client = make_client(max_credit_bytes=1200)
    assert client.session.transfers is not None
    assert client.session.transfers.credit_bytes == 1200
    client.tell(Credit(bytes=1 << 50))
    assert client.session.transfers.credit_bytes == 1200


# Deadlines.


def test_degraded_comes_late_if_the_inner_set_is_late_and_only_once() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=999)
    client.tell(land(1, inner_radius_m=5.0, deadline_ms=500))
    client.run()
    client.now_s = 0.6
    client.session.tick(0.6)
    assert client.run() == []
    assert client.session.wake_at_s() > 1.0, "a deadline that has passed wakes nobody again"
    client.credit += 500
    client.tell(Credit(bytes=500))
    assert kinds(client.run()) == ["SendChunk", "Degraded", "SendChunk"]
    client.session.tick(0.7)
    assert client.run() == []


# Deadlines that progress puts off.


def started(**fields: object) -> Client:
    """A landing whose first segment is the inner set; credit for 999 bytes, one short of it."""
    client = make_client(greet=False)
    client.greet(credit_bytes=999)
    client.tell(land(1, inner_radius_m=5.0, **fields))
    client.run()
    return client


def go_on(client: Client, now_s: float, credit: int) -> list[str]:
    client.now_s = now_s
    client.session.tick(now_s)
    before = kinds(client.run())
    if credit:
        client.credit += credit
        client.tell(Credit(bytes=credit))
    return before + kinds(client.run())


def test_progress_puts_the_deadline_off() -> None:
    client = started(stall_ms=500)
    assert client.session.wake_at_s() == 0.5
    assert go_on(client, 0.4, 1) == ["SendChunk"]
    assert client.session.wake_at_s() == 0.9
    assert go_on(client, 0.8, 1000) == ["SendChunk"]
    assert go_on(client, 1.2, 1003) == ["SendChunk", "SendChunk", "Ready"], "a slow one is no stall"
    assert go_on(client, 9.0, 0) == []


def test_standing_still_brings_the_inner_set() -> None:
    client = started(stall_ms=500)
    assert go_on(client, 0.4, 1) == ["SendChunk"]
    assert go_on(client, 0.91, 0) == ["Degraded"]
    assert client.session.wake_at_s() > 10.0
    assert go_on(client, 1.0, 5000) == ["SendChunk", "SendChunk", "Ready"]


def test_a_stall_that_nobody_ticked_at_counts() -> None:
    client = started(stall_ms=500)
    client.now_s = 0.6
    client.credit += 1
    client.tell(Credit(bytes=1))
    assert kinds(client.run()) == ["SendChunk", "Degraded"]


def test_progress_does_not_put_off_the_last_deadline() -> None:
    client = started(stall_ms=500, deadline_ms=800)
    assert go_on(client, 0.4, 1) == ["SendChunk"]
    assert client.session.wake_at_s() == 0.8
    assert go_on(client, 0.7, 1) == ["SendChunk"]
    assert go_on(client, 0.81, 0) == ["Degraded"]


def landed(client: Client, generation: int, at_s: float, *, radius_m: float = 25.0) -> None:
    """Land, and have the plan leave 1 ms later."""
    client.now_s = at_s
    client.tell(land(generation, radius_m=radius_m))
    (plan,) = client.run(most=1)
    assert isinstance(plan, Plan)
    client.session.plan_sent(generation, at_s + 0.001)


def timings(client: Client) -> Timings:
    ready = client.messages[-1]
    assert isinstance(ready, Ready)
    assert ready.timings is not None
    return ready.timings


def test_times_count_from_land_and_credit_is_told_apart() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1000, timings=True)
    landed(client, 1, 10.0)
    client.now_s = 10.004
    client.run()  # the first segment; then there is no credit
    client.now_s = 10.504
    client.tell(Credit(bytes=10_000))
    client.credit += 10_000
    client.now_s = 10.510
    client.run()
    times = timings(client)
    assert (times.plan_us, times.first_byte_us) == (1000, 4000)
    assert (times.last_byte_us, times.ready_us) == (510_000, 510_000)
    assert times.credit_wait_us == 500_000


def test_a_landing_without_payload_has_no_bytes_times() -> None:
    client = make_client(greet=False)
    client.greet(timings=True)
    landed(client, 1, 0.0)
    client.run()
    client.now_s = 5.0
    client.tell(land(2))
    client.run()
    times = timings(client)
    assert (times.plan_us, times.first_byte_us, times.last_byte_us) == (None, None, None)
    assert (times.ready_us, times.credit_wait_us) == (0, 0)


def test_a_stall_of_the_landing_before_does_not_count() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1000, timings=True)
    landed(client, 1, 0.0)
    client.run()  # out of credit at once
    client.now_s = 7.0
    client.tell(land(2))
    client.run()
    client.now_s = 7.25
    client.tell(Credit(bytes=10_000))
    client.credit += 10_000
    client.run()
    assert timings(client).credit_wait_us == 250_000


def test_access_withdrawn_ends_the_session_as_unauthorised() -> None:
    client = make_client()
    client.tell(land(1))
    client.session.withdraw("the token has expired, expected a connection with a newer one")
    client.session.withdraw("twice")
    client.run()
    error = client.messages[-1]
    assert (error.code, error.fatal) == (ErrorCode.UNAUTHORISED, True)  # type: ignore[attr-defined]
    assert client.close is not None
    assert int(client.close.code) == 4401


@settings(max_examples=200)
@given(
    x=st.integers(-10, 120),
    radius=st.integers(5, 80),
    kept=st.sets(st.integers(0, COUNT - 1)),
    rejects=st.lists(st.tuples(st.integers(1, 6), st.integers(0, COUNT - 1)), max_size=6),
)
def test_the_nearest_that_is_due_goes_next_also_after_rejects_and_resume(
    x: int, radius: int, kept: set[int], rejects: list[tuple[int, int]]
) -> None:
    # A landing of a client that offers what it kept.
    scene = make_scene(COUNT, length=200_000)  # two chunks each
    client = make_client(scene, greet=False)
    hashes = scene.encodings["segment-2"].hashes
    offer = [(segment, int(hashes[segment])) for segment in sorted(kept)]
    client.greet(held=np.array(offer, dtype=HELD_DTYPE))  # as after a reconnect
    client.tell(land(1, float(x), float(radius), inner_radius_m=min(5.0, radius)))
    (plan,) = client.run(most=1)
    # The model: what is due goes by distance, then by id, and what has begun goes on first.
    distances = box_distances_m(scene.encodings["segment-2"].bounds, (float(x), 0.0, 0.0))
    rank: Callable[[int], tuple[float, int]] = lambda s: (float(distances[s]), s)  # noqa: E731
    due = set(plan.load["id"].tolist())
    in_plan = due | set(plan.keep.tolist())
    assert plan.load["id"].tolist() == sorted(due, key=rank)
    resent: set[int] = set()
    partly: int | None = None
    script = list(rejects)
    left = script[0][0] if script else -1
    # Chunk by chunk; between them the client rejects as the script says.
    while (action := client.session.next_action()) is not None:
        if isinstance(action, SendMessage):
            assert isinstance(action.message, Ready | Superseded | Prefetch)
            if not script:
                continue
        else:
            assert isinstance(action, SendChunk)
            expected = min(due, key=rank) if partly is None else partly
            assert action.segment == expected
            client.session.chunks_sent([action], 0.0)
            client.credit -= action.length
            partly = action.segment
            if action.offset + action.length == action.total:
                partly = None
                due.discard(action.segment)
                client.held.add(action.segment)
            left -= 1
        if script and (left <= 0 or isinstance(action, SendMessage)):
            segment = script.pop(0)[1]
            left = script[0][0] if script else -1
            # A segment of the plan comes once more, and only once.
            if segment in client.held:
                client.held.discard(segment)
                if segment in in_plan and segment not in resent:
                    due.add(segment)
                    resent.add(segment)
                client.tell(Reject(generation=1, segment=segment, reason="x"))
    assert not due
