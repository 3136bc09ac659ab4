"""The session state machine: landings, what supersedes them, credit, deadlines.

What the files of the session's tests share stands in ``session_model.py``: small scenes, a client
that keeps the rules, and short words for messages.
"""

from __future__ import annotations

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

from terraport_server.session.interface import MakePlan, SendChunk
from terraport_wire import (
    MAX_CHUNK_BYTES,
    Budgets,
    CloseCode,
    Credit,
    Degraded,
    ErrorCode,
    Evict,
    Plan,
    Ready,
    Superseded,
)

# Landings.


def test_a_landing_from_plan_to_ready() -> None:
    client = make_client()
    client.tell(land(1))
    plan, *chunks, ready = client.run()
    assert isinstance(plan, Plan)
    assert plan.load["id"].tolist() == [0, 1, 2]
    assert plan.load["length"].tolist() == [1000, 1001, 1002]
    assert plan.load["xxh3"].tolist() == [7000, 7001, 7002]
    assert (plan.load_bytes, plan.load_triangles, plan.release_radius_m) == (3003, 30, 31.25)
    assert [chunk.segment for chunk in chunks] == [0, 1, 2]
    assert isinstance(ready, Ready)
    assert (ready.delivered, ready.payload_bytes, ready.missing.tolist()) == (3, 3003, [])


def test_a_second_visit_loads_nothing() -> None:
    client = make_client()
    for generation, x in ((1, 0.0), (2, 100.0)):
        client.tell(land(generation, x))
        client.run()
    client.tell(land(3))
    plan, ready = client.run()
    assert (plan.load_bytes, plan.keep.tolist(), ready.payload_bytes) == (0, [0, 1, 2], 0)


def test_what_a_hop_leaves_behind_is_nearby_up_to_the_release_radius() -> None:
    client = make_client()
    client.tell(land(1, 40.0))
    assert sorted(client.run()[0].load["id"].tolist()) == [2, 3, 4, 5, 6]
    client.tell(land(2, 55.0, radius_m=20.0))  # segment 3 is 24 m away, 2 is 34 m
    plan = client.run()[0]
    assert (plan.keep.tolist(), plan.load["id"].tolist()) == ([4, 5, 6], [7])
    assert (plan.nearby.tolist(), plan.release_radius_m) == ([3], 25.0)


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


def test_a_large_segment_goes_in_chunks_of_the_largest_frame() -> None:
    client = make_client(make_scene(2, length=300_000))
    client.tell(land(1, radius_m=5.0))
    chunks = [item for item in client.run() if isinstance(item, SendChunk)]
    assert [chunk.offset for chunk in chunks] == [0, MAX_CHUNK_BYTES, 2 * MAX_CHUNK_BYTES]
    assert sum(chunk.length for chunk in chunks) == 300_000


def test_empty_plan_is_ready_at_once() -> None:
    client = make_client()
    client.tell(land(1, -500.0, radius_m=5.0))
    plan, ready = client.run()
    assert (len(plan.load), ready.delivered) == (0, 0)


def test_budgets_bound_load_and_keep_together() -> None:
    client = make_client(greet=False)
    client.greet(budgets=Budgets(max_triangles=25))
    client.tell(land(1))
    plan = client.run()[0]
    assert plan.load["id"].tolist() == [0, 1]
    assert (plan.omitted_segments, plan.omitted_by) == (1, "max_triangles")
    assert plan.effective_radius_m == 20.0


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


# Supersede.


def test_supersede_drops_the_rest_and_continues_what_both_need() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(land(1))
    client.run(until=lambda: len(client.chunks) == 4)  # segment 0 whole, one chunk of segment 1
    client.tell(land(2, 10.0, radius_m=5.0))
    superseded, plan, *chunks, ready = client.run()
    assert isinstance(superseded, Superseded)
    assert (superseded.generation, superseded.by) == (1, 2)
    assert superseded.unsent_bytes == 300_001 - MAX_CHUNK_BYTES + 300_002
    assert plan.keep.tolist() == []
    assert plan.load["id"].tolist() == [1]
    assert [chunk.offset for chunk in chunks] == [MAX_CHUNK_BYTES, 2 * MAX_CHUNK_BYTES]
    assert {chunk.generation for chunk in chunks} == {2}
    assert ready.payload_bytes == 300_001 - MAX_CHUNK_BYTES


def test_parts_that_the_new_plan_does_not_need_are_forgotten() -> None:
    client = make_client(make_scene(12, length=300_000))
    client.tell(land(1))
    client.run(until=lambda: len(client.chunks) == 1)
    client.tell(land(2, 100.0, radius_m=5.0))
    client.run()
    client.tell(land(3, radius_m=5.0))
    chunks = [item for item in client.run() if isinstance(item, SendChunk)]
    assert chunks[0].offset == 0


def test_a_finished_landing_is_not_superseded() -> None:
    client = make_client()
    client.tell(land(1))
    client.run()
    client.tell(land(2))
    assert kinds(client.run()) == ["Plan", "Ready"]


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


def test_an_aim_is_planned_after_the_landing_is_ready() -> None:
    client = make_client()
    client.tell(land(1))
    client.tell(aim(2, 80.0))
    assert kinds(client.run())[-2:] == ["SendChunk", "SendChunk"]
    assert len(client.looked_at) == 2


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


def test_no_chunk_beyond_the_credit() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1500)
    client.tell(land(1))
    seen = client.run()
    assert [item.length for item in seen[1:]] == [1000, 500]
    assert client.run() == []
    client.credit += 600
    client.tell(Credit(bytes=600))
    assert [item.length for item in client.run()] == [501, 99]


def test_no_credit_no_payload_but_messages() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    assert kinds(client.run()) == ["Plan"]


def test_credit_is_clamped() -> None:
    client = make_client(max_credit_bytes=1200)
    assert client.session.transfers is not None
    assert client.session.transfers.credit_bytes == 1200
    client.tell(Credit(bytes=1 << 50))
    assert client.session.transfers.credit_bytes == 1200


# Deadlines.


def test_degraded_when_the_deadline_passes_with_the_inner_set_whole() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1000)
    client.tell(land(1, inner_radius_m=5.0, deadline_ms=500))
    client.run()
    assert client.session.wake_at_s() == 0.5
    client.now_s = 0.6
    client.session.tick(0.6)
    (degraded,) = client.run()
    assert isinstance(degraded, Degraded)
    assert degraded.segments.tolist() == [0]
    client.credit += 5000
    client.tell(Credit(bytes=5000))
    assert kinds(client.run()) == ["SendChunk", "SendChunk", "Ready"]


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


def test_ready_in_time_is_never_degraded() -> None:
    client = make_client()
    client.tell(land(1, inner_radius_m=5.0, deadline_ms=500))
    client.run()
    client.session.tick(0.6)
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


def test_a_stall_that_has_passed_stays_passed() -> None:
    client = started(stall_ms=500)
    assert go_on(client, 0.6, 0) == [], "the inner set is not whole"
    assert go_on(client, 0.7, 1) == ["SendChunk", "Degraded"]


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
