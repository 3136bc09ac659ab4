"""The session state machine, without any event loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from server.plain_client import make_hello
from server.session_model import Client, make_scene

from terraport_server.actions import Close, Observer, SceneView, SendChunk, SessionLimits
from terraport_server.selection import box_distances
from terraport_server.session import INTERNAL_TEXT, Session
from terraport_wire import (
    HELD_DTYPE,
    MAX_CHUNK_BYTES,
    Aim,
    Budgets,
    Bye,
    CloseCode,
    Credit,
    Degraded,
    Direction,
    Error,
    ErrorCode,
    Evict,
    FieldError,
    Land,
    MalformedError,
    Notice,
    Pick,
    Picked,
    Plan,
    Prefetch,
    Ready,
    Reject,
    Subprotocol,
    Superseded,
    Unknown,
    Welcome,
    decode,
)


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
    assert plan.release.tolist() == [8, 9, 10, 11]


def test_release_is_what_was_shown_and_is_not_wanted() -> None:
    client = make_client()
    client.tell(land(1))
    client.run()
    client.tell(land(2, 40.0, radius_m=12.0))
    plan = client.run()[0]
    assert plan.release.tolist() == [0, 1, 2]
    client.tell(land(3, 0.0, radius_m=5.0))  # superseded before ready: landing 2 was never shown
    client.run()
    assert client.messages[-2].release.tolist() == [3, 4, 5]


def test_a_superseded_landing_is_not_shown() -> None:
    client = make_client()
    client.tell(land(1))
    client.run(most=2)
    client.tell(land(2, 100.0, radius_m=5.0))
    client.run()
    plan = next(m for m in client.messages if isinstance(m, Plan) and m.generation == 2)
    assert plan.release.tolist() == []


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
    assert client.run()[0].keep.tolist() == [0, 1, 2, 3]


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
    assert client.session.deliveries is not None
    assert client.session.deliveries.credit_bytes == 1200
    client.tell(Credit(bytes=1 << 50))
    assert client.session.deliveries.credit_bytes == 1200


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


def test_hashes_are_those_of_the_encoding() -> None:
    client = make_client(make_scene(encodings=2), greet=False)
    offered = np.array([(1, 7001), (2, 8002)], dtype=HELD_DTYPE)
    assert client.greet(held=offered, encoding="arrays").dropped.tolist() == [1]


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
    assert [getattr(i, "segment", "ready") for i in client.run()] == [1, 2, 0, "ready"]


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
    client.tell(land(2, 100.0, radius_m=5.0))
    assert client.run()[0].release.tolist() == [0, 1, 2]


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


# Greeting, order, errors.


def test_hello_comes_first() -> None:
    client = make_client(greet=False)
    client.tell(land(1))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.message == "got land first, expected hello"


def test_hello_comes_once() -> None:
    client = make_client()
    client.tell(make_hello())
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_another_major_version_is_refused_with_the_versions_offered() -> None:
    client = make_client(greet=False)
    client.tell(make_hello(protocol=(2, 0)))
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_VERSION, CloseCode.VERSION)
    assert error.protocols == ((1, 0),)


def test_a_newer_minor_version_is_spoken_as_ours() -> None:
    assert make_client(greet=False).greet(protocol=(1, 7)).protocol == (1, 0)


def test_an_encoding_that_the_scene_lacks() -> None:
    client = make_client(greet=False)
    client.tell(make_hello(encoding="arrays"))
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_ENCODING, CloseCode.VERSION)
    assert error.message == "got encoding arrays, expected one of: glb"


def test_too_many_held_segments() -> None:
    client = make_client(greet=False, max_held_segments=1)
    client.tell(make_hello(held=np.array([(0, 7000), (1, 7001)], dtype=HELD_DTYPE)))
    assert_fatal(client, ErrorCode.TOO_LARGE, CloseCode.TOO_LARGE)


@pytest.mark.parametrize("code", [ErrorCode.UNAUTHORISED, ErrorCode.FORBIDDEN])
def test_the_token_decides(code: ErrorCode) -> None:
    client = make_client(greet=False, authorise=lambda token: None if token == "right" else code)
    client.tell(make_hello(token="wrong"))
    assert_fatal(client, code, {"unauthorised": 4401, "forbidden": 4403}[code])  # type: ignore[arg-type]
    client = make_client(greet=False, authorise=lambda token: None if token == "right" else code)
    assert isinstance(client.greet(token="right"), Welcome)


@pytest.mark.parametrize("second", [4, 3, 0])
def test_generations_increase_over_aims_and_landings(second: int) -> None:
    client = make_client()
    client.tell(aim(4))
    client.tell(land(second))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.generation == second
    assert error.message == f"got generation {second}, expected one above 4"


def test_the_first_generation_may_be_zero() -> None:
    client = make_client()
    client.tell(land(0, radius_m=5.0))
    assert kinds(client.run()) == ["Plan", "SendChunk", "Ready"]


def test_a_radius_too_large_is_refused_and_the_open_landing_goes_on() -> None:
    client = make_client()
    client.tell(land(1))
    client.run(most=2)
    client.tell(land(2, radius_m=500.5))
    error, *rest = client.run()
    assert (error.code, error.generation, error.fatal) == ("radius_too_large", 2, False)
    assert kinds(rest) == ["SendChunk", "SendChunk", "Ready"]
    client.tell(land(2))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_a_bad_landing_is_refused_and_its_generation_is_used() -> None:
    client = make_client()
    text = '{"type":"land","generation":3,"position":[0,0,0],"radius_m":-1}'
    with pytest.raises(FieldError) as caught:
        decode(text, Subprotocol.JSON, Direction.CLIENT_TO_SERVER)
    client.session.refuse(caught.value, 0.0)
    error = last_error(client)
    assert (error.code, error.generation, error.fatal) == ("invalid_field", 3, False)
    client.tell(land(3))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_what_is_no_message_is_fatal() -> None:
    client = make_client()
    client.session.refuse(MalformedError("got rubbish", offset=3), 0.0)
    assert_fatal(client, ErrorCode.MALFORMED, CloseCode.MALFORMED)


def test_a_bad_message_before_hello_is_fatal_whatever_it_is() -> None:
    client = make_client(greet=False)
    client.session.refuse(FieldError("land", "radius_m", "got -1", generation=1), 0.0)
    assert_fatal(client, ErrorCode.INVALID_FIELD, CloseCode.MALFORMED)


def test_unknown_messages_are_skipped() -> None:
    client = make_client()
    client.session.receive(Unknown("teleport_party"), 0.0)
    assert client.run() == []


def test_bye_ends_it_and_nothing_more_is_sent() -> None:
    client = make_client()
    client.tell(land(1))
    client.tell(Bye())
    assert client.run() == [Close(CloseCode.NORMAL, "bye")]
    assert client.run() == []


def test_a_failure_of_ours_tells_nothing() -> None:
    client = make_client()
    client.session.fail()
    error = assert_fatal(client, ErrorCode.INTERNAL, CloseCode.INTERNAL)
    assert error.message == INTERNAL_TEXT


# Time.


def test_no_hello_in_time() -> None:
    client = make_client(greet=False, handshake_timeout_s=3.0)
    assert client.session.wake_at_s() == 3.0
    client.session.tick(2.9)
    assert client.run() == []
    client.session.tick(3.0)
    assert_fatal(client, ErrorCode.TIMEOUT, CloseCode.TIMEOUT)


def test_silence_ends_the_session_and_a_pong_is_no_silence() -> None:
    client = make_client(idle_timeout_s=5.0)
    client.session.heard(4.0)
    client.session.tick(6.0)
    assert client.run() == []
    assert client.session.wake_at_s() == 9.0
    client.session.tick(9.0)
    assert_fatal(client, ErrorCode.TIMEOUT, CloseCode.TIMEOUT)


def test_too_many_messages() -> None:
    client = make_client(max_messages_per_s=2.0)  # 20 at once; hello took one
    for _ in range(19):
        client.tell(Credit(bytes=1))
    assert client.run() == []
    client.now_s = 0.5
    client.tell(Credit(bytes=1))
    assert client.run() == []
    client.tell(Credit(bytes=1))
    assert_fatal(client, ErrorCode.TOO_MANY, CloseCode.TOO_MANY)


# News.


def test_draining_finishes_the_open_landing_first() -> None:
    client = make_client(reconnect_after_ms=700)
    client.tell(land(1))
    client.tell(aim(2, 100.0))
    client.run(most=2)
    client.session.drain(0.0, 10.0)
    notice, *rest = client.run()
    assert notice == Notice(kind="draining", reconnect_after_ms=700)
    assert kinds(rest) == ["SendChunk", "SendChunk", "Ready", "Close"]
    assert client.close == Close(CloseCode.DRAINING, "draining")


def test_draining_is_bounded() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    client.session.drain(0.0, 2.0)
    assert kinds(client.run()) == ["Plan", "Notice"]
    assert client.session.wake_at_s() == 2.0
    client.session.tick(2.0)
    assert client.run() == [Close(CloseCode.DRAINING, "draining")]


def test_draining_takes_no_landing() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    client.session.drain(0.0, 2.0)
    client.tell(land(2))
    assert_fatal(client, ErrorCode.DRAINING, CloseCode.DRAINING)


def test_draining_an_idle_session_ends_it() -> None:
    client = make_client()
    client.session.drain(0.0, 2.0)
    assert kinds(client.run()) == ["Notice", "Close"]
    stranger = make_client(greet=False)
    stranger.session.drain(0.0, 2.0)
    assert kinds(stranger.run()) == ["Close"]


def test_a_new_version_is_told_and_changes_nothing() -> None:
    client = make_client()
    client.session.scene_published("v2")
    assert client.run() == [Notice(kind="scene_published", version="v2")]
    client.tell(land(1))
    assert kinds(client.run())[-1] == "Ready"


def test_news_before_hello_wait_for_the_welcome() -> None:
    client = make_client(greet=False)
    client.session.scene_published("v2")
    assert client.run() == []
    client.greet()
    assert client.run() == [Notice(kind="scene_published", version="v2")]


def test_the_observer_hears_of_times_and_bytes() -> None:
    heard: list[Any] = []

    class Ear(Observer):
        def planned(self, generation: int, plan: Plan) -> None:
            heard.append(("planned", generation, plan.load_bytes))

        def first_byte(self, seconds: float) -> None:
            heard.append(("first byte", seconds))

        def ready(self, message: Ready, seconds: float) -> None:
            heard.append(("ready", message.generation, seconds))

        def superseded(self, message: Superseded, *, landing: bool) -> None:
            heard.append(("superseded", message.unsent_bytes, landing))

    scene = make_scene()
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=Ear())
    client = Client(session, scene)
    client.greet()
    client.tell(land(1))
    client.now_s = 0.25
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    client.now_s = 0.5
    client.run()
    assert heard == [
        ("planned", 1, 3003),
        ("first byte", 0.25),
        ("superseded", 2003, True),
        ("planned", 2, 0),
        ("ready", 2, 0.0),
    ]


# Everything at once, against the model.

operations = st.one_of(
    st.tuples(st.just("land"), st.integers(-20, 130), st.integers(1, 60)),
    st.tuples(st.just("aim"), st.integers(-20, 130), st.integers(1, 60)),
    st.tuples(st.just("run"), st.integers(1, 8), st.just(0)),
    st.tuples(st.just("credit"), st.integers(1, 3000), st.just(0)),
    st.tuples(st.just("evict"), st.integers(0, 11), st.integers(0, 11)),
    st.tuples(st.just("reject"), st.integers(0, 11), st.just(0)),
    st.tuples(st.just("corrupt"), st.integers(0, 11), st.just(0)),
)


@settings(max_examples=400, deadline=None)
@given(
    script=st.lists(operations, max_size=25),
    credit=st.integers(0, 5000),
    budgets=st.builds(
        Budgets,
        max_bytes=st.none() | st.integers(0, 6000),
        max_segments=st.none() | st.integers(0, 8),
    ),
)
def test_any_history_keeps_the_rules(
    script: list[tuple[str, int, int]], credit: int, budgets: Budgets
) -> None:
    scene = make_scene()
    client = make_client(scene, greet=False)
    client.greet(credit_bytes=credit, budgets=budgets)
    generation = 0
    for kind, one, two in script:
        if kind in {"land", "aim"}:
            generation += 1
            client.run(until=lambda: client.session.pending == 0)
            make = land if kind == "land" else aim
            client.tell(make(generation, float(one), float(two)))
            if kind == "land":
                _check_plan(client, generation, float(one), float(two), budgets)
        elif kind == "run":
            client.run(most=one)
        elif kind == "credit":
            client.credit += one
            client.tell(Credit(bytes=one))
        elif kind == "corrupt":
            client.corrupt ^= {one}
        else:
            # A client never evicts or rejects what it may not; the model waits for quiet first.
            client.corrupt.clear()
            client.credit += 1 << 20
            client.tell(Credit(bytes=1 << 20))
            client.run()
            if kind == "evict":
                client.held -= {one, two}
                for announced in client.load.values():
                    announced[:] = [s for s in announced if s not in {one, two}]
                client.tell(Evict(segments=ids(*{one, two})))
            elif one in client.held:
                client.held -= {one}
                client.tell(Reject(generation=generation, segment=one, reason="x"))
        assert client.session.deliveries is not None
        if client.session.pending == 0:
            held = np.flatnonzero(client.session.deliveries.held).tolist()
            assert held == sorted(client.held)
    client.credit += 1 << 20
    client.tell(Credit(bytes=1 << 20))
    client.run()
    assert client.close is None
    landings = [m.generation for m in client.messages if isinstance(m, Plan)]
    for one in landings:
        ends = set(client.ends[one])
        assert len(ends) == 1 or one == landings[-1] or ends == {"ready", "superseded"}
    if landings:
        assert client.ends[landings[-1]][-1] == "ready", "the newest landing always ends ready"


def _check_plan(
    client: Client, generation: int, x: float, radius_m: float, budgets: Budgets
) -> None:
    held = set(client.held)
    client.run(until=lambda: generation in client.load)
    plan = next(m for m in reversed(client.messages) if isinstance(m, Plan))
    assert plan.generation == generation
    distances = box_distances(client.table.bounds, (x, 0.0, 0.0))
    wanted = sorted(
        (float(distances[s]), s)
        for s in range(len(client.table))
        if distances[s] <= radius_m or (s in held and distances[s] <= radius_m * 1.25)
    )
    expected: list[int] = []
    for _, segment in wanted:
        size = sum(int(client.table.lengths[s]) for s in [*expected, segment])
        if budgets.max_bytes is not None and size > budgets.max_bytes:
            break
        if budgets.max_segments is not None and len(expected) >= budgets.max_segments:
            break
        expected.append(segment)
    assert plan.load["id"].tolist() == [s for s in expected if s not in held]
    assert plan.keep.tolist() == sorted(s for s in expected if s in held)
