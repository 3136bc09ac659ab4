"""The session state machine: errors, notices, held segments, aims, any history against a model.

What tests/socket shows through a connection is not repeated here. Shared: ``session_model.py``.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from server.plain_client import make_hello
from server.session_model import (
    Client,
    aim,
    assert_fatal,
    ids,
    kinds,
    land,
    last_error,
    make_client,
    make_scene,
)

from terraport_server.session.interface import Close, Observer, SessionLimits
from terraport_server.session.session import Session
from terraport_wire import (
    HELD_DTYPE,
    MAX_CHUNK_BYTES,
    Arrived,
    Budgets,
    Bye,
    CloseCode,
    Credit,
    Direction,
    Error,
    ErrorCode,
    Evict,
    FieldError,
    Gather,
    Gathering,
    Held,
    HeldChecked,
    Join,
    Joined,
    Leave,
    Notice,
    Pick,
    Plan,
    Reject,
    Roster,
    Superseded,
    Unknown,
    decode,
)

# Handshake and errors.


def test_an_unknown_type_is_no_hello() -> None:
    """Else a stranger could send as many as it likes before it says who it is."""
    client = make_client(greet=False)
    client.session.receive(Unknown("wave"), 0.0)
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.message == "got an unknown type first, expected hello"


def test_another_major_version_is_refused_with_the_versions_offered() -> None:
    client = make_client(greet=False)
    client.tell(make_hello(protocol=(2, 0)))
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_VERSION, CloseCode.VERSION)
    assert error.protocols == ((1, 0),)


def test_a_newer_minor_version_is_spoken_as_ours() -> None:
    assert make_client(greet=False).greet(protocol=(1, 7)).protocol == (1, 0)


def test_an_encoding_that_the_scene_lacks() -> None:
    client = make_client(make_scene(encoding="later"), greet=False)
    client.tell(make_hello())
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_ENCODING, CloseCode.VERSION)
    assert error.message == "got encoding segment-2, expected one of: later"


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
    bad = {"type": "land", "generation": 3, "position": [0, 0, 0], "radius_m": -1}
    with pytest.raises(FieldError) as caught:
        decode(msgpack.packb(bad), Direction.CLIENT_TO_SERVER)
    client.session.refuse(caught.value, 0.0)
    error = last_error(client)
    assert (error.code, error.generation, error.fatal) == ("invalid_field", 3, False)
    client.tell(land(3))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_a_bad_message_before_hello_is_fatal_whatever_it_is() -> None:
    client = make_client(greet=False)
    client.session.refuse(FieldError("land", "radius_m", "got -1", generation=1), 0.0)
    assert_fatal(client, ErrorCode.INVALID_FIELD, CloseCode.MALFORMED)


def test_bye_ends_it_and_nothing_more_is_sent() -> None:
    client = make_client()
    client.tell(Pick(request=4, origin=(0.0, 1.0, 0.0)))
    client.run()
    client.tell(land(1))
    client.session.scene_published("v2")
    client.tell(Bye())
    client.session.picked(4, None)
    assert client.run() == [Close(CloseCode.NORMAL, "bye")]
    assert client.run() == []


# Notices.


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


def test_news_before_hello_wait_for_the_welcome() -> None:
    client = make_client(greet=False)
    client.session.scene_published("v2")
    assert client.run() == []
    client.greet()
    assert client.run() == [Notice(kind="scene_published", version="v2")]


def test_the_observer_hears_of_times_and_bytes() -> None:
    heard: list[Any] = []

    class Ear(Observer):
        def planned(self, generation: int, **counts: int) -> None:
            heard.append(("planned", generation, counts["payload_bytes"]))

        def first_byte(self, seconds: float) -> None:
            heard.append(("first byte", seconds))

        def ready(self, generation: int, *, seconds: float, **counts: int) -> None:
            heard.append(("ready", generation, seconds))

        def superseded(self, generation: int, unsent_bytes: int, *, landing: bool) -> None:
            heard.append(("superseded", unsent_bytes, landing))

    scene = make_scene()
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=Ear())
    client = Client(session, scene)
    client.greet()
    client.tell(land(1))
    client.now_s = 0.25
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    client.tell(land(3, radius_m=5.0))
    client.now_s = 0.5
    client.run()
    assert heard == [
        ("planned", 1, 3003),
        ("first byte", 0.25),
        ("superseded", 2003, True),
        ("superseded", 0, True),
        ("planned", 3, 0),
        ("ready", 3, 0.25),
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


@settings(max_examples=400)
@given(
    script=st.lists(operations, max_size=25),
    credit=st.integers(0, 5000),
    budgets=st.builds(
        Budgets,
        max_bytes=st.none() | st.integers(0, 6000),
        max_segments=st.none() | st.integers(0, 8),
    ),
    in_runs=st.booleans(),
)
@example(
    script=[("land", 0, 1), ("evict", 0, 0), ("aim", 0, 1), ("reject", 0, 0)],
    credit=0,
    budgets=Budgets(),
    in_runs=True,
)
def test_any_history_keeps_the_rules(
    script: list[tuple[str, int, int]], credit: int, budgets: Budgets, in_runs: bool
) -> None:
    scene = make_scene()
    client = make_client(scene, greet=False)
    client.in_runs = in_runs
    client.greet(credit_bytes=credit, budgets=budgets)
    generation = 0
    for kind, first, second in script:
        if kind in {"land", "aim"}:
            generation += 1
            client.run(until=lambda: client.session.pending == 0)
            make = land if kind == "land" else aim
            client.tell(make(generation, float(first), float(second)))
        elif kind == "run":
            client.run(most=first)
        elif kind == "credit":
            client.credit += first
            client.tell(Credit(bytes=first))
        elif kind == "corrupt":
            client.corrupt ^= {first}
        else:
            # A client never evicts or rejects what it may not; the model waits for quiet first.
            client.corrupt.clear()
            client.credit += 1 << 20
            client.tell(Credit(bytes=1 << 20))
            client.run()
            if kind == "evict":
                client.held -= {first, second}
                for announced in client.load.values():
                    announced[:] = [s for s in announced if s not in {first, second}]
                client.tell(Evict(segments=ids(*{first, second})))
            elif first in client.held:
                client.held -= {first}
                # 6.4, rule 4: what is in the newest landing's plan comes once more in its
                # generation, also where it was evicted after `ready` and came back with an aim.
                newest = next((m for m in reversed(client.messages) if isinstance(m, Plan)), None)
                if newest is not None and first in {*newest.load["id"].tolist(), *newest.keep}:
                    client.load[newest.generation].append(first)
                client.tell(Reject(generation=generation, segment=first, reason="x"))
        assert client.session.transfers is not None
        if client.session.pending == 0:
            server_held = client.session.transfers.held.array().tolist()
            assert server_held == sorted(client.held)
    client.credit += 1 << 20
    client.tell(Credit(bytes=1 << 20))
    client.run()
    assert client.close is None
    landings = [m.generation for m in client.messages if isinstance(m, Plan)]
    for landing in landings:
        ends = set(client.ends[landing])
        assert len(ends) == 1 or landing == landings[-1] or ends == {"ready", "superseded"}
    if landings:
        assert client.ends[landings[-1]][-1] == "ready", "the newest landing always ends ready"


# Held, evict, reject.


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


# Aims.


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


def test_a_rejected_prefetched_segment_is_sent_once_more() -> None:
    client = make_client()
    client.tell(aim(1, radius_m=5.0))
    client.run()
    for expected in (["SendChunk"], []):
        client.held -= {0}
        client.tell(Reject(generation=1, segment=0, reason="hash_mismatch"))
        assert kinds(client.run()) == expected


# Picks.


def test_too_many_picks_at_once_are_refused_one_by_one() -> None:
    client = make_client(max_picks=1)
    for request in (4, 5):
        client.tell(Pick(request=request, origin=(0.0, 1.0, 0.0)))
    error = last_error(client)
    assert (error.code, error.request, error.fatal) == ("too_many", 5, False)
    client.session.picked(4, None)
    client.tell(Pick(request=6, origin=(0.0, 1.0, 0.0)))
    client.run()
    assert [pick.request for pick in client.picks] == [4, 6]


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


class Ear(Observer):
    """Keeps what it hears of aims."""

    def __init__(self) -> None:
        self.ended: list[tuple[int, int]] = []
        self.judged: list[bool] = []

    def aim_ended(self, sent_bytes: int, used_bytes: int) -> None:
        self.ended.append((sent_bytes, used_bytes))

    def aim_judged(self, *, hit: bool) -> None:
        self.judged.append(hit)


def listened(**limits: object) -> tuple[Client, Ear]:
    scene, ear = make_scene(12, **limits), Ear()  # type: ignore[arg-type]
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=ear)
    client = Client(session, scene)
    client.greet()
    return client, ear


def test_a_landing_elsewhere_wastes_and_is_a_miss() -> None:
    client, ear = listened()
    client.tell(aim(1))
    client.run()
    client.tell(land(2, 100.0))
    client.run()
    assert (ear.ended, ear.judged) == ([(3003, 0)], [False])


def test_a_part_that_the_landing_continues_is_used_and_one_that_is_forgotten_is_not() -> None:
    client, ear = listened(length=300_000)
    client.tell(aim(1, radius_m=5.0))
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    client.run()
    assert (ear.ended, ear.judged) == ([(MAX_CHUNK_BYTES, MAX_CHUNK_BYTES)], [False])
    client.tell(aim(3, 100.0, radius_m=5.0))
    client.run(until=lambda: client.chunks[-1].generation == 3)
    client.tell(aim(4, 50.0, radius_m=5.0))
    client.run(most=2)
    assert ear.ended[1:] == [(MAX_CHUNK_BYTES, 0)]


def test_evicted_rejected_and_left_segments_are_waste() -> None:
    client, ear = listened()
    client.tell(aim(1))
    client.run()
    client.tell(Evict(segments=ids(0, 7)))
    client.held.discard(1)
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    assert ear.ended == [(1000, 0), (1001, 0)]
    client.run()
    client.session.ended()
    assert ear.ended[2:] == [(1001 + 1002, 0)], "segment 1 came again"
    assert sum(sent for sent, _ in ear.ended) == sum(chunk.length for chunk in client.chunks)


# Groups: what they do is in test_groups.py.


class GroupCalls:
    """A group port that records what the session asks of it."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def join(self, join: Join, place: Any, now_s: float) -> str | None:
        self.calls.append(("join", place))
        return "full" if join.group == "full" else None

    def leave(self, now_s: float) -> None:
        self.calls.append("leave")

    def gather(self, gather: Gather, now_s: float) -> str | None:
        self.calls.append("gather")
        return None

    def arrived(self, arrived: Arrived) -> None:
        self.calls.append(arrived)

    def landed(self, place: Any, now_s: float) -> None:
        self.calls.append(("landed", place))


def grouped() -> tuple[Client, list[Any]]:
    scene, port = make_scene(), GroupCalls()
    limits = SessionLimits(max_messages_per_s=1e6)
    session = Session(scene, limits, session_id="s", now_s=0.0, groups=port)
    client = Client(session, scene)
    client.greet()
    return client, port.calls


def gathering(number: int) -> Gathering:
    return Gathering(gathering=number, guide=1, position=(0.0, 0.0, 0.0), radius_m=9.0)


def roster(group: str) -> Roster:
    return Roster(group=group, members=())


def test_a_join_says_where_the_newest_accepted_landing_is() -> None:
    client, calls = grouped()
    client.tell(land(1, 5.0))
    client.tell(land(2, 7.0, 1e6))  # refused: too large
    client.tell(aim(3, 9.0))
    client.tell(Join(request=1, group="full", role="member"))
    client.tell(Bye())
    assert calls == [("landed", (5.0, 0.0, 0.0)), ("join", (5.0, 0.0, 0.0)), "leave"]


def test_refusals_of_groups_leave_the_session_open() -> None:
    client, calls = grouped()
    client.tell(Join(request=1, group="full", role="member"))
    client.tell(Gather(request=2, position=(0.0, 0.0, 0.0), radius_m=500.5))
    client.tell(land(1))
    client.session.drain(0.0, 10.0)
    client.tell(Join(request=3, group="tour", role="member"))
    client.run()
    errors = [m for m in client.messages if isinstance(m, Error)]
    assert [(error.request, error.fatal) for error in errors] == [
        (1, False),
        (2, False),
        (3, False),
    ]
    assert "at most 500" in errors[1].message
    assert "goes away" in errors[2].message
    assert calls == [("join", None), ("landed", (0.0, 0.0, 0.0))]


def test_of_group_messages_that_wait_the_newest_of_each_type_is_sent_before_payload() -> None:
    client, _ = grouped()
    client.tell(land(1))
    client.run(most=2)
    for number in range(1, 500):
        client.session.tell_group(gathering(number))
        client.session.tell_group(roster(f"g{number}"))
    assert client.session.pending == 0
    assert client.run(most=2) == [gathering(499), roster("g499")]
    assert kinds(client.run(most=1)) == ["SendChunk"]


@pytest.mark.parametrize("way", ["leave", "join another"])
def test_news_of_a_group_that_was_left_are_dropped(way: str) -> None:
    client, _ = grouped()
    client.session.tell_group(roster("old"))
    joined = Joined(request=1, group="new", member=1, role="member", seat="s")
    if way == "leave":
        client.tell(Leave())
    else:
        client.session.tell_group(joined)
    client.session.tell_group(gathering(1))
    assert client.run() == ([] if way == "leave" else [joined]) + [gathering(1)]
